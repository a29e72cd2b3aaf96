//! `ftac`: the program people run. Commands, sessions, results, reports.
//!
//! It is a library so that the Python package brings the same program, and so that `ftac-lab` shares its [command line](cli), its
//! [terminal] and its [way to an exit code](front).

// What is printed may hold text of others: `eprintln!` of this crate and the macros below make it printable.
#[macro_use]
extern crate progress;

/// The standard library's `print` and `println` end the program with a panic where stdout is gone: these do not.
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
pub mod front;
pub mod json_schema;
pub mod lab;
mod log_file;
pub mod options;
pub mod terminal;

pub use commands::schema;

use std::ffi::OsString;

/// Runs the command line `arguments` of `ftac`, of which the first is the program's name, and returns the exit code. A command of `ftac-lab`
/// does not return: that program takes the place of this process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    front::run::<cli::Cli>(arguments)
}
