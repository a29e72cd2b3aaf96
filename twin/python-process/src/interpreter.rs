//! The Python interpreter that has the package `ftac`.

use std::process::Command;

use ftac_platform::child;

/// Environment variable that names the interpreter.
const INTERPRETER_VARIABLE: &str = "FTAC_POLICY_PYTHON";
/// Requirements on the interpreter, for error messages.
pub const INTERPRETER_REQUIREMENTS: &str =
    "expected Python with the package ftac (`pip install ./twin/python`), or its path in FTAC_POLICY_PYTHON";

/// Returns `python3`, or the interpreter that [`INTERPRETER_VARIABLE`] names.
pub fn interpreter_name() -> String {
    std::env::var(INTERPRETER_VARIABLE).unwrap_or_else(|_| "python3".to_owned())
}

/// Command that runs a module of the package.
///
/// Unlike `python -m`, it finds no modules in the current folder, which may be a stranger's, with results or sessions
/// in it.
pub fn module_command(module: &str) -> Command {
    let mut command = child::command(interpreter_name());
    let run = format!(
        "import sys; sys.path[:] = [path for path in sys.path if path]; from runpy import run_module; \
         run_module('{module}', run_name='__main__', alter_sys=True)"
    );
    command.args(["-c", &run]);
    command
}

/// Error message for an interpreter that could not be started, for `what`.
pub fn missing_interpreter(what: &str) -> String {
    format!("{what}: cannot start `{}`; {INTERPRETER_REQUIREMENTS}", interpreter_name())
}
