//! `ftac hand`: pictures of the hand; checks and closings are those of `ftac-lab`.

pub mod picture;

use clap::Subcommand;

use self::picture::PictureArgs;
use crate::lab::arguments::hand::HandLabCommand;
use crate::lab::hand_over::Lab;
use crate::terminal::{Outcome, Terminal};

/// `hand` commands.
#[derive(Debug, Subcommand)]
pub enum HandCommand {
    #[command(flatten)]
    Lab(HandLabCommand),
    /// Draw the hand in any posture, without a screen.
    Picture(PictureArgs),
}

/// Runs a command; the `lab` has its own.
pub fn run(terminal: &Terminal, command: &HandCommand, lab: &Lab<'_>) -> Outcome {
    match command {
        HandCommand::Picture(args) => picture::run(terminal, args),
        HandCommand::Lab(_) => Err(lab.hand_over()),
    }
}
