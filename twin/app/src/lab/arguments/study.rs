//! Arguments of `ftac study`.

use std::path::PathBuf;

use clap::Args;

use super::grasps::GraspsArgs;

/// Arguments of `study`.
#[derive(Debug, Args)]
pub struct StudyArgs {
    #[command(flatten)]
    pub grasps: GraspsArgs,
    /// Run in full size instead of a quick run: 150 grasps of each object in the landscape and its sweep, 12 chains
    /// for each hand and object.
    #[arg(long)]
    pub full: bool,
    /// URDF of another hand for the comparison (repeatable).
    #[arg(long = "urdf", alias = "hand", value_name = "URDF")]
    pub hand: Vec<PathBuf>,
    /// Transmission of that hand (TOML: actuators and their moment arms): one for each --urdf, in the same order.
    #[arg(long, alias = "transmission")]
    pub pulls: Vec<PathBuf>,
    /// Folder for study.html and all parts; the same command resumes from it [default: recordings/study, with --full
    /// recordings/study-full].
    #[arg(long)]
    pub out: Option<PathBuf>,
}
