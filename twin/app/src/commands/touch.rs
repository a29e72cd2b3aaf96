//! `ftac touch`: calibrates photometric stereo.

use std::path::{Path, PathBuf};

use bench::builtin::CALIBRATION_UNIT;
use clap::Subcommand;
use hand_model::Hand;
use schemars::JsonSchema;
use sensor_calibration::pad_calibration;
use serde::Serialize;

use crate::lab::arguments::touch::TouchLabCommand;
use crate::lab::hand_over::LabProgram;
use crate::options::robot::{RobotArgs, instance_model};
use crate::terminal::{Outcome, Terminal};

/// `touch` commands.
#[derive(Debug, Subcommand)]
pub enum TouchCommand {
    /// Calibrate photometric stereo with presses of balls on a simulated calibration unit; evaluate on another unit.
    Train {
        /// Number of presses per camera.
        #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u16).range(1..))]
        presses: u16,
        /// Calibration file to write.
        #[arg(long)]
        out: PathBuf,
        /// Robot instance (a file of `ftac sysid identify`) that gives the stiffness and thickness of the gel; these
        /// keep the nominal values unless a session identifies them.
        #[arg(long)]
        instance: Option<PathBuf>,
        #[command(flatten)]
        robot: RobotArgs,
    },
    #[command(flatten)]
    Lab(TouchLabCommand),
}

/// JSON output of `touch train`: angle between estimated and true normals on the presses of another unit.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TrainOutput {
    /// Mean angle, degrees.
    mean_deg: f64,
    /// Median angle, degrees.
    median_deg: f64,
    /// 95th percentile, degrees.
    p95_deg: f64,
    pixels: usize,
}

/// Runs a `touch` command; those of `ftac-lab` are handed over to the `lab`.
pub fn run(terminal: &Terminal, command: &TouchCommand, lab: &LabProgram<'_>) -> Outcome {
    match command {
        TouchCommand::Train { presses, out, instance: individual, robot } => {
            let hand = instance_model(individual.as_deref(), &robot.model()?)?.hand;
            train(terminal, usize::from(*presses), out, &hand)
        }
        TouchCommand::Lab(_) => Err(lab.exec_lab()),
    }
}

fn train(terminal: &Terminal, presses: usize, out: &Path, hand: &Hand) -> Outcome {
    let (calibration, error) = pad_calibration::train(hand, CALIBRATION_UNIT, presses, terminal.seed)?;
    calibration.write(out)?;
    let text = format!(
        "angular error on another unit's presses: mean {:.2} deg, median {:.2} deg, p95 {:.2} deg over {} pixels\n",
        error.mean, error.median, error.p95, error.pixels
    );
    let trained =
        TrainOutput { mean_deg: error.mean, median_deg: error.median, p95_deg: error.p95, pixels: error.pixels };
    terminal.print(&trained, &text)?;
    Ok(None)
}
