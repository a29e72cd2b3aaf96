//! `ftac grasps export`: exports held grasps as scenes for a second engine, to close and shake them there.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use grasp_verification::synthesis::export;
use grasp_verification::synthesis::grasp_file::GraspFile;
use hand_model::RobotModel;
use schemars::JsonSchema;
use serde::Serialize;

use crate::options::object_name::object_name;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Object whose grasps are exported.
    #[arg(value_parser = object_name)]
    pub object: String,
    /// Export only the grasp of this chain.
    #[arg(long)]
    pub chain: Option<u64>,
    /// Maximum number of grasps, in the file's order.
    #[arg(long, default_value_t = 10)]
    pub n: usize,
    /// Grasp file of `collection` or `generate`; default: the built-in collection.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Folder for the results: an MJCF scene and a JSON file with commands and test for each grasp.
    #[arg(long)]
    pub mjcf: PathBuf,
}

/// JSON output of `grasps export`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct GraspExportOutput {
    /// Files written: scene and commands of each grasp.
    files: Vec<[PathBuf; 2]>,
}

/// Runs `ftac grasps export`.
pub fn run(terminal: &Terminal, args: &ExportArgs) -> Outcome {
    ensure!(args.n > 0, "--n: found 0, expected at least 1");
    let file = GraspFile::read_or_built_in(args.grasps.as_deref(), RobotModel::ftac_gen3().hand)?;
    let grasps = file.collection.for_object(&args.object).map_or(&[][..], |entry| &entry.grasps);
    ensure!(!grasps.is_empty(), "OBJECT: found no grasp of `{}`, expected some", args.object);
    let object = file.model(&args.object)?;
    let wanted = grasps.iter().filter(|grasp| args.chain.is_none_or(|chain| chain == grasp.chain));
    let written = wanted.take(args.n).map(|grasp| export::write(&file.hand, &object, grasp, &args.mjcf));
    let files: Vec<[PathBuf; 2]> =
        written.collect::<Result<_>>().with_context(|| format!("--mjcf {}", args.mjcf.display()))?;
    if let (true, Some(chain)) = (files.is_empty(), args.chain) {
        let known: Vec<String> = grasps.iter().take(5).map(|grasp| grasp.chain.to_string()).collect();
        bail!("--chain: found {chain}, expected one of {} such as {}", grasps.len(), known.join(", "));
    }
    let text =
        format!("{} grasps in {}; `python3 tests/mujoco/shake.py {1}` shakes them\n", files.len(), args.mjcf.display());
    terminal.print(&GraspExportOutput { files }, &text)?;
    Ok(None)
}
