//! Data shared by scenes and episodes, made once per process: robot, objects, plans, cameras.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use bench::builtin::make_graspless_bench;
use bench::trial::Bench;
use hand_model::{RobotModel, RobotSources};
use learning_environment::episode::EPISODE_SEED;
use pyo3::prelude::*;
use scenarios::Scenario;
use scenarios::effects::Effects;
use world::objects::ObjectSet;

use crate::arrays::{failure, value_error};

/// A bench, with the keys by which it is shared: true if it has the benchmark's effects and errors, and the files of
/// its robot.
type SharedBench = (bool, Option<RobotSources>, Arc<Bench>);

static SHARED_BENCHES: Mutex<Vec<SharedBench>> = Mutex::new(Vec::new());

/// Reads a robot file. Returns its texts as JSON, the number of joints of its arm, and the number of pads of its hand.
#[pyfunction]
pub fn robot(path: PathBuf) -> PyResult<(String, usize, usize)> {
    let robot = RobotModel::read(&path).map_err(value_error)?;
    let text = serde_json::to_string(&robot.sources).map_err(value_error)?;
    Ok((text, robot.arm.joints(), robot.hand.pads.len()))
}

/// Returns the bench with the benchmark's objects and the built-in robot, or that of the texts from [`robot`]. Without
/// `reality` there are no errors and no effects (compliance, friction).
pub fn shared_bench(py: Python<'_>, reality: bool, robot: Option<&str>) -> PyResult<Arc<Bench>> {
    let sources: Option<RobotSources> = robot.map(serde_json::from_str).transpose().map_err(value_error)?;
    let model = RobotModel::from_sources(sources.as_ref()).map_err(value_error)?;
    let made = py.detach(|| {
        let mut shared = SHARED_BENCHES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((.., bench)) = shared.iter().find(|made| (made.0, &made.1) == (reality, &sources)) {
            return Ok(bench.clone());
        }
        let mut scenario = Scenario::benchmark();
        if !reality {
            scenario.effects = Effects::default();
            scenario.noise = scenario.noise.scaled(0.0);
        }
        let bench = Arc::new(make_graspless_bench(&model, scenario, EPISODE_SEED)?);
        shared.push((reality, sources, bench.clone()));
        Ok(bench)
    });
    made.map_err(|error: anyhow::Error| failure(&error))
}

/// Returns the names of the built-in objects.
#[pyfunction]
pub fn objects() -> Vec<String> {
    ObjectSet::standard().names().into_iter().map(str::to_owned).collect()
}

/// Returns the benchmark's combinations: names of the first and the second object.
#[pyfunction]
pub fn combinations() -> PyResult<Vec<(String, String)>> {
    let plans = grasp_verification::builtin::grasp_pairs().map_err(|error| failure(&error))?;
    Ok(plans.pairs.into_iter().map(|plan| (plan.first, plan.second)).collect())
}
