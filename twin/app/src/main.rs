//! `ftac`: the program people run. Commands, sessions, results, reports.
//!
//! Exit codes: 0 done and good, 1 ran but the result falls short (named on stderr), 2 bad usage or bad input.

mod arm_check;
mod bench;
mod body;
mod bridge;
mod builtin;
mod calibrate;
mod check;
mod cli;
mod commands;
mod generate;
mod hand_close;
mod journal;
mod optics_commands;
mod plan;
mod recording;
mod rehearsal;
mod replay;
mod report;
mod study;
mod synthesis;
mod tactile_backend;
mod touch_commands;
mod transport;
mod trial;
mod world;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    match commands::run(&cli) {
        Ok(None) => ExitCode::SUCCESS,
        Ok(Some(shortfall)) => {
            eprintln!("ftac: falls short: {shortfall}");
            ExitCode::from(1)
        }
        // The robot stopped in mid-trial: it ran, and fell short.
        Err(error) if error.chain().any(|cause| cause.is::<body::Stopped>()) => {
            eprintln!("ftac: falls short: {error:#}");
            ExitCode::from(1)
        }
        Err(error) => {
            eprintln!("ftac: {error:#}");
            ExitCode::from(2)
        }
    }
}
