//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use scenarios::record::Condition;

use crate::bench::Record;
use crate::bridge::BridgeCommand;
use crate::tactile_backend::TactileBackend;
use crate::transport::TransportArgs;
use crate::{optics_commands, study, touch_commands};

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
        #[arg(required_unless_present = "study")]
        folders: Vec<PathBuf>,
        /// The grasp study instead: one page from what `grasps classify`, `map`, `landscape` and `hands` left in the folder (default:
        /// recordings/study).
        #[arg(long, conflicts_with = "out")]
        study: bool,
        /// Where the merged result goes (needed with several folders).
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

/// Which body runs the trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Body {
    /// The simulated robot.
    Sim,
    /// The real robot, under --config; the operator is asked for the verdict.
    Hardware,
    /// The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step.
    Emulated,
    /// The simulated robot behind all that `emulated` does to commands, measurements and images, but without wires: to tell what is the devices' doing.
    Rounded,
}

impl Body {
    /// As results and recordings write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hardware => "hardware",
            Self::Emulated => "emulated",
            Self::Rounded => "rounded",
        }
    }
}

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Object combinations.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Body.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Configuration of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Scenario file; default: the built-in benchmark.
    #[arg(long)]
    pub scenario: Option<PathBuf>,
    /// Threads; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
    /// Run only shard i of n, as `i/n`.
    #[arg(long, default_value = "1/1")]
    pub shard: String,
    /// Result folder; default: recordings/bench-<n>, the next free one.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Which trials are recorded.
    #[arg(long, value_enum, default_value_t = Record::Sample)]
    pub record: Record,
    /// Factor of all of the scenario's noise, for a curve of rates over noise.
    #[arg(long, default_value_t = 1.0)]
    pub noise_scale: f64,
    /// Also run touch with less of the senses, all kinds or those named: servos_only, palm_only, fingertips, quarter_of_pads,
    /// coarse_images, points_only, true_pose.
    #[arg(long, num_args = 0.., value_delimiter = ',', value_name = "NAMES")]
    pub ablations: Option<Vec<String>>,
    /// Stream every trial to a Rerun viewer as well (one thread).
    #[arg(long)]
    pub live: bool,
    /// Where tactile images are rendered.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Go on with the interrupted run in this folder.
    #[arg(long, conflicts_with_all = ["out", "shard", "scenario"])]
    pub resume: Option<PathBuf>,
}

/// Arguments of `trial`.
#[derive(Debug, Args)]
pub struct TrialArgs {
    /// Number of the combination, from 0.
    pub combination: usize,
    /// Number of the trial, from 0.
    #[arg(long, default_value_t = 0)]
    pub trial: usize,
    /// Policy; `ideal` runs without noise.
    #[arg(long, value_enum, default_value_t = Policy::Touch)]
    pub policy: Policy,
    /// Body.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Configuration of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Folder for the session's MCAP file, for `ftac replay`; hardware always records, into recordings/sessions by default.
    #[arg(long)]
    pub session: Option<PathBuf>,
    /// Stream to a Rerun viewer.
    #[arg(long)]
    pub live: bool,
    /// Where tactile images are rendered.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Recording file; default: recordings/combination_<n>_trial_<k>_<policy>.rrd.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// What decides the second grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Policy {
    /// Without noise, as planned.
    Ideal,
    /// As planned.
    Blind,
    /// Adapts to what is felt.
    Touch,
}

impl Policy {
    /// The condition it stands for.
    pub fn condition(self) -> Condition {
        match self {
            Self::Ideal => Condition::Ideal,
            Self::Blind => Condition::Blind,
            Self::Touch => Condition::Touch,
        }
    }
}

/// `hand` commands.
#[derive(Debug, Subcommand)]
pub enum HandCommand {
    /// Check the body's figures against the paper's, in physics where they are about motion.
    Check(CheckArgs),
    /// Close any hand on a ball: a URDF and a file that says what pulls on its joints.
    Close(CloseArgs),
    /// Write scenes for a second engine, with the commands and what ours made of them.
    Export {
        /// Folder for the MJCF files and scenes.json.
        #[arg(long)]
        mjcf: PathBuf,
    },
}

