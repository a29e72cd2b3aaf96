//! Names of commands and options of the previous version: they work for one version more, with a notice.

use std::ffi::{OsStr, OsString};

/// A name that was replaced.
struct Renamed {
    former: &'static [&'static str],
    current: &'static [&'static str],
}

/// Commands, with the commands above them.
const COMMANDS: [Renamed; 3] = [
    Renamed { former: &["twin"], current: &["sysid"] },
    Renamed { former: &["grasps", "pick-ups"], current: &["grasps", "repertoire"] },
    Renamed { former: &["grasps", "plan"], current: &["grasps", "pairs"] },
];

/// Options of any command, without or with a value.
const OPTIONS: [Renamed; 13] = [
    Renamed { former: &["--individual"], current: &["--instance"] },
    Renamed { former: &["--eyes"], current: &["--detector"] },
    Renamed { former: &["--mirror"], current: &["--detect-faults"] },
    Renamed { former: &["--foresee"], current: &["--look-ahead"] },
    Renamed { former: &["--prove"], current: &["--verify"] },
    Renamed { former: &["--plans"], current: &["--pairs"] },
    Renamed { former: &["--rehearse"], current: &["--search-skills"] },
    Renamed { former: &["--of"], current: &["--pairs"] },
    Renamed { former: &["--tell"], current: &["--send"] },
    Renamed { former: &["--know-cameras"], current: &["--store-references"] },
    Renamed { former: &["--policy-time", "stand"], current: &["--policy-time", "paused"] },
    Renamed { former: &["--robot", "rounded"], current: &["--robot", "direct"] },
    Renamed { former: &["--without", "eyes"], current: &["--without", "detector"] },
];

/// Returns `arguments`, the first of which is the program's name, with current names, and a notice for each former one.
pub fn with_current_names(arguments: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let mut notices = Vec::new();
    let end = arguments.iter().position(|argument| argument == "--").unwrap_or(arguments.len());
    let (options, rest) = arguments.split_at(end);
    let mut arguments = options.to_vec();
    replace_command(&mut arguments, &mut notices);
    for option in &OPTIONS {
        match (option.former, option.current) {
            ([former], [current]) => replace_option(&mut arguments, (former, current), &mut notices),
            ([name, former], [_, current]) => replace_value(&mut arguments, name, (former, current), &mut notices),
            _ => {}
        }
    }
    arguments.extend_from_slice(rest);
    (arguments, notices)
}

fn notice(former: &str, current: &str) -> String {
    format!(
        "notice: {former} is now called {current}; the former name still works in this version, but not in the next one"
    )
}

/// Replaces a command's name: the first words that are neither options nor the value of `--seed`, the only option of
/// every command that has one.
fn replace_command(arguments: &mut [OsString], notices: &mut Vec<String>) {
    let is_option = |argument: &OsStr| argument.to_str().is_none_or(|text| text.starts_with('-'));
    let is_word = |at: &usize| !is_option(&arguments[*at]) && arguments[*at - 1] != "--seed";
    let words: Vec<usize> = (1..arguments.len()).filter(is_word).take(2).collect();
    for Renamed { former, current } in &COMMANDS {
        let begins = words.len() >= former.len() && former.iter().zip(&words).all(|(word, at)| arguments[*at] == *word);
        if begins {
            for (word, at) in current.iter().zip(&words) {
                arguments[*at] = OsString::from(word);
            }
            notices.push(notice(&former.join(" "), &current.join(" ")));
        }
    }
}

fn replace_option(arguments: &mut [OsString], (former, current): (&str, &str), notices: &mut Vec<String>) {
    let mut found = false;
    for argument in arguments.iter_mut().skip(1) {
        let Some(rest) = argument.to_str().and_then(|text| text.strip_prefix(former)) else { continue };
        if rest.is_empty() || rest.starts_with('=') {
            *argument = OsString::from(format!("{current}{rest}"));
            found = true;
        }
    }
    if found {
        notices.push(notice(former, current));
    }
}

/// Replaces a value of the option `name`, also within a list with commas.
fn replace_value(arguments: &mut [OsString], name: &str, (former, current): (&str, &str), notices: &mut Vec<String>) {
    let mut found = false;
    let mut list = |text: &str| {
        let items: Vec<&str> = text.split(',').map(|item| if item == former { current } else { item }).collect();
        let changed = items.join(",");
        found |= changed != text;
        changed
    };
    for at in 1..arguments.len() {
        let Some(text) = arguments[at].to_str() else { continue };
        if text == name {
            let value = arguments.get(at + 1).and_then(|value| value.to_str()).map(&mut list);
            if let Some(value) = value {
                arguments[at + 1] = OsString::from(value);
            }
        } else if let Some(value) = text.strip_prefix(name).and_then(|rest| rest.strip_prefix('=')) {
            let value = list(value);
            arguments[at] = OsString::from(format!("{name}={value}"));
        }
    }
    if found {
        notices.push(notice(&format!("{name} {former}"), &format!("{name} {current}")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(line: &str, expected: &str, notice_count: usize) {
        let words = |text: &str| text.split(' ').map(OsString::from).collect::<Vec<_>>();
        let (arguments, notices) = with_current_names(words(line));
        assert_eq!(arguments, words(expected));
        assert_eq!(notices.len(), notice_count, "{notices:?}");
    }

    #[test]
    fn former_names_are_replaced() {
        check("ftac twin excite DIR --individual 3", "ftac sysid excite DIR --instance 3", 2);
        check("ftac --seed 3 twin identify a", "ftac --seed 3 sysid identify a", 1);
        check("ftac -q grasps pick-ups --out twin", "ftac -q grasps repertoire --out twin", 1);
        check("ftac grasps plan --of a --prove", "ftac grasps pairs --pairs a --verify", 3);
        check("ftac bench --robot rounded --mirror", "ftac bench --robot direct --detect-faults", 2);
        check("ftac bench --robot=rounded --individual=a.toml", "ftac bench --robot=direct --instance=a.toml", 2);
        check("ftac bench --without pads,eyes", "ftac bench --without pads,detector", 1);
    }

    #[test]
    fn other_arguments_stay() {
        for line in
            ["ftac bench --robot sim", "ftac view twin", "ftac trial 3 --individuals 1", "ftac bench -- --mirror"]
        {
            check(line, line, 0);
        }
    }
}
