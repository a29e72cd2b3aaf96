//! `ftac grasps export`: held grasps as scenes for a second engine, to close and shake them there.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use hand_model::Hand;
use proving::synthesis::{collection, export};
use scenarios::objects::ObjectSet;
use serde_json::json;

use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Object of the set.
    pub object: String,
    /// Only the grasp of this chain.
    #[arg(long)]
    pub chain: Option<u64>,
    /// Grasps at most, in the file's order.
    #[arg(long, default_value_t = 10)]
    pub n: usize,
    /// File of grasps, from `collection` or `generate`; default: the built-in collection.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Folder for an MJCF scene and a JSON file with commands and test for each grasp.
    #[arg(long)]
    pub mjcf: PathBuf,
}

/// `ftac grasps export`.
pub fn run(terminal: &Terminal, args: &ExportArgs) -> Outcome {
    ensure!(args.n > 0, "--n: found 0, expected at least 1");
    let collection = collection::read_or_built_in(args.grasps.as_deref())?;
    let set = ObjectSet::repertoire();
    let Some(object) = set.get(&args.object) else {
        bail!("OBJECT: found `{}`, expected one of {}", args.object, set.names().join(", "));
    };
    let Some(entry) = collection.of(&args.object) else {
        bail!("OBJECT: found no grasp of `{}`, expected some", args.object);
    };
    let wanted = entry.grasps.iter().filter(|grasp| args.chain.is_none_or(|chain| chain == grasp.chain)).take(args.n);
    let hand = Hand::ftac();
    let files = wanted
        .map(|grasp| export::write(&hand, object, grasp, &args.mjcf))
        .collect::<anyhow::Result<Vec<_>>>()
        .with_context(|| format!("--mjcf {}", args.mjcf.display()))?;
    if let (true, Some(chain)) = (files.is_empty(), args.chain) {
        let known: Vec<String> = entry.grasps.iter().take(5).map(|grasp| grasp.chain.to_string()).collect();
        bail!("--chain: found {chain}, expected one of {} such as {}", entry.grasps.len(), known.join(", "));
    }
    terminal.print(
        &json!({ "files": files }),
        &format!(
            "{} grasps in {}; `python3 tests/mujoco/shake.py {1}` shakes them\n",
            files.len(),
            args.mjcf.display()
        ),
    )?;
    Ok(None)
}
