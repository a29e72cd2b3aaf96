//! `ftac`: the program people run. Commands, sessions, results, reports.
//!
//! Exit codes: 0 done and good, 1 ran but the result falls short (named on stderr), 2 bad usage or bad input, 130 interrupted with Ctrl-C:
//! what is finished is kept.

mod cli;
mod commands;
mod terminal;

use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::parse();
    match cli::run(&cli) {
        Ok(None) => ExitCode::SUCCESS,
        Ok(Some(shortfall)) => {
            eprintln!("ftac: falls short: {shortfall}");
            ExitCode::from(1)
        }
        // The robot stopped in mid-trial: it ran, and fell short.
        Err(error) if error.chain().any(|cause| cause.is::<bench::body::Stopped>()) => {
            eprintln!("ftac: falls short: {error:#}");
            ExitCode::from(1)
        }
        Err(error) if error.chain().any(|cause| cause.is::<bench::run::Interrupted>()) => {
            eprintln!("ftac: {error:#}");
            ExitCode::from(130)
        }
        Err(error) => {
            eprintln!("ftac: {error:#}");
            ExitCode::from(2)
        }
    }
}
