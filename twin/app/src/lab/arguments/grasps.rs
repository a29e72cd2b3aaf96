//! Arguments of the analyses of `ftac grasps`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::options::object_name::object_name;

/// `grasps` commands that `ftac-lab` runs.
#[derive(Debug, Subcommand)]
pub enum GraspsLabCommand {
    /// Set hands side by side on the same objects: how often each finds a grasp that holds, with a picture sheet.
    Hands(HandsArgs),
    /// Give every verified grasp one of the paper's 19 types, by rules with reasons; compare with people's labels.
    Classify(ClassifyArgs),
    /// Write a page, usable offline, on which people give grasps their types.
    Annotate(AnnotateArgs),
    /// Put contact maps on a sheet, with the boundary between power and precision grasps.
    Map(MapArgs),
    /// Map the energy landscape of grasps: basins, barriers and their tree. An interrupted run goes on.
    Landscape(LandscapeArgs),
}

/// Says the plans that come with the program in the place of a file.
pub const BUILT_IN: &str = "built-in";

/// Where the grasps come from.
#[derive(Debug, Clone, Args)]
pub struct GraspsArgs {
    /// Verified grasps: a file of `grasps collection` or `generate`, or a folder of such files (repeatable); default: the
    /// built-in collection.
    #[arg(long = "grasps", value_name = "PATH")]
    pub paths: Vec<PathBuf>,
}

/// Arguments of `grasps hands`.
#[derive(Debug, Args)]
pub struct HandsArgs {
    /// Another hand beside ours: its URDF (repeatable).
    #[arg(long = "urdf", alias = "hand", value_name = "URDF")]
    pub hand: Vec<PathBuf>,
    /// What pulls on that hand's joints, TOML: one for each --urdf, in the same order.
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
    /// Chains for each hand and object, each of which may leave one grasp.
    #[arg(long, default_value_t = 12)]
    pub n: u64,
    /// Contact points of a sample: a number, or a range taken in turn, such as 2-5.
    #[arg(long, default_value = "4")]
    pub contacts: String,
    /// Closings tried on each chain's posture until one is verified.
    #[arg(long, default_value_t = 8)]
    pub closings: usize,
    /// Folder for hands.json, hands.png and the cells; the same command goes on from it.
    #[arg(long, default_value = "recordings/study")]
    pub out: PathBuf,
}

/// Arguments of `grasps classify`.
#[derive(Debug, Args)]
pub struct ClassifyArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Say why this grasp (`object/chain`) has its type, condition by condition.
    #[arg(long)]
    pub explain: Option<String>,
    /// Labels exported by the annotation page: agreement with the rules, and between annotators (repeatable).
    #[arg(long)]
    pub labels: Vec<PathBuf>,
    /// Folder for types.svg and classes.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// File for a collection chosen from the grasps: as many as can be had with the shares in which people hold things, objects in turn.
    #[arg(long, value_name = "FILE")]
    pub like_people: Option<PathBuf>,
    /// The pick-ups of the benchmark's plans instead, as they hold their objects in trials without errors; of this plan file, or the built-in one.
    #[arg(
        long,
        value_name = "FILE",
        num_args = 0..=1,
        default_missing_value = BUILT_IN,
        conflicts_with_all = ["paths", "explain", "labels", "out", "like_people"]
    )]
    pub plans: Option<PathBuf>,
}

/// Arguments of `grasps annotate`.
#[derive(Debug, Args)]
pub struct AnnotateArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Grasps on the page at most, taken evenly from all; default: all.
    #[arg(long)]
    pub n: Option<usize>,
    /// The page to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `grasps map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Grasps on the map at most, by farthest-point sampling.
    #[arg(long, default_value_t = 1000)]
    pub n: usize,
    /// Maps from so many seeds, for the figures' stability; the first is drawn.
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
    /// Grasps of each object at most.
    #[arg(long, default_value_t = 150)]
    pub each: usize,
    /// Temperature of the chains, in units of the energy.
    #[arg(long, default_value_t = 0.1)]
    pub temperature: f64,
    /// Pull (alpha); default: calibrated to the metastability threshold.
    #[arg(long)]
    pub pull: Option<f64>,
    /// Count basins over temperature, pull and seeds as well, on so many minima.
    #[arg(long)]
    pub sweep: Option<usize>,
    /// Folder for landscape.html, landscape.svg, landscape.json and the journal; the same command goes on from it.
    #[arg(long, default_value = "recordings/study/landscape")]
    pub out: PathBuf,
}
