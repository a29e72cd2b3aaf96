//! Options that name a hand by its files: `--urdf` and `--pulls` in every command.

/// Renamed options, old and new; the old names still work.
const RENAMED_OPTIONS: [(&str, &str); 2] = [("--hand", "--urdf"), ("--transmission", "--pulls")];

/// Prints a note for each renamed option on the command line.
pub fn note_renamed_options() {
    let given: Vec<String> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    for (old, new) in renamed_options_in(&given) {
        eprintln!("note: {old} is called {new} now; both work");
    }
}

fn renamed_options_in(given: &[String]) -> Vec<(&'static str, &'static str)> {
    let is = |word: &String, old: &str| word == old || word.strip_prefix(old).is_some_and(|rest| rest.starts_with('='));
    RENAMED_OPTIONS.into_iter().filter(|(old, _)| given.iter().any(|word| is(word, old))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_are_told_once_each() {
        let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(renamed_options_in(&words("grasps generate --hand a --pulls b")), [("--hand", "--urdf")]);
        assert_eq!(renamed_options_in(&words("hand close --urdf=a --transmission=b")), [("--transmission", "--pulls")]);
        assert_eq!(renamed_options_in(&words("hand picture --handle")), []);
    }
}
