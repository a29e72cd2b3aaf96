//! Data shared by scenes and episodes, made once per process: robot, objects, plans, cameras.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use bench::builtin::{make_graspless_bench, set_plant_instance};
use bench::trial::Bench;
use ftac_platform::data::read_text;
use ftac_platform::file_access::FileAccess;
use hand_model::{RobotModel, RobotSources};
use learning_environment::episode::EPISODE_SEED;
use pyo3::prelude::*;
use scenarios::Scenario;
use scenarios::effects::Effects;
use scenarios::scenario::BENCHMARK_TOML;
use sim::tactile::TactileBoard;
use tactile_optics::GpuRenderer;
use toml::{Table, Value};
use world::objects::ObjectSet;

use crate::arrays::{failure, value_error};
use crate::threads::Threads;

/// Setup of a scene or episode: true for the benchmark's effects and errors, the texts of the robot ([`robot`]), the text
/// of a scenario ([`scenario`]), and true for tactile images from a GPU.
pub type Setup = (bool, Option<String>, Option<String>, bool);

static SHARED_BENCHES: Mutex<Vec<(Setup, Arc<Bench>)>> = Mutex::new(Vec::new());

/// Reads a robot file. Returns its texts as JSON, the number of joints of its arm, and the number of pads of its hand.
#[pyfunction]
pub fn robot(path: PathBuf) -> PyResult<(String, usize, usize)> {
    let robot = RobotModel::read(&path).map_err(value_error)?;
    let text = serde_json::to_string(&robot.sources).map_err(value_error)?;
    Ok((text, robot.arm.joints(), robot.hand.pads.len()))
}

/// Reads a scenario file. Returns a text of the same scenario that refers to no other file.
#[pyfunction]
pub fn scenario(path: PathBuf) -> PyResult<String> {
    let text = read_text(&path).map_err(value_error)?;
    Scenario::self_contained(&text, &path, FileAccess::in_folder_of(&path)).map_err(value_error)
}

/// Returns the tables of the benchmark's scenario file as JSON.
#[pyfunction]
pub fn benchmark_scenario() -> PyResult<String> {
    let tables: Table = BENCHMARK_TOML.parse().map_err(value_error)?;
    serde_json::to_string(&tables).map_err(value_error)
}

/// Returns the bench of a setup. Without a scenario it has that of the benchmark; without effects and errors there are
/// none (compliance, friction). Returns an error if images are to come from a GPU and there is none.
pub fn shared_bench(py: Python<'_>, setup: &Setup) -> PyResult<Arc<Bench>> {
    let (reality, robot, text, gpu) = setup;
    let sources: Option<RobotSources> = robot.as_deref().map(serde_json::from_str).transpose().map_err(value_error)?;
    let model = RobotModel::from_sources(sources.as_ref()).map_err(value_error)?;
    let scenario = scenario_of(*reality, text.as_deref())?;
    let threads = Threads::of_process()?;
    let made = py.detach(|| -> anyhow::Result<Arc<Bench>> {
        let mut shared = SHARED_BENCHES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, bench)) = shared.iter().find(|(made, _)| made == setup) {
            return Ok(bench.clone());
        }
        let bench = Arc::new(threads.run(|| -> anyhow::Result<Bench> {
            let mut bench = make_graspless_bench(&model, scenario, EPISODE_SEED)?;
            if *gpu {
                let sensors = Arc::new(bench.cameras.sensors().to_vec());
                bench.cameras = TactileBoard::with_renderer(Arc::new(GpuRenderer::new(sensors).context("renderer")?));
            }
            Ok(bench)
        })?);
        shared.push((setup.clone(), bench.clone()));
        Ok(bench)
    });
    made.map_err(|error| failure(&error))
}

/// Returns the scenario of a text, or the benchmark's. Without `reality` it has neither effects nor errors.
fn scenario_of(reality: bool, text: Option<&str>) -> PyResult<Scenario> {
    let mut scenario = match text {
        Some(text) => Scenario::parse(text, Path::new("scenario")).map_err(value_error)?,
        None => Scenario::benchmark(),
    };
    if !reality {
        scenario.effects = Effects::default();
        scenario.noise = scenario.noise.scaled(0.0);
    }
    Ok(scenario)
}

