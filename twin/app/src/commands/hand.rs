//! `ftac hand`: pictures of the hand. Checks and closings are commands of `ftac-lab`.

pub mod picture;

use clap::Subcommand;

use self::picture::PictureArgs;
use crate::lab::arguments::hand::HandLabCommand;
use crate::lab::hand_over::LabProgram;
use crate::terminal::{Outcome, Terminal};

/// `hand` commands.
#[derive(Debug, Subcommand)]
pub enum HandCommand {
    #[command(flatten)]
    Lab(HandLabCommand),
    /// Draw the hand in any posture; needs no display.
    Picture(PictureArgs),
}

/// Runs a `hand` command; those of `ftac-lab` are handed over to the `lab`.
pub fn run(terminal: &Terminal, command: &HandCommand, lab: &LabProgram<'_>) -> Outcome {
    match command {
        HandCommand::Picture(args) => picture::run(terminal, args),
        HandCommand::Lab(_) => Err(lab.exec_lab()),
    }
}
