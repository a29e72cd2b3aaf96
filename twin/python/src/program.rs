//! The program `ftac`, included in the package.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs a command line, the first word of which is the program's name, and returns the exit code.
#[pyfunction]
pub fn run(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| ftac::run(arguments))
}
