//! Hands a command over to `ftac-lab`, which replaces this process (exec).

use std::env;
use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context as _, Error, Result, bail};
use ftac_platform::child;

/// Option with which `ftac-lab` prints its identity.
pub const IDENTITY_OPTION: &str = "--identity";
/// Name of the program and of its package.
const PROGRAM_NAME: &str = "ftac-lab";
/// Command that builds it, in a checkout.
const BUILD_COMMAND: &str = "cargo build --release -p ftac-lab";

/// Access to `ftac-lab`.
#[derive(Debug)]
pub struct LabProgram<'a> {
    /// Arguments of this process, the first of which is the program's name.
    pub arguments: &'a [OsString],
    /// Returns the identity that `ftac-lab` must have.
    pub identity: fn() -> String,
}

impl LabProgram<'_> {
    /// Replaces this process by `ftac-lab` with the same arguments. It returns only if that is not possible: the
    /// program is missing, is another version, or does not start.
    pub fn exec_lab(&self) -> Error {
        let beside = env::current_exe().ok().and_then(|program| Some(program.parent()?.to_owned()));
        let path = env::var_os("PATH").unwrap_or_default();
        match find_lab_program(beside.as_deref(), env::split_paths(&path), &(self.identity)()) {
            Ok(program) => {
                let error = child::command(&program).args(self.arguments.iter().skip(1)).exec();
                Error::new(error).context(program.display().to_string())
            }
            Err(error) => error,
        }
    }
}

/// Finds the `ftac-lab` with this `identity`: in the folder `beside` this program, else on the search path.
fn find_lab_program(beside: Option<&Path>, path: impl Iterator<Item = PathBuf>, identity: &str) -> Result<PathBuf> {
    // An empty or relative entry would depend on the working directory.
    let folders = beside.map(Path::to_owned).into_iter().chain(path.filter(|folder| folder.is_absolute()));
    let Some(program) = folders.map(|folder| folder.join(PROGRAM_NAME)).find(|program| program.is_file()) else {
        bail!(
            "found no `{PROGRAM_NAME}`, which runs this command, beside this program{} or on the PATH; `{BUILD_COMMAND}` in a checkout builds it",
            beside.map_or_else(String::new, |folder| format!(" in {}", folder.display()))
        );
    };
    expect_same_build(&program, identity)?;
    Ok(program)
}

/// Refuses a program whose identity is not the `expected` one.
fn expect_same_build(program: &Path, expected: &str) -> Result<()> {
    let name = || program.display().to_string();
    let output = child::command(program).arg(IDENTITY_OPTION).stdin(Stdio::null()).output().with_context(name)?;
    let found = String::from_utf8_lossy(&output.stdout);
    let found = found.trim();
    if found != expected {
        bail!(
            "{}: identity: found {found:?}, expected {expected:?}; `{BUILD_COMMAND}` in a checkout builds the matching one",
            name()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::process::Command;

    use super::*;

    const IDENTITY: &str = "1.0.0 fedcba9876543210";

    fn place(folder: &Path, identity: &str) {
        fs::create_dir_all(folder).expect("a folder");
        let program = folder.join(PROGRAM_NAME);
        // Another process writes the file: a file that this process has open cannot be run, and another test's child
        // may keep it open.
        let script = format!("#!/bin/sh\necho '{identity}'\n");
        let write = "printf %s \"$1\" > \"$0\" && chmod +x \"$0\"";
        let written = Command::new("sh").args(["-c", write]).arg(&program).arg(script).status();
        assert!(written.expect("sh runs").success());
    }

    /// A program in the same folder comes before the search path. One of another version ends the search.
    #[test]
    fn a_neighbour_comes_first_and_another_version_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let (beside, path) = (folder.path().join("beside"), folder.path().join("path"));
        let find = || find_lab_program(Some(&beside), [PathBuf::new(), path.clone()].into_iter(), IDENTITY);
        fs::create_dir(&beside).expect("a folder");
        let missing = find().expect_err("there is none").to_string();
        assert!(missing.contains(BUILD_COMMAND) && missing.contains(&beside.display().to_string()), "{missing}");
        place(&path, IDENTITY);
        assert_eq!(find().expect("on the path"), path.join(PROGRAM_NAME));
        place(&beside, IDENTITY);
        assert_eq!(find().expect("beside"), beside.join(PROGRAM_NAME));
        place(&beside, "0.0.1 0123456789abcdef");
        let stale = find().expect_err("another version").to_string();
        assert!(stale.contains("0.0.1 0123456789abcdef") && stale.contains(BUILD_COMMAND), "{stale}");
    }
}
