//! `ftac`: the user's program with its commands, sessions, results and reports.
//!
//! It is a library so that the Python package can include the same program, and so that `ftac-lab` shares its [command
//! line](cli), its [terminal] and its [front end](front), which ends in the exit code.

// Printed text may come from third parties: the `eprintln!` of this crate and the macros below make it printable (no
// control characters).
#[macro_use]
extern crate progress;

/// Replacement of the standard `print` and `println`, which panic when stdout is closed: these do not.
#[macro_export]
macro_rules! print {
    ($($text:tt)*) => { $crate::terminal::write_printable(&format!($($text)*)) };
}
#[macro_export]
macro_rules! println {
    () => { $crate::terminal::write_printable("\n") };
    ($($text:tt)*) => { $crate::terminal::write_printable(&format!("{}\n", format_args!($($text)*))) };
}

pub mod cli;
mod commands;
mod former_names;
pub mod front;
pub mod json_schema;
pub mod lab;
mod log_file;
pub mod options;
pub mod terminal;

pub use commands::replay::{read_task, session_bench};
pub use commands::{reference, schema};

use std::ffi::OsString;

/// Runs the command line `arguments` of `ftac`, the first of which is the program's name, and returns the exit code. A
/// command of `ftac-lab` does not return: that program replaces this process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    front::run::<cli::Cli>(arguments)
}
