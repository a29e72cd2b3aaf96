//! `ftac touch`: photometric stereo is trained, and touch is measured from images to poses.

mod eval;
mod train_network;

use std::path::{Path, PathBuf};

use bench::builtin::CALIBRATION_UNIT;
use clap::Subcommand;
use hand_model::Hand;
use sensor_calibration::pad_calibration;

use self::eval::EvalArgs;
use self::train_network::TrainNetworkArgs;
use crate::options::robot::{RobotArgs, individual_of};
use crate::terminal::{Outcome, Terminal};

/// `touch` commands.
#[derive(Debug, Subcommand)]
pub enum TouchCommand {
    /// Fit photometric stereo to presses of balls on a simulated calibration unit; evaluate on another unit.
    Train {
        /// Presses of each camera.
        #[arg(long, default_value_t = 24)]
        presses: usize,
        /// The calibration file to write.
        #[arg(long)]
        out: PathBuf,
        /// Robot of `ftac twin identify`: its gel's stiffness and thickness are taken, which keep the drawing's values as long as no
        /// session shows them.
        #[arg(long)]
        individual: Option<PathBuf>,
        #[command(flatten)]
        robot: RobotArgs,
    },
    /// Train the network of photometric stereo on rendered presses of known shapes.
    TrainNetwork(TrainNetworkArgs),
    /// Measure touch on simulated grasps and presses.
    Eval(EvalArgs),
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &TouchCommand) -> Outcome {
    match command {
        TouchCommand::Train { presses, out, individual, robot } => {
            let hand = individual_of(individual.as_deref(), &robot.model()?)?.hand;
            touch_train(terminal, *presses, out, &hand)
        }
        TouchCommand::TrainNetwork(args) => train_network::train_network(terminal, args),
        TouchCommand::Eval(args) => eval::eval(terminal, args),
    }
}

fn touch_train(terminal: &Terminal, presses: usize, out: &Path, hand: &Hand) -> Outcome {
    let (calibration, error) = pad_calibration::train(hand, CALIBRATION_UNIT, presses, terminal.seed)?;
    calibration.write(out)?;
    if terminal.json {
        println!(
            "{}",
            serde_json::json!({"mean_deg": error.mean, "median_deg": error.median, "p95_deg": error.p95, "pixels": error.pixels})
        );
    } else {
        println!(
            "angular error on another unit's presses: mean {:.2} deg, median {:.2} deg, p95 {:.2} deg over {} pixels",
            error.mean, error.median, error.p95, error.pixels
        );
    }
    Ok(None)
}
