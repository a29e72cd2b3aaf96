//! `ftac touch`: trains the network for photometric stereo, and evaluates touch from images to poses.

mod eval;
pub mod train_network;

use ftac::lab::arguments::touch::TouchLabCommand;
use ftac::terminal::{Outcome, Terminal};

/// Runs a command.
pub fn run(terminal: &Terminal, command: &TouchLabCommand) -> Outcome {
    match command {
        TouchLabCommand::TrainNetwork(args) => train_network::train_network(terminal, args),
        TouchLabCommand::Eval(args) => eval::eval(terminal, args),
    }
}
