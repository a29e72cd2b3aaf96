//! Arguments of `ftac touch`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use crate::options::robot::RobotArgs;

/// `touch` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum TouchLabCommand {
    /// Train the neural network of photometric stereo on rendered presses of known shapes.
    TrainNetwork(TrainNetworkArgs),
    /// Evaluate tactile perception on simulated grasps and presses.
    Eval(EvalArgs),
}

/// Architecture of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum NetworkKindArg {
    /// Encoder-decoder: reads each pixel with its surroundings.
    EncoderDecoder,
    /// Per-pixel network: reads each pixel alone; the customary baseline.
    PerPixel,
}

/// Arguments of `touch train-network`.
#[derive(Debug, Args)]
pub struct TrainNetworkArgs {
    /// Network file (JSON) to write; the training state goes beside it after each epoch, the loss curves at the end.
    #[arg(long)]
    pub out: PathBuf,
    /// Architecture of the network.
    #[arg(long, value_enum, default_value_t = NetworkKindArg::EncoderDecoder)]
    pub kind: NetworkKindArg,
    /// Number of presses to render.
    #[arg(long, default_value_t = 720)]
    pub presses: usize,
    /// Number of crops of 48 x 48 pixels from each press.
    #[arg(long, default_value_t = 10)]
    pub crops: usize,
    /// Number of epochs: passes over all crops.
    #[arg(long, default_value_t = 20)]
    pub epochs: usize,
    /// Batch size: crops per step.
    #[arg(long, default_value_t = 128)]
    pub batch: usize,
    /// Initial learning rate; halved every five epochs.
    #[arg(long, default_value_t = 0.01)]
    pub rate: f64,
    /// Resume from the training state beside --out.
    #[arg(long)]
    pub resume: bool,
    /// Train for a real sensor, calibrated by `optics calibrate` in this file, from renders of it instead of the hand's
    /// pads.
    #[arg(long)]
    pub sensor: Option<PathBuf>,
    /// Train for a real sensor from the even-numbered presses of a ball in this folder.
    #[arg(long, conflicts_with = "sensor", requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub folder: Option<PathBuf>,
    /// Diameter of that ball, mm.
    #[arg(long)]
    pub ball_diameter_mm: Option<f64>,
    /// Pixel size of the images of those presses, mm.
    #[arg(long)]
    pub pixel_mm: Option<f64>,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// Arguments of `touch eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Number of combinations whose first grasps are evaluated.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Number of trials per combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// File that keeps the simulated grasps; if it exists, they are read from it.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Number of grasps evaluated again under each change of the optics that touch was not trained on; 0 skips these.
    #[arg(long, default_value_t = 120)]
    pub changed: usize,
    /// Evaluate the networks in this folder instead of the built-in ones.
    #[arg(long)]
    pub networks: Option<PathBuf>,
    /// Presses of a ball into a real GelSight, as `optics calibrate` reads them; default: none, and a real sensor is left
    /// out. The built-in networks were trained for the sensor of the Python package taxim; `optics calibrate` evaluates
    /// those that it trains for another.
    #[arg(long, requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub real: Option<PathBuf>,
    /// Diameter of that ball, mm (for presses whose label does not give it).
    #[arg(long, requires = "real")]
    pub ball_diameter_mm: Option<f64>,
    /// Pixel size of those images on the gel, mm.
    #[arg(long, requires = "real")]
    pub pixel_mm: Option<f64>,
    /// Robot instance (a file of `ftac sysid identify`) that gives hand, cables, servos and arm, for simulation and
    /// perception; its pads use the nominal calibration. Grasps kept by --grasps are those of another robot.
    #[arg(long, conflicts_with = "grasps")]
    pub instance: Option<PathBuf>,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Calibration of the tactile pads: a file of `ftac touch train`, or of the hand's own pads; default: that of the
    /// nominal pads.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Folder for a recording and a sheet of images of the first grasp of each object.
    #[arg(long)]
    pub out: Option<PathBuf>,
}
