//! End-to-end tests of `ftac`: they run the built program as a user would and look at what it prints and leaves behind.
//!
//! This library holds only what all of them need: the program and `ftac-lab` beside it, built once, and a run of it. What a run prints with `--json` is held
//! against the schema that the program gives for it.

mod schema;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The workspace's root: where Cargo says that it is now, because a test may have been compiled for another clone that shares
/// the target folder.
pub fn root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        Path::new(&package).parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf)
    })
}

/// The release build of `ftac`, with `ftac-lab` beside it, built first where they are not up to date: Cargo builds no other package's binary for
/// a test.
///
/// # Panics
/// If they cannot be built; without them no test here can say anything.
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

/// Takes what cargo tells a test about its package out of a build's environment: with it build scripts that look at it (ring's) would run
/// again, and with them everything that hangs on them be built again, here and at the user's next build.
pub fn forget_package(build: &mut Command) {
    for (name, _) in std::env::vars_os() {
        let known = name.to_string_lossy();
        if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_CRATE_", "CARGO_PRIMARY_"].iter().any(|p| known.starts_with(p)) {
            build.env_remove(&name);
        }
    }
}

/// The target folder of the build this test belongs to: the test is `<target>/release/deps/<name>`.
pub fn target_dir() -> PathBuf {
    let test = std::env::current_exe().unwrap_or_default();
    test.ancestors().nth(3).map(Path::to_path_buf).unwrap_or_else(|| root().join("target"))
}

/// A command that runs `ftac` from the workspace's root.
pub fn ftac(arguments: &[&str]) -> Command {
    let mut command = Command::new(binary());
    // Tests leave the user's log of devices alone.
    command.args(arguments).current_dir(root()).env("FTAC_LOG", "");
    command
}

/// Runs `ftac` to its end.
///
/// # Panics
/// If it cannot be started, or prints with `--json` what its schema does not have.
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

/// What a run wrote to stderr.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Data that is not part of this repository: `shared/data/<path>` beside the clone, or the folder that `FTAC_SHARED_DATA` names.
/// `None` where it is missing, which is said on stderr past the test harness.
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
