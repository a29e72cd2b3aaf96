//! Simulated first grasps as test cases for touch: simulated once, and optionally kept in a file.

use std::path::Path;
use std::sync::Mutex;

use anyhow::{Context, Result, anyhow, bail};
use bench::trial::{Bench, HeldGrasp};
use bench::workers;
use ftac_platform::data::write_atomically;
use serde::{Deserialize, Serialize};

/// Number and seed of the simulated grasps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SimulatedGrasps {
    pub combos: usize,
    pub trials: usize,
    pub seed: u64,
}

#[derive(Serialize, Deserialize)]
struct GraspCache {
    #[serde(alias = "played")]
    selection: SimulatedGrasps,
    grasps: Vec<HeldGrasp>,
}

/// Returns the grasps of `selection` that hold, in order. They are read from `file` if it exists; otherwise they are
/// simulated and written there.
pub fn grasps(bench: &Bench, selection: SimulatedGrasps, file: Option<&Path>, quiet: bool) -> Result<Vec<HeldGrasp>> {
    if let Some(path) = file.filter(|path| path.exists()) {
        let text = ftac_platform::file::read_regular(path, ftac_platform::file::MAX_TEXT_SIZE)
            .with_context(|| path.display().to_string())?;
        let kept: GraspCache =
            serde_json::from_slice(&text).with_context(|| format!("{}: not a file of grasps", path.display()))?;
        if kept.selection != selection {
            bail!("{}: found grasps of {:?}, expected {selection:?}", path.display(), kept.selection);
        }
        return Ok(kept.grasps);
    }
    let grasps = run_trials(bench, selection, quiet)?;
    if let Some(path) = file {
        write_atomically(path, &serde_json::to_vec(&GraspCache { selection, grasps: grasps.clone() })?)?;
    }
    Ok(grasps)
}

fn run_trials(bench: &Bench, selection: SimulatedGrasps, quiet: bool) -> Result<Vec<HeldGrasp>> {
    let count = selection.combos * selection.trials;
    let bar = progress::bar(count as u64, "grasps", quiet);
    let found = Mutex::new(Vec::with_capacity(count));
    let trials: Vec<usize> = (0..count).collect();
    workers::for_each(workers::available_threads(), &trials, |n, _| {
        let held = bench.held_grasp(n / selection.trials, n % selection.trials)?;
        found.lock().map_err(|_| anyhow!("a worker panicked"))?.extend(held);
        bar.inc(1);
        Ok(())
    })?;
    bar.finish_and_clear();
    let mut grasps = found.into_inner().map_err(|_| anyhow!("a worker panicked"))?;
    grasps.sort_by_key(|grasp: &HeldGrasp| (grasp.combination, grasp.trial));
    Ok(grasps)
}
