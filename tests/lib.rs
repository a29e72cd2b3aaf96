//! End-to-end tests of `ftac`: they run the built program as a user would and check its output and files.
//!
//! This library holds only what all tests share: the program with `ftac-lab` beside it, built once, and a run of it.
//! The `--json` output of a run is validated against the schema that the program gives for it.

mod schema;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Returns the workspace's root according to Cargo at run time, because a test may have been compiled for another clone
/// that shares the target folder.
pub fn root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        Path::new(&package).parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf)
    })
}

/// Returns the release build of `ftac`, with `ftac-lab` beside it. Both are built first if they are not up to date:
/// Cargo builds no other package's binary for a test.
///
/// # Panics
/// If they cannot be built.
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        let mut build = Command::new(env!("CARGO"));
        build
            .args(["build", "--release", "--quiet"])
            .args(["--package", "ftac", "--bin", "ftac", "--package", "ftac-lab", "--bin", "ftac-lab", "--target-dir"])
            .arg(target_dir())
            .current_dir(root());
        forget_package(&mut build);
        let built = build.status();
        assert!(built.as_ref().is_ok_and(|status| status.success()), "ftac and ftac-lab do not build: {built:?}");
        target_dir().join("release/ftac")
    })
}

/// Removes the variables with which cargo describes the test's package from the environment of a build. Otherwise build
/// scripts that read them (ring's) would run again, and everything that depends on them would be rebuilt, here and at
/// the user's next build.
pub fn forget_package(build: &mut Command) {
    for (name, _) in std::env::vars_os() {
        let known = name.to_string_lossy();
        if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_CRATE_", "CARGO_PRIMARY_"].iter().any(|p| known.starts_with(p)) {
            build.env_remove(&name);
        }
    }
}

/// Returns the target folder of this test's build: the test is `<target>/release/deps/<name>`.
pub fn target_dir() -> PathBuf {
    let test = std::env::current_exe().unwrap_or_default();
    test.ancestors().nth(3).map(Path::to_path_buf).unwrap_or_else(|| root().join("target"))
}

/// Returns a command that runs `ftac` from the workspace's root.
pub fn ftac(arguments: &[&str]) -> Command {
    let mut command = Command::new(binary());
    // Tests do not write to the user's device log.
    command.args(arguments).current_dir(root()).env("FTAC_LOG", "");
    command
}

/// Runs `ftac` to its end.
///
/// # Panics
/// If it cannot be started, or its `--json` output does not match its schema.
pub fn run(arguments: &[&str]) -> Output {
    let output = match ftac(arguments).output() {
        Ok(output) => output,
        Err(error) => panic!("{}: {error}", binary().display()),
    };
    if arguments.contains(&"--json") {
        schema::check(arguments, &output.stdout);
    }
    output
}

/// Returns the stderr of a run.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Returns the path of data that is not part of this repository: `shared/data/<path>` beside the clone, or below the
/// folder that `FTAC_SHARED_DATA` names. `None` if it is missing, with a note on stderr past the test harness.
///
/// # Panics
/// If it is missing and `FTAC_SHARED=required`, as in `.ci/run`.
pub fn shared_data(path: &str) -> Option<PathBuf> {
    use std::io::Write as _;
    let folder = std::env::var_os("FTAC_SHARED_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let found = folder.join(path);
    if found.exists() {
        return Some(found);
    }
    let text = format!("LEFT OUT: {} is not there; what needs it was not tested", found.display());
    assert!(std::env::var_os("FTAC_SHARED").is_none_or(|value| value != "required"), "{text}");
    // Not eprintln: the harness would show it for failed tests only.
    let _ = writeln!(std::io::stderr(), "{text}");
    None
}
