//! Runs a unit of a sweep with the functions of the benchmark.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use anyhow::{Context as _, Result, anyhow};
use bench::builtin::bench_from_request;
use bench::journal::{RecordingSelection, RunRequest};
use bench::run::{RunOptions, run_unit};
use bench::trial::Bench;
use robot_backends::BackendFactory;
use robot_backends::direct_emulation::DirectEmulationFactory;
use robot_backends::wire_emulation::WireEmulationFactory;

use crate::columns;
use crate::plan::{SweepPlan, SweepUnit};
use crate::rows::UnitTables;

/// Tables of a finished unit as files.
pub struct FinishedTables {
    pub tries: Vec<u8>,
    pub trials: Vec<u8>,
    pub seconds: f64,
}

/// Cache of benches, which units of one run share.
pub struct BenchCache {
    made: Mutex<Vec<(String, Slot)>>,
    /// Capacity of the cache.
    capacity: usize,
    /// True to hide the progress of the search for grasp pairs that are not built in.
    quiet: bool,
}

type Slot = Arc<Mutex<Option<Arc<Bench>>>>;

impl BenchCache {
    /// Creates the cache for this many workers.
    pub fn new(workers: usize, quiet: bool) -> Self {
        Self { made: Mutex::default(), capacity: workers.max(1), quiet }
    }

    /// Returns the bench of a request, from the cache or newly made.
    fn bench_for(&self, request: &RunRequest) -> Result<Arc<Bench>> {
        let key =
            RunRequest { conditions: Vec::new(), ablations: Vec::new(), trials: 0, ..request.clone() }.digest()?;
        let poisoned = || anyhow!("a worker panicked");
        let slot = {
            let mut made = self.made.lock().map_err(|_| poisoned())?;
            match made.iter().position(|(own, _)| *own == key) {
                Some(at) => made[at].1.clone(),
                None => {
                    made.truncate(self.capacity.saturating_sub(1));
                    made.insert(0, (key, Slot::default()));
                    made[0].1.clone()
                }
            }
        };
        // Workers that need the same bench wait for it; others go on.
        let mut slot = slot.lock().map_err(|_| poisoned())?;
        if slot.is_none() {
            *slot = Some(Arc::new(bench_from_request(request, self.quiet)?));
        }
        slot.clone().context("a bench")
    }
}

/// Returns a factory of robot backends that cannot be cloned; none for simulated ones.
fn backend_factory(bench: &Bench, robot: &str) -> Result<Option<Box<dyn BackendFactory>>> {
    let model = bench.world.cell.robot.clone();
    Ok(match robot {
        "sim" => None,
        "emulated" => Some(Box::new(WireEmulationFactory::new(model, None))),
        "direct" => Some(Box::new(DirectEmulationFactory { robot: model, sessions: None })),
        other => return Err(anyhow!("robot: found {other}, expected sim, emulated or direct")),
    })
}

/// Runs all trials of a unit. `stop` may end it between two trials; the result is then none.
pub fn run_trial_unit(
    plan: &SweepPlan,
    unit: &SweepUnit,
    benches: &BenchCache,
    stop: &(dyn Fn() -> bool + Sync),
    done: &(dyn Fn() + Sync),
) -> Result<Option<FinishedTables>> {
    let begun = Instant::now();
    let request = plan.request(unit.run)?;
    let bench = benches.bench_for(&request)?;
    let place = |_| backend_factory(&bench, &request.robot);
    let options = RunOptions {
        jobs: 1,
        record: RecordingSelection::None,
        film: false,
        quiet: true,
        live: false,
        open_factory: &place,
    };
    let mut rows = UnitTables::new(plan, unit)?;
    for trial in plan.trials(unit)? {
        if stop() {
            return Ok(None);
        }
        let results = run_unit(&bench, &request, trial, Path::new(""), &options)
            .with_context(|| format!("combination {}, trial {:?}", trial.combination, trial.trial))?;
        rows.add(&results)?;
        done();
    }
    let seconds = begun.elapsed().as_secs_f64();
    let metadata = [
        ("ftac.schema", columns::VERSION.to_string()),
        ("ftac.unit", unit.id.clone()),
        ("ftac.point", plan.runs[unit.run].point.to_string()),
        ("ftac.seconds", seconds.to_string()),
        ("ftac.program", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    Ok(Some(FinishedTables {
        tries: rows.tries.to_parquet(&metadata)?,
        trials: rows.trials.to_parquet(&metadata)?,
        seconds,
    }))
}
