//! The Python that has the package `ftac`.

use std::process::Command;

/// Names it.
const VARIABLE: &str = "FTAC_POLICY_PYTHON";
/// What it must have.
pub const EXPECTED: &str =
    "expected Python with the package ftac (`pip install ./twin/python`), or its path in FTAC_POLICY_PYTHON";

/// `python3`, or whatever [`VARIABLE`] names.
pub fn name() -> String {
    std::env::var(VARIABLE).unwrap_or_else(|_| "python3".to_owned())
}

/// Runs a module of the package.
pub fn module(module: &str) -> Command {
    let mut command = Command::new(name());
    command.args(["-m", module]);
    command
}

/// That it could not be started, for `what`.
pub fn missing(what: &str) -> String {
    format!("{what}: cannot start `{}`; {EXPECTED}", name())
}
