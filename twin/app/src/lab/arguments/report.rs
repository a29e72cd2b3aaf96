//! Arguments of `ftac report`. `ftac-lab` makes the page of the grasp study and the lab book.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Result folders.
    #[arg(required_unless_present_any = ["study", "lab_book"])]
    pub folders: Vec<PathBuf>,
    /// Make the page of the grasp study instead, from the results of `grasps classify`, `map`, `landscape` and `hands`
    /// in the folder (default: recordings/study).
    #[arg(long, conflicts_with = "out")]
    pub study: bool,
    /// Make the lab book instead: BENCHMARKS.md from a table of figures (default: recordings/figures.csv). Refuses
    /// figures whose command cannot be run again; run it in the folder of the workspace.
    #[arg(
        long,
        value_name = "FIGURES",
        num_args = 0..=1,
        default_missing_value = "recordings/figures.csv",
        conflicts_with_all = ["study", "folders"]
    )]
    pub lab_book: Option<PathBuf>,
    /// Folder for the merged result (required with several folders), or file for the page of --lab-book.
    #[arg(long)]
    pub out: Option<PathBuf>,
}
