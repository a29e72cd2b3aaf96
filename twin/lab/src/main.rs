//! `ftac-lab`: validation, grasp analysis, training and the lab book. Run by `ftac` for these commands.

#[macro_use]
extern crate ftac;
#[macro_use]
extern crate progress;

mod commands;

use std::ffi::OsString;
use std::path::PathBuf;
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

/// Validation of the F-TAC Hand, analysis of grasps, training: commands run by `ftac`.
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
    /// Make the page of the grasp study, or the lab book.
    Report(ReportArgs),
    /// Run the whole grasp study and make its page.
    Study(StudyArgs),
    /// Check, close and export the hand.
    #[command(subcommand)]
    Hand(HandLabCommand),
    /// Check the arm that carries the hand.
    #[command(subcommand)]
    Arm(ArmCommand),
    /// Analyse grasps.
    #[command(subcommand)]
    Grasps(GraspsLabCommand),
    /// Train the network for photometric stereo, and evaluate touch.
    #[command(subcommand)]
    Touch(TouchLabCommand),
    /// Write the reference pages of the book.
    #[command(hide = true)]
    Reference {
        /// Folder for the pages.
        #[arg(long)]
        out: PathBuf,
    },
    /// Print the JSON Schema of a command's `--json` output.
    Schema {
        /// Command, such as `touch eval`; default: all commands.
        command: Vec<String>,
    },
}

impl CommandLine for Cli {
    fn definition() -> Described {
        with_negative_numbers(Self::command())
    }

    fn terminal(&self) -> &Terminal {
        &self.terminal
    }

    fn moves_devices(&self) -> bool {
        false
    }

    fn execute(&self, _: &[OsString]) -> Outcome {
        let terminal = &self.terminal;
        match &self.command {
            Command::Report(args) => report::run(terminal, args),
            Command::Study(args) => study::all::run(terminal, args),
            Command::Hand(command) => hand::run(terminal, command),
            Command::Arm(command) => arm::run(terminal, command),
            Command::Grasps(command) => grasps::run(terminal, command),
            Command::Touch(command) => touch::run(terminal, command),
            Command::Schema { command } => schema::run(terminal, command),
            Command::Reference { out } => schema::reference(out),
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    if arguments[1..] == [hand_over::IDENTITY_OPTION] {
        println!("{}", identity(ftac::cli::command_definition()));
        return ExitCode::SUCCESS;
    }
    ExitCode::from(front::run::<Cli>(arguments))
}
