//! The grasp study: the paper's second half of results, each made by one command from verified grasps.
//!
//! [`source`] reads the grasps and knows their objects; [`classify`] gives each its type, [`annotate`] writes the page on which
//! people do; [`map`] puts contact maps on a sheet and [`landscape`] basins and barriers on a tree; [`report`] puts all of it beside
//! the paper, row by row as [`comparison`] has it. The mathematics is in the crate `study`.

pub mod annotate;
pub mod classify;
mod comparison;
mod distribution;
pub mod landscape;
pub mod map;
pub mod report;
mod source;

use std::path::PathBuf;

use clap::Args;

/// Where the grasps come from.
#[derive(Debug, Args)]
pub struct GraspsArgs {
    /// Verified grasps: a file of `grasps repertoire` or `generate`, or a folder of such files (repeatable); default: the
    /// built-in repertoire.
    #[arg(long = "grasps", value_name = "PATH")]
    pub paths: Vec<PathBuf>,
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
    #[arg(long, value_delimiter = ',', default_value = "pawn,vase,multimeter,board_eraser,coffee_bottle,coke_can")]
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
