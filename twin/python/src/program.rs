//! The program `ftac`, for those who have installed the package alone.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs a command line, of which the first word is the program's name; the exit code. One that cannot be understood ends the process.
#[pyfunction]
pub fn run(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| ftac::run(arguments))
}
