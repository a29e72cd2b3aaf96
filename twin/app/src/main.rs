//! Entry point of the program `ftac`; everything else is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(ftac::run(std::env::args_os()))
}
