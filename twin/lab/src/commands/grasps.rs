//! `ftac grasps`: analyses of grasps.

use ftac::lab::arguments::grasps::GraspsLabCommand;
use ftac::terminal::{Outcome, Terminal};

use super::study::{annotate, classify, hands, landscape, map};

/// Runs a command.
pub fn run(terminal: &Terminal, command: &GraspsLabCommand) -> Outcome {
    match command {
        GraspsLabCommand::Hands(args) => hands::run(terminal, args),
        GraspsLabCommand::Classify(args) => classify::run(terminal, args),
        GraspsLabCommand::Annotate(args) => annotate::run(terminal, args),
        GraspsLabCommand::Map(args) => map::run(terminal, args),
        GraspsLabCommand::Landscape(args) => landscape::run(terminal, args),
    }
}
