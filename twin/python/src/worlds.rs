//! What scenes and episodes share, made once a process: robot, objects, plans, cameras.

use hand_model::RobotModel;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use bench::builtin::make_scenes;
use bench::environment::episode::EPISODES;
use bench::trial::Bench;
use pyo3::prelude::*;
use scenarios::Scenario;
use scenarios::effects::Effects;
use world::objects::ObjectSet;

use crate::arrays::failure;

/// With the benchmark's effects and errors, and without any.
static SHARED: LazyLock<[Mutex<Option<Arc<Bench>>>; 2]> = LazyLock::new(Default::default);

/// The benchmark's robot and objects; without `reality` nothing errs, gives way or rubs.
pub fn shared(py: Python<'_>, reality: bool) -> PyResult<Arc<Bench>> {
    let made = py.detach(|| {
        let mut shared = SHARED[usize::from(reality)].lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bench) = &*shared {
            return Ok(bench.clone());
        }
        let mut scenario = Scenario::benchmark();
        if !reality {
            scenario.effects = Effects::default();
            scenario.noise = scenario.noise.scaled(0.0);
        }
        let combos = proving::builtin::plans()?.plans.len();
        let bench = Arc::new(make_scenes(&RobotModel::ftac_gen3(), scenario, combos, EPISODES, true)?);
        *shared = Some(bench.clone());
        Ok(bench)
    });
    made.map_err(|error: anyhow::Error| failure(&error))
}

/// Names of the built-in objects.
#[pyfunction]
pub fn objects() -> Vec<String> {
    ObjectSet::standard().names().into_iter().map(str::to_owned).collect()
}

/// The benchmark's combinations: names of the first and the second object.
#[pyfunction]
pub fn combinations() -> PyResult<Vec<(String, String)>> {
    let plans = proving::builtin::plans().map_err(|error| failure(&error))?;
    Ok(plans.plans.into_iter().map(|plan| (plan.first, plan.second)).collect())
}
