//! Arguments and options of a command as Markdown lists.

use clap::{Arg, Command};

/// Returns the description of a command in one paragraph.
pub(super) fn about(command: &Command) -> String {
    let about = command.get_long_about().or(command.get_about()).map(ToString::to_string);
    escaped(&about.unwrap_or_default())
}

/// Returns a list of arguments: name, default, description and possible values.
pub(super) fn list<'a>(arguments: impl Iterator<Item = &'a Arg>) -> String {
    let shown = |argument: &&Arg| !argument.is_hide_set() && !["help", "version"].contains(&argument.get_id().as_str());
    arguments.filter(shown).map(item).collect()
}

fn item(argument: &Arg) -> String {
    let help = argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default();
    let mut text = format!("- `{}`", name(argument));
    if argument.get_action().takes_values() && !argument.get_default_values().is_empty() {
        let values: Vec<String> =
            argument.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()).collect();
        text += &format!(" (default `{}`)", values.join(","));
    } else if argument.is_required_set() && !argument.is_positional() {
        text += " (required)";
    }
    text += &format!(": {}\n", escaped(&help));
    if argument.get_action().takes_values() {
        for value in argument.get_possible_values().iter().filter(|value| !value.is_hide_set()) {
            let help = value.get_help().map(|help| format!(": {}", escaped(&help.to_string()))).unwrap_or_default();
            text += &format!("  - `{}`{help}\n", value.get_name());
        }
    }
    text
}

/// Returns the name of an argument with its values, as a user types it.
fn name(argument: &Arg) -> String {
    let values = match argument.get_value_names() {
        Some(names) => names.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "),
        None => argument.get_id().as_str().to_uppercase(),
    };
    let several = argument.get_num_args().is_some_and(|count| count.max_values() > 1);
    let values = if several && !values.contains(' ') { format!("{values}...") } else { values };
    if argument.is_positional() {
        return if argument.is_required_set() { values } else { format!("[{values}]") };
    }
    let short = argument.get_short().map(|short| format!("-{short}"));
    let long = argument.get_long().map(|long| format!("--{long}"));
    let names = short.into_iter().chain(long).collect::<Vec<_>>().join(", ");
    if argument.get_action().takes_values() { format!("{names} {values}") } else { names }
}

/// Returns a text on one line, with the characters escaped that Markdown would interpret outside code.
pub(super) fn escaped(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    // Links of Rust documentation lead nowhere here.
    let text = text.replace("[`crate::", "`").replace("[`", "`").replace("`]", "`");
    let (mut escaped, mut code) = (String::with_capacity(text.len()), false);
    for letter in text.chars() {
        code ^= letter == '`';
        if letter == '|' || !code && "<*[".contains(letter) {
            escaped.push('\\');
        }
        escaped.push(letter);
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_shown_as_it_is() {
        assert_eq!(escaped("a <b>\n  `c<d` e|f, *.rrd"), "a \\<b> `c<d` e\\|f, \\*.rrd");
        assert_eq!(escaped("number, [`crate::Combination::id`]"), "number, `Combination::id`");
    }

    #[test]
    fn options_are_listed_with_defaults_and_values() {
        let command = Command::new("test")
            .arg(Arg::new("file").required(true).help("A file."))
            .arg(Arg::new("count").long("count").short('n').default_value("3").help("How many."))
            .arg(Arg::new("mode").long("mode").value_name("MODE").value_parser(["slow", "fast"]));
        let expected = "- `FILE`: A file.\n- `-n, --count COUNT` (default `3`): How many.\n- `--mode MODE`: \n  - `slow`\n  - `fast`\n";
        assert_eq!(list(command.get_arguments()), expected);
    }
}
