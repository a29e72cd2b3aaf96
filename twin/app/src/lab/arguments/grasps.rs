//! Arguments of the analysis commands of `ftac grasps`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::options::object_name::object_name;

/// `grasps` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum GraspsLabCommand {
    /// Compare hands on the same objects: how often each finds a grasp that holds, with a sheet of pictures.
    Hands(HandsArgs),
    /// Classify every verified grasp as one of the paper's 19 types, by rules with reasons; compare with human labels.
    Classify(ClassifyArgs),
    /// Write a page, usable offline, on which people label the types of grasps.
    Annotate(AnnotateArgs),
    /// Embed contact maps in a plane (map), with the boundary between power and precision grasps.
    Map(MapArgs),
    /// Map the energy landscape of grasps: basins, barriers and their tree. Resumes if interrupted.
    Landscape(LandscapeArgs),
}

/// Value of --pairs for the built-in grasp pair table.
pub const BUILT_IN_PLANS: &str = "built-in";

/// Source of the grasps.
#[derive(Debug, Clone, Args)]
pub struct GraspsArgs {
    /// Verified grasps: a file of `grasps collection` or `grasps generate`, or a folder of such files (repeatable);
    /// default: the built-in collection.
    #[arg(long = "grasps", value_name = "PATH")]
    pub paths: Vec<PathBuf>,
}

/// Arguments of `grasps hands`.
#[derive(Debug, Args)]
pub struct HandsArgs {
    /// URDF of another hand for the comparison (repeatable).
    #[arg(long = "urdf", alias = "hand", value_name = "URDF")]
    pub hand: Vec<PathBuf>,
    /// Transmission of that hand (TOML: actuators and their moment arms): one for each --urdf, in the same order.
    #[arg(long, alias = "transmission")]
    pub pulls: Vec<PathBuf>,
    /// Objects, separated by commas.
    #[arg(
        long,
        value_delimiter = ',',
        value_parser = object_name,
        default_value = "golf_ball,tennis_ball,box_50,can_66,pawn,vase,coke_can,multimeter"
    )]
    pub objects: Vec<String>,
    /// Number of chains for each hand and object, each of which may yield one grasp.
    #[arg(long, default_value_t = 12)]
    pub n: u64,
    /// Contact points per sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "4")]
    pub contacts: String,
    /// Number of closings tried on the posture of each chain until one is verified.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Folder for hands.json, hands.png and the table's cells; the same command resumes from it.
    #[arg(long, default_value = "recordings/study")]
    pub out: PathBuf,
}

/// Arguments of `grasps classify`.
#[derive(Debug, Args)]
pub struct ClassifyArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Explain the type of this grasp (`object/chain`), condition by condition.
    #[arg(long)]
    pub explain: Option<String>,
    /// Labels exported by the annotation page, for agreement with the rules and between annotators (repeatable).
    #[arg(long)]
    pub labels: Vec<PathBuf>,
    /// Folder for types.svg and classes.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// File for a subset of the grasps with the type shares of human grasping: as many grasps as possible, taken from
    /// the objects in turn.
    #[arg(long, value_name = "FILE")]
    pub like_people: Option<PathBuf>,
    /// Classify the grasps of the benchmark's grasp pair table instead, as they hold their objects in trials without
    /// errors; from this file, or the built-in one.
    #[arg(
        long,
        value_name = "FILE",
        num_args = 0..=1,
        default_missing_value = BUILT_IN_PLANS,
        conflicts_with_all = ["paths", "explain", "labels", "out", "like_people"]
    )]
    pub pairs: Option<PathBuf>,
}

/// Arguments of `grasps annotate`.
#[derive(Debug, Args)]
pub struct AnnotateArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Maximum number of grasps on the page, taken evenly from all; default: all.
    #[arg(long)]
    pub n: Option<usize>,
    /// File for the page.
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `grasps map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Maximum number of grasps on the map, chosen by farthest-point sampling.
    #[arg(long, default_value_t = 1000)]
    pub n: usize,
    /// Number of seeds, each of which gives a map, to show the stability of the figures; the first map is drawn.
    #[arg(long, default_value_t = 5)]
    pub seeds: u64,
    /// Folder for map.html, map.svg and map.json.
    #[arg(long, default_value = "recordings/study")]
    pub out: PathBuf,
}

/// Arguments of `grasps landscape`.
#[derive(Debug, Args)]
pub struct LandscapeArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Objects, separated by commas; default: the paper's six.
    #[arg(long, value_delimiter = ',', value_parser = object_name, default_value = "pawn,vase,multimeter,board_eraser,coffee_bottle,coke_can")]
    pub objects: Vec<String>,
    /// Maximum number of grasps per object.
    #[arg(long, default_value_t = 150)]
    pub each: usize,
    /// Temperature of the chains, in units of the energy.
    #[arg(long, default_value_t = 0.1)]
    pub temperature: f64,
    /// Pull (alpha); default: calibrated to the metastability threshold.
    #[arg(long)]
    pub pull: Option<f64>,
    /// Also count basins over temperature, pull and seeds, on this many minima.
    #[arg(long)]
    pub sweep: Option<usize>,
    /// Folder for landscape.html, landscape.svg, landscape.json and the journal; the same command resumes from it.
    #[arg(long, default_value = "recordings/study/landscape")]
    pub out: PathBuf,
}
