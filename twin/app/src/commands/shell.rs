//! `ftac completions` and `ftac man`: what a shell and `man` know of the commands.

use std::path::Path;

use anyhow::Context as _;
use clap_complete::Shell;

use crate::cli::described;
use crate::terminal::Outcome;

/// Prints the script.
pub fn completions(shell: Shell) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut described(), "ftac", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    Ok(None)
}

/// A page for each command.
pub fn manual(folder: &Path) -> Outcome {
    std::fs::create_dir_all(folder).with_context(|| format!("--out: cannot create {}", folder.display()))?;
    clap_mangen::generate_to(described(), folder).with_context(|| format!("--out: {}", folder.display()))?;
    Ok(None)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Each command stands in one group of the help, with what it is for.
    #[test]
    fn every_command_is_in_the_help() {
        let mut command = described();
        let help = command.render_help().to_string();
        let names: BTreeSet<String> = command.get_subcommands().map(|found| found.get_name().to_owned()).collect();
        for name in &names {
            assert_eq!(help.matches(&format!("\n  {name} ")).count(), 1, "{name}:\n{help}");
        }
        assert!(names.len() > 10, "{names:?}");
    }

    #[test]
    fn every_command_has_a_page() {
        let folder = tempfile::tempdir().expect("a folder");
        manual(folder.path()).expect("written");
        let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("a page");
        assert!(page("ftac.1").contains("bench") && page("ftac-bench.1").contains("noise\\-scale"));
    }
}
