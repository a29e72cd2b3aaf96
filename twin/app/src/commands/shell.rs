//! `ftac completions` and `ftac man`: shell completions and manual pages.

use std::path::Path;

use anyhow::Context as _;
use clap::Command;
use clap_complete::Shell;

use crate::terminal::Outcome;

/// Prints the completion script of `program`.
pub fn print_completions(shell: Shell, mut program: Command) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut program, "ftac", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    Ok(None)
}

/// Writes a manual page for each command of `program`.
pub fn write_manual(folder: &Path, program: Command) -> Outcome {
    std::fs::create_dir_all(folder).with_context(|| format!("--out: cannot create {}", folder.display()))?;
    clap_mangen::generate_to(program, folder).with_context(|| format!("--out: {}", folder.display()))?;
    Ok(None)
}
