//! The grasp study: the paper's second half of results, each made by one command from verified grasps.
//!
//! [`source`] reads the grasps and knows their objects; [`classify`] gives each its type, [`annotate`] writes the page on which
//! people do; the mathematics is in the crate `study`.

pub mod annotate;
pub mod classify;
mod distribution;
mod source;

use std::path::PathBuf;

use clap::Args;

/// Where the grasps come from.
#[derive(Debug, Args)]
pub struct GraspsArgs {
    /// Verified grasps: a file of `grasps generate`, or a folder of such files (repeatable).
    #[arg(long = "grasps", default_value = "recordings/synthesis")]
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
