//! Simulated first grasps to feel: played once, kept in a file if wanted.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result, anyhow, bail};
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};

use bench::trial::{Bench, HeldGrasp};
use report::write_whole;

/// How many grasps are played, and from what.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Played {
    pub combos: usize,
    pub trials: usize,
    pub seed: u64,
}

#[derive(Serialize, Deserialize)]
struct File {
    played: Played,
    grasps: Vec<HeldGrasp>,
}

/// The grasps of `played` that hold, in order: from `file` if it exists, else played and then written there.
pub fn grasps(bench: &Bench, played: Played, file: Option<&Path>, quiet: bool) -> Result<Vec<HeldGrasp>> {
    if let Some(path) = file.filter(|path| path.exists()) {
        let text = std::fs::read(path).with_context(|| path.display().to_string())?;
        let kept: File =
            serde_json::from_slice(&text).with_context(|| format!("{}: not a file of grasps", path.display()))?;
        if kept.played != played {
            bail!("{}: found grasps of {:?}, expected {played:?}", path.display(), kept.played);
        }
        return Ok(kept.grasps);
    }
    let grasps = play(bench, played, quiet)?;
    if let Some(path) = file {
        write_whole(path, &serde_json::to_vec(&File { played, grasps: grasps.clone() })?)?;
    }
    Ok(grasps)
}

fn play(bench: &Bench, played: Played, quiet: bool) -> Result<Vec<HeldGrasp>> {
    let count = played.combos * played.trials;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(count as u64) };
    bar.set_style(indicatif::ProgressStyle::with_template("{bar:28} {pos}/{len} grasps [{elapsed} < {eta}]")?);
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::with_capacity(count));
    let work = || -> Result<()> {
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return Ok(());
            }
            let held = bench.held(n / played.trials, n % played.trials)?;
            found.lock().map_err(|_| anyhow!("a worker panicked"))?.extend(held);
            bar.inc(1);
        }
    };
    // Plain threads: a worker that waits for its tactile images must not start another grasp.
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().map_err(|_| anyhow!("a worker panicked"))?)
    })?;
    bar.finish_and_clear();
    let mut grasps = found.into_inner().map_err(|_| anyhow!("a worker panicked"))?;
    grasps.sort_by_key(|grasp: &HeldGrasp| (grasp.combination, grasp.trial));
    Ok(grasps)
}
