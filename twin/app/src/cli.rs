//! The command line.

mod body;
mod grasps;
mod trials;

use std::path::PathBuf;

use clap::{Parser, Subcommand};

pub use self::body::{ArmCommand, CheckArgs, CloseArgs, HandCommand};
pub use self::grasps::{GenerateArgs, GraspsCommand, RepertoireArgs, RoleArg, ShowArgs, SynthesisArgs};
pub use self::trials::{BenchArgs, Body, TrialArgs};
use crate::bridge::BridgeCommand;
use crate::transport::TransportArgs;
use crate::{optics_commands, touch_commands};

/// Digital twin of the F-TAC Hand on a Kinova Gen3 arm.
#[derive(Debug, Parser)]
#[command(name = "ftac", version, about, long_about = None)]
pub struct Cli {
    /// Print one JSON object on stdout; everything else goes to stderr.
    #[arg(long, global = true)]
    pub json: bool,
    /// Seed of everything random.
    #[arg(long, global = true, default_value_t = 1)]
    pub seed: u64,
    /// Say more.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// Say nothing but results; no progress bars.
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the multi-object benchmark under all conditions.
    Bench(BenchArgs),
    /// Run one trial and record it.
    Trial(TrialArgs),
    /// Carry balls to one place, as many at once as the hand holds, beside one by one.
    Transport(TransportArgs),
    /// Open a recording or a result folder in the Rerun viewer.
    View {
        /// An .rrd file, or a folder with recordings.
        path: PathBuf,
    },
    /// Run the control stack on a recorded session (MCAP) and say whether every command comes out identical.
    Replay {
        /// The session's file, from `trial --session DIR` or `bench --robot emulated|hardware`.
        recording: PathBuf,
        /// Instead of running anything, lay this session beside it: the first observation or command that differs by a bit.
        #[arg(long)]
        against: Option<PathBuf>,
    },
    /// Build report.html, trials.csv and summary.json again from result folders; several shards become one.
    Report {
        /// Result folders.
        #[arg(required_unless_present_any = ["study", "lab_book"])]
        folders: Vec<PathBuf>,
        /// The grasp study instead: one page from what `grasps classify`, `map`, `landscape` and `hands` left in the folder (default:
        /// recordings/study).
        #[arg(long, conflicts_with = "out")]
        study: bool,
        /// The lab book instead: BENCHMARKS.md from a table of figures (default: recordings/figures.csv). Refuses figures whose command
        /// cannot be run again; run it in the folder of the workspace.
        #[arg(
            long,
            value_name = "FIGURES",
            num_args = 0..=1,
            default_missing_value = "recordings/figures.csv",
            conflicts_with_all = ["study", "folders"]
        )]
        lab_book: Option<PathBuf>,
        /// Where the merged result goes (needed with several folders), or the page of --lab-book.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// The hand itself.
    #[command(subcommand)]
    Hand(HandCommand),
    /// The arm that carries it.
    #[command(subcommand)]
    Arm(ArmCommand),
    /// Grasps: repertoires and plans.
    #[command(subcommand)]
    Grasps(GraspsCommand),
    /// Touch: calibration of photometric stereo.
    #[command(subcommand)]
    Touch(TouchCommand),
    /// Tactile images.
    #[command(subcommand)]
    Optics(OpticsCommand),
    /// The real robot's devices, and their emulator.
    #[command(subcommand)]
    Bridge(BridgeCommand),
}

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
    },
    /// Train the network of photometric stereo on rendered presses of known shapes.
    TrainNetwork(touch_commands::TrainNetworkArgs),
    /// Measure touch on simulated grasps and presses.
    Eval(touch_commands::EvalArgs),
}

/// `optics` commands.
#[derive(Debug, Subcommand)]
pub enum OpticsCommand {
    /// Fit a real sensor's image-formation model to presses of a ball, and render presses held out.
    Calibrate(optics_commands::CalibrateArgs),
    /// Evaluate a calibration, the gel's pressure law, or the fit itself.
    Eval(optics_commands::EvalArgs),
    /// Render what a pad sees when a mesh is pressed into it along its normal.
    Render(optics_commands::RenderArgs),
    /// Render twenty known shapes onto a contact sheet.
    Shapes(optics_commands::ShapesArgs),
    /// Write the calibration files of the hand's 17 pads.
    Pads(optics_commands::PadsArgs),
}
