//! Arguments of `grasps`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use crate::study;

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
    /// Recording file; default: recordings/grasps_OBJECT.rrd, which is then opened in the Rerun viewer.
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