/// Arguments of `hand check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Only read this URDF; it must have the hand's joints.
    #[arg(long)]
    pub urdf: Option<PathBuf>,
    /// Folder of the public model of this hand (holds urdf/f_tac_hand.urdf), to compare joint frames with; the default is seen from
    /// the folder ftac is started in.
    #[arg(long, default_value = "../shared/data/hands/ftac_public")]
    pub public_model: PathBuf,
    /// Try the 33 grasp types of Feix instead.
    #[arg(long, conflicts_with = "engine")]
    pub grasps: bool,
    /// Only these of the 33, by number.
    #[arg(long, value_delimiter = ',', requires = "grasps", value_parser = clap::value_parser!(u8).range(1..=33))]
    pub types: Vec<u8>,
    /// Attempts at each grasp type at most; the first that holds is kept.
    #[arg(long, default_value_t = 1500, value_parser = clap::value_parser!(u32).range(1..))]
    pub tries: u32,
    /// Sweep the engine's settings instead: slip, overlap, jitter and cost over time step and iterations.
    #[arg(long)]
    pub engine: bool,
    /// Folder for pictures and check.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Arguments of `hand close`.
#[derive(Debug, Args)]
pub struct CloseArgs {
    /// The hand: URDF with collision boxes, spheres, cylinders or OBJ/STL meshes.
    #[arg(long)]
    pub urdf: PathBuf,
    /// What pulls on its joints (TOML; hand-model/data/hands has two to start from).
    #[arg(long)]
    pub transmission: PathBuf,
    /// Where the ball's centre is held while the hand closes, in the root link's frame, m: x,y,z.
    #[arg(long, required = true, value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<f64>,
    /// The ball's diameter, mm.
    #[arg(long, default_value_t = 60.0)]
    pub ball_diameter_mm: f64,
    /// Tension of each actuator, N: one for all, or one each in the file's order.
    #[arg(long, value_delimiter = ',', default_value = "12", allow_hyphen_values = true)]
    pub tensions: Vec<f64>,
    /// Picture to write (PNG).
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// `arm` commands.
#[derive(Debug, Subcommand)]
pub enum ArmCommand {
    /// Check the arm: limits, gravity compensation, inverse kinematics, reach, and what it does where it cannot follow.
    Check {
        /// Folder for pictures and check.json.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}

/// A grasp's role on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RoleArg {
    /// Ring and little finger against the palm.
    First,
    /// Thumb, index and middle finger.
    Second,
}

/// What grasps are synthesized for.
#[derive(Debug, Args)]
pub struct SynthesisArgs {
    /// An object of the set.
    #[arg(long, required_unless_present = "mesh", conflicts_with = "mesh")]
    pub object: Option<String>,
    /// A mesh of your own: OBJ, in metres; one that is not watertight is rebuilt.
    #[arg(long)]
    pub mesh: Option<PathBuf>,
    /// Contact points of a sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "5")]
    pub contacts: String,
    /// Keep the hand out of the table on which the object rests.
    #[arg(long)]
    pub table: bool,
    /// Closings tried on each chain's posture until one is verified: the plain one, then varied tensions and small offsets.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
}

/// Arguments of `grasps generate`.
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// What for.
    #[command(flatten)]
    pub synthesis: SynthesisArgs,
    /// Chains, each of which may leave one grasp.
    #[arg(long, default_value_t = 512)]
    pub n: u64,
    /// Stop when so many different grasps are verified.
    #[arg(long, conflicts_with = "hand")]
    pub keep: Option<usize>,
    /// File for the verified grasps, JSON lines; it grows while the search runs.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Another hand: its URDF.
    #[arg(long, requires = "pulls", conflicts_with = "table")]
    pub hand: Option<PathBuf>,
    /// What pulls on that hand's joints: actuators and their moment arms, TOML.
    #[arg(long, requires = "hand")]
    pub pulls: Option<PathBuf>,
}

/// Arguments of `grasps repertoire`.
#[derive(Debug, Args)]
pub struct RepertoireArgs {
    /// Objects; default: all 23.
    #[arg(long)]
    pub object: Vec<String>,
    /// Verified, different grasps of each object.
    #[arg(long, default_value_t = 150)]
    pub each: usize,
    /// Contact points of a sample, taken in turn.
    #[arg(long, default_value = "2-5")]
    pub contacts: String,
    /// Closings tried on each chain's posture.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Chains at most for each object.
    #[arg(long, default_value_t = 3000)]
    pub chains: u64,
    /// Folder of the parts, one file an object; they grow while the search runs, and the same command goes on from them.
    #[arg(long, default_value = "recordings/synthesis")]
    pub parts: PathBuf,
    /// Search no further: write what the parts hold.
    #[arg(long)]
    pub pack: bool,
    /// The file to write when all are done.
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `grasps show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Object; without one, a table of all.
    pub object: Option<String>,
    /// File of grasps, from `repertoire` or `generate`; default: the built-in repertoire.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Kinds at most, the most frequent first.
    #[arg(long, default_value_t = 12)]
    pub kinds: usize,
    /// Recording file; default: recordings/grasps_<object>.rrd, which is then opened in the Rerun viewer.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Folder for grasps.html with pictures of objects and grasps, instead of a recording.
    #[arg(long, conflicts_with = "out")]
    pub report: Option<PathBuf>,
}

/// `grasps` commands.
#[derive(Debug, Subcommand)]
pub enum GraspsCommand {
    /// Find grasps for an object by sampling; each is closed by its cables, verified and held in physics.
    Generate(GenerateArgs),
    /// Measure how well synthesis works: rates, negative controls, what predicts holding.
    Eval {
        #[command(flatten)]
        synthesis: SynthesisArgs,
        /// Chains.
        #[arg(long, default_value_t = 128)]
        n: u64,
    },
    /// Make the repertoire of synthesized grasps of all objects; an interrupted run goes on where it was.
    Repertoire(RepertoireArgs),
    /// Show the best grasp of each kind: digits, contact points and friction cones, room, approach.
    Show(ShowArgs),
    /// Set hands side by side on the same objects: how often each finds a grasp that holds, with a picture sheet.
    Hands(crate::synthesis::hands::HandsArgs),
    /// Give every verified grasp one of the paper's 19 types, by rules with reasons; compare with people's labels.
    Classify(study::ClassifyArgs),
    /// Write a page, usable offline, on which people give grasps their types.
    Annotate(study::AnnotateArgs),
    /// Put contact maps on a sheet, with the boundary between power and precision grasps.
    Map(study::MapArgs),
    /// Map the energy landscape of grasps: basins, barriers and their tree. An interrupted run goes on.
    Landscape(study::LandscapeArgs),
    /// Find the benchmark's repertoire of pick-ups for the scenario's objects by rehearsing them in physics.
    Rehearse {
        /// Objects; default: all of the scenario.
        #[arg(long)]
        object: Vec<String>,
        /// Only this role; the other's grasps stay as they are.
        #[arg(long, value_enum)]
        role: Option<RoleArg>,
        /// Random proposals at most, for each object and role.
        #[arg(long, default_value_t = 128)]
        n: u32,
        /// The repertoire file to write (an existing one is extended).
        #[arg(long)]
        out: PathBuf,
    },
    /// Draw combinations by the rule and rehearse them without noise.
    Plan {
        /// Combinations.
        #[arg(long, default_value_t = 60)]
        combos: usize,
        /// Repertoire; default: the built-in one.
        #[arg(long)]
        repertoire: Option<PathBuf>,
        /// The plan file to write.
        #[arg(long)]
        out: PathBuf,
    },
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
