//! Arguments of `ftac touch`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use crate::options::robot::RobotArgs;

/// `touch` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum TouchLabCommand {
    /// Train the network of photometric stereo on rendered presses of known shapes.
    TrainNetwork(TrainNetworkArgs),
    /// Measure touch on simulated grasps and presses.
    Eval(EvalArgs),
}

/// What a network looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum KindArg {
    /// Sees each pixel with its surroundings.
    EncoderDecoder,
    /// Sees each pixel alone: the customary baseline.
    PerPixel,
}

/// Arguments of `touch train-network`.
#[derive(Debug, Args)]
pub struct TrainNetworkArgs {
    /// The network file (JSON) to write; the training's state goes beside it after each epoch, its loss curves at the end.
    #[arg(long)]
    pub out: PathBuf,
    /// What the network looks like.
    #[arg(long, value_enum, default_value_t = KindArg::EncoderDecoder)]
    pub kind: KindArg,
    /// Presses to render.
    #[arg(long, default_value_t = 720)]
    pub presses: usize,
    /// Squares of 48 pixels cut from each press.
    #[arg(long, default_value_t = 10)]
    pub crops: usize,
    /// Passes over all squares.
    #[arg(long, default_value_t = 20)]
    pub epochs: usize,
    /// Squares a step.
    #[arg(long, default_value_t = 128)]
    pub batch: usize,
    /// Learning rate at the start; it is halved every five epochs.
    #[arg(long, default_value_t = 0.01)]
    pub rate: f64,
    /// Go on from the state beside --out.
    #[arg(long)]
    pub resume: bool,
    /// Learn for a real sensor that `optics calibrate` described in this file, from renders of it, not for the hand's pads.
    #[arg(long)]
    pub sensor: Option<PathBuf>,
    /// Learn for a real sensor from the even-numbered of these presses of a ball.
    #[arg(long, conflicts_with = "sensor", requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub folder: Option<PathBuf>,
    /// Diameter of that ball, mm.
    #[arg(long)]
    pub ball_diameter_mm: Option<f64>,
    /// Size of a pixel of those presses' images, mm.
    #[arg(long)]
    pub pixel_mm: Option<f64>,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// Arguments of `touch eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Combinations whose first grasps are felt.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Keep the simulated grasps in this file, and use them again from there.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Grasps that are felt again under each change of the optics that touch was not trained on; 0 leaves them out.
    #[arg(long, default_value_t = 120)]
    pub changed: usize,
    /// Measure the networks in this folder instead of those that come with the program.
    #[arg(long)]
    pub networks: Option<PathBuf>,
    /// Presses of a ball into a real GelSight, as `optics calibrate` reads them; default: those of the Python package taxim, if they lie at
    /// ../shared/data/real-gelsight/taxim_gelsight. The networks that come with the program learned from that sensor; `optics calibrate` measures
    /// those that it trains for another.
    #[arg(long, requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub real: Option<PathBuf>,
    /// Diameter of that ball, mm (where the labels do not say it).
    #[arg(long, requires = "real")]
    pub ball_diameter_mm: Option<f64>,
    /// Size of a pixel of those images on the gel, mm.
    #[arg(long, requires = "real")]
    pub pixel_mm: Option<f64>,
    /// Robot of `ftac twin identify`: hand, cables, servos and arm are its, for the body as for perception; its pads' calibration is the
    /// designed one. Grasps kept by --grasps are those of another robot.
    #[arg(long, conflicts_with = "grasps")]
    pub individual: Option<PathBuf>,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Calibration of the pads by which grasps are felt: a file of `ftac touch train`, or of the hand's own pads; default: the designed
    /// pads'.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Folder for a recording and a sheet of images of the first grasp of each object.
    #[arg(long)]
    pub out: Option<PathBuf>,
}