/// Tables of a scenario that can differ between episodes.
const RANDOMIZED_TABLES: [&str; 3] = ["noise", "effects", "layout"];

/// Returns the bench with fields of its scenario replaced by those of `overrides`, a JSON object of tables, and with
/// robot instance `instance` as the simulated robot, which the observations' nominal model does not know.
pub fn varied_bench(bench: Arc<Bench>, overrides: Option<&str>, instance: Option<u64>) -> PyResult<Arc<Bench>> {
    if overrides.is_none() && instance.is_none() {
        return Ok(bench);
    }
    let scenario = match overrides {
        Some(overrides) => overridden(&bench.world.scenario, overrides)?,
        None => bench.world.scenario.clone(),
    };
    let mut varied = bench.with_scenario(scenario);
    if let Some(number) = instance {
        set_plant_instance(&mut varied, number).map_err(|error| failure(&error))?;
    }
    Ok(Arc::new(varied))
}

/// Checks each of these fields ([`varied_bench`]) in the scenario of a setup.
#[pyfunction]
pub fn check_overrides(setup: Setup, overrides: Vec<String>) -> PyResult<()> {
    let scenario = scenario_of(setup.0, setup.2.as_deref())?;
    overrides.iter().try_for_each(|fields| overridden(&scenario, fields).map(drop))
}

/// Returns the scenario with fields replaced by those of `overrides`, a JSON object of tables.
fn overridden(scenario: &Scenario, overrides: &str) -> PyResult<Scenario> {
    let overrides: Table = serde_json::from_str(overrides).map_err(value_error)?;
    if let Some(name) = overrides.keys().find(|name| !RANDOMIZED_TABLES.contains(&name.as_str())) {
        let known = RANDOMIZED_TABLES.join(", ");
        return Err(value_error(format!("randomization: found a field of `{name}`, expected one of {known}")));
    }
    let mut all = Table::try_from(scenario).map_err(value_error)?;
    let benchmark: Table = BENCHMARK_TOML.parse().map_err(value_error)?;
    merge(&mut all, overrides, &benchmark, "randomization").map_err(value_error)?;
    let text = toml::to_string(&all).map_err(value_error)?;
    Scenario::parse(&text, Path::new("randomization")).map_err(value_error)
}

/// Replaces fields of `all` by those of `overrides`. A table that `all` does not have, but the benchmark, is an effect
/// that is off, and must be given as a whole. Any other field that `all` does not have is an error.
fn merge(all: &mut Table, overrides: Table, benchmark: &Table, path: &str) -> Result<(), String> {
    for (name, value) in overrides {
        let path = format!("{path}.{name}");
        let known = benchmark.get(&name).and_then(Value::as_table);
        match (all.get_mut(&name), value, known) {
            (Some(Value::Table(inner)), Value::Table(value), _) => {
                merge(inner, value, known.unwrap_or(&Table::new()), &path)?;
            }
            (Some(field), value, _) => *field = value,
            (None, Value::Table(value), Some(known)) => {
                let missing: Vec<&str> =
                    known.keys().map(String::as_str).filter(|key| !value.contains_key(*key)).collect();
                if !missing.is_empty() {
                    let given = value.keys().cloned().collect::<Vec<_>>().join(", ");
                    let words =
                        "of an effect that is off (as with reality=False), expected all of its fields; missing are";
                    return Err(format!("{path}: found {given} {words} {}", missing.join(", ")));
                }
                all.insert(name, Value::Table(value));
            }
            (None, ..) => {
                let mut names: Vec<&str> = all.keys().chain(benchmark.keys()).map(String::as_str).collect();
                names.sort_unstable();
                names.dedup();
                return Err(format!("{path}: found no such field, expected one of {}", names.join(", ")));
            }
        }
    }
    Ok(())
}

/// Returns the names of the objects of a scenario's text, or of the benchmark's.
#[pyfunction]
pub fn scenario_objects(text: Option<&str>) -> PyResult<Vec<String>> {
    let objects = scenario_of(true, text)?.object_set().map_err(value_error)?;
    Ok(objects.names().into_iter().map(str::to_owned).collect())
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
