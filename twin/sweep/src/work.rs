//! A worker: runs the unfinished units of a sweep, one after the other.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow};
use progress::interrupt::{Interrupt, Interrupted};

use crate::claim::Claims;
use crate::columns::TableKind;
use crate::execution::{BenchCache, run_trial_unit};
use crate::folder::{Failure, SweepFolder};
use crate::plan::SweepUnit;

/// Polling interval for units that others run.
const POLL_INTERVAL: Duration = Duration::from_secs(5);

/// Options of a worker.
#[derive(Debug, Clone, Copy)]
pub struct WorkerOptions {
    /// Number of threads; each runs its own unit.
    pub jobs: usize,
    /// True to show no progress.
    pub quiet: bool,
    /// Worker `i` of `n`, from 1. It determines the first unit, so that not all start with the same one. Such a worker
    /// does not wait for units that others run.
    pub worker: Option<(usize, usize)>,
}

/// Result of a worker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WorkerResult {
    /// Number of units that it ran.
    pub run_here: usize,
    /// Number of finished units.
    pub finished: usize,
    /// Number of all units.
    pub total_units: usize,
    /// Units that could not be run, with the reasons.
    pub failed: Vec<(String, String)>,
    /// Wall time of this worker, s.
    pub wall_s: f64,
}

/// Returns the error for Ctrl-C or SIGTERM; finished units are kept.
fn interrupted(folder: &SweepFolder) -> Result<anyhow::Error> {
    let further = format!("continue with `ftac sweep run {}`", folder.path.display());
    let (done, of) = (folder.finished()?.len(), folder.plan.units.len());
    Ok(Interrupted { done, total: of, pieces: "units are finished", resume_hint: further }.into())
}

/// Runs the unfinished units on several threads. A failure is recorded and the next unit started, but a result that
/// cannot be written ends the work.
pub fn work(folder: &SweepFolder, options: WorkerOptions) -> Result<WorkerResult> {
    let begun = Instant::now();
    if options.worker.is_none() {
        set_broken_aside(folder)?;
    }
    let plan = &folder.plan;
    let trials: usize = plan.units.iter().map(|unit| unit.count).sum();
    let finished = folder.finished()?;
    let before: usize = plan.units.iter().filter(|unit| finished.contains(&unit.id)).map(|unit| unit.count).sum();
    let bar = progress::resumed_bar(trials as u64, before as u64, "trials", options.quiet);
    let worker = Worker {
        folder,
        claims: Claims::new(&folder.path)?,
        benches: BenchCache::new(options.jobs, options.quiet),
        interrupt: Interrupt::catch()?,
        bar: &bar,
        failed: Mutex::default(),
        run_here: AtomicUsize::new(0),
        stopped: Mutex::default(),
    };
    let order = unit_order(plan.units.len(), options.worker);
    loop {
        let finished = folder.finished()?;
        let failed = worker.failed_ids()?;
        let open: Vec<&SweepUnit> = order
            .iter()
            .map(|n| &plan.units[*n])
            .filter(|unit| !finished.contains(&unit.id) && !failed.contains(&unit.id))
            .collect();
        if open.is_empty() {
            break;
        }
        let run_here = worker.run_open_units(&open, options.jobs)?;
        // The remaining units are run by others.
        if run_here == 0 && options.worker.is_some() {
            break;
        }
        if run_here == 0 {
            bar.set_message("waiting for units of other workers");
            std::thread::sleep(POLL_INTERVAL);
            let now = folder.finished()?;
            bar.set_position(
                plan.units.iter().filter(|unit| now.contains(&unit.id)).map(|unit| unit.count as u64).sum(),
            );
            if worker.interrupt.happened() {
                return Err(interrupted(folder)?);
            }
        }
    }
    bar.finish_and_clear();
    let failed = worker.failed.into_inner().map_err(|_| anyhow!("a worker panicked"))?;
    Ok(WorkerResult {
        run_here: worker.run_here.into_inner(),
        finished: folder.finished()?.len(),
        total_units: plan.units.len(),
        failed,
        wall_s: begun.elapsed().as_secs_f64(),
    })
}

