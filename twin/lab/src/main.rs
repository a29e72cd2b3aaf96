//! `ftac-lab`: validation, grasp analysis, training and the lab book. `ftac` hands these commands over to it.

#[macro_use]
extern crate ftac;
#[macro_use]
extern crate progress;

mod commands;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Command as Described, CommandFactory as _, Parser, Subcommand};
use ftac::cli::with_negative_numbers;
use ftac::front::{self, CommandLine};
use ftac::lab::arguments::arm::ArmCommand;
use ftac::lab::arguments::grasps::GraspsLabCommand;
use ftac::lab::arguments::hand::HandLabCommand;
use ftac::lab::arguments::report::ReportArgs;
use ftac::lab::arguments::study::StudyArgs;
use ftac::lab::arguments::touch::TouchLabCommand;
use ftac::lab::hand_over;
use ftac::lab::identity::identity;
use ftac::terminal::{Outcome, Terminal};

use self::commands::{arm, grasps, hand, report, schema, study, touch};

/// Validation of the F-TAC twin, analysis of grasps, training: commands that `ftac` hands over.
#[derive(Debug, Parser)]
#[command(name = "ftac-lab", version, about, long_about = None)]
struct Cli {
    #[command(flatten)]
    terminal: Terminal,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The page of the grasp study, or the lab book.
    Report(ReportArgs),
    /// Make the whole grasp study and its page.
    Study(StudyArgs),
    /// The hand itself.
    #[command(subcommand)]
    Hand(HandLabCommand),
    /// The arm that carries it.
    #[command(subcommand)]
    Arm(ArmCommand),
    /// Analyses of grasps.
    #[command(subcommand)]
    Grasps(GraspsLabCommand),
    /// Touch: the network of photometric stereo, and accuracy.
    #[command(subcommand)]
    Touch(TouchLabCommand),
    /// Print what a command prints with `--json`, as JSON Schema.
    Schema {
        /// The command, such as `touch eval`; without one, all.
        command: Vec<String>,
    },
}

impl CommandLine for Cli {
    fn described() -> Described {
        with_negative_numbers(Self::command())
    }

    fn terminal(&self) -> &Terminal {
        &self.terminal
    }

    fn moves_devices(&self) -> bool {
        false
    }

    fn obey(&self, _: &[OsString]) -> Outcome {
        let terminal = &self.terminal;
        match &self.command {
            Command::Report(args) => report::run(terminal, args),
            Command::Study(args) => study::all::run(terminal, args),
            Command::Hand(command) => hand::run(terminal, command),
            Command::Arm(command) => arm::run(terminal, command),
            Command::Grasps(command) => grasps::run(terminal, command),
            Command::Touch(command) => touch::run(terminal, command),
            Command::Schema { command } => schema::run(terminal, command),
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    if arguments[1..] == [hand_over::FLAG] {
        println!("{}", identity(ftac::cli::described()));
        return ExitCode::SUCCESS;
    }
    ExitCode::from(front::run::<Cli>(arguments))
}
