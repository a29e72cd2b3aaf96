//! The Python that has the package `ftac`.

use std::process::Command;

use platform::child;

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
///
/// Unlike `python -m`, it finds no modules in the current folder: that may be a stranger's, with results or sessions in it.
pub fn module(module: &str) -> Command {
    let mut command = child::command(name());
    let run = format!(
        "import sys; sys.path[:] = [path for path in sys.path if path]; from runpy import run_module; \
         run_module('{module}', run_name='__main__', alter_sys=True)"
    );
    command.args(["-c", &run]);
    command
}

/// That it could not be started, for `what`.
pub fn missing(what: &str) -> String {
    format!("{what}: cannot start `{}`; {EXPECTED}", name())
}