/// Returns the order in which units are tried: neighbours share a bench, and workers start at different units.
fn unit_order(units: usize, worker: Option<(usize, usize)>) -> Vec<usize> {
    let start = worker.map_or(0, |(i, n)| units * (i - 1) / n.max(1));
    (start..units).chain(0..start).collect()
}

/// Moves the broken files of finished units aside, so that these are run again.
fn set_broken_aside(folder: &SweepFolder) -> Result<()> {
    for id in folder.finished()? {
        for which in TableKind::ALL {
            if let Err(error) = folder.open_checked(which, &id) {
                let aside = folder.set_aside(&id)?;
                eprintln!("{error:#}; it is kept as {}, and its unit is run again", aside.display());
                break;
            }
        }
    }
    Ok(())
}

struct Worker<'a> {
    folder: &'a SweepFolder,
    claims: Claims,
    benches: BenchCache,
    interrupt: Interrupt,
    bar: &'a progress::ProgressBar,
    failed: Mutex<Vec<(String, String)>>,
    run_here: AtomicUsize,
    /// Error that prevents the start of further units.
    stopped: Mutex<Option<anyhow::Error>>,
}

impl Worker<'_> {
    fn failed_ids(&self) -> Result<BTreeSet<String>> {
        let failed = self.failed.lock().map_err(|_| anyhow!("a worker panicked"))?;
        Ok(failed.iter().map(|(id, _)| id.clone()).collect())
    }

    /// Tries every open unit once and runs the free ones. Returns their number.
    fn run_open_units(&self, open: &[&SweepUnit], jobs: usize) -> Result<usize> {
        let before = self.run_here.load(Ordering::Relaxed) + self.failed_ids()?.len();
        let outcome = bench::workers::for_each(jobs, open, |_, unit| {
            if self.interrupt.happened() {
                return Err(interrupted(self.folder)?);
            }
            if self.stopped.lock().is_ok_and(|stopped| stopped.is_some()) {
                return Ok(());
            }
            self.run_sweep_unit(unit)
        });
        if outcome.as_ref().is_err_and(|error| error.is::<Interrupted>()) {
            // The other threads have ended their units meanwhile.
            return Err(interrupted(self.folder)?);
        }
        outcome?;
        if let Some(error) = self.stopped.lock().ok().and_then(|mut stopped| stopped.take()) {
            return Err(error);
        }
        Ok(self.run_here.load(Ordering::Relaxed) + self.failed_ids()?.len() - before)
    }

    fn run_sweep_unit(&self, unit: &SweepUnit) -> Result<()> {
        let Some(_claim) = self.claims.try_claim(&unit.id)? else { return Ok(()) };
        // Another worker may have finished it in the meantime.
        if self.folder.is_finished(&unit.id) {
            return Ok(());
        }
        let stop = || self.interrupt.happened();
        let done = || self.bar.inc(1);
        let outcome =
            catch_unwind(AssertUnwindSafe(|| run_trial_unit(&self.folder.plan, unit, &self.benches, &stop, &done)));
        let outcome = outcome.unwrap_or_else(|panic| {
            let words = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
            Err(anyhow!("it panicked: {}", words.unwrap_or("without a word")))
        });
        match outcome {
            Ok(None) => Ok(()),
            Ok(Some(tables)) => {
                let kept = self.folder.store_unit(&unit.id, &tables.tries, &tables.trials);
                if let Err(error) = kept {
                    // No other result could be written either.
                    let error = error.context(format!("the results of unit {} cannot be kept", unit.id));
                    if let Ok(mut stopped) = self.stopped.lock() {
                        stopped.get_or_insert(error);
                    }
                    return Ok(());
                }
                self.run_here.fetch_add(1, Ordering::Relaxed);
                Ok(())
            }
            Err(error) => {
                let failure = Failure { reason: format!("{error:#}"), by: self.claims.holder().to_string() };
                eprintln!("unit {} failed: {}", unit.id, failure.reason);
                self.failed
                    .lock()
                    .map_err(|_| anyhow!("a worker panicked"))?
                    .push((unit.id.clone(), failure.reason.clone()));
                self.folder.note_failure(&unit.id, &failure).context("the unit's failure cannot be noted")
            }
        }
    }
}
