//! Trials of the benchmark in which a Python object chooses how the second object is taken.
//!
//! Everything runs without Python's lock but the choice itself. An exception of the policy fails its trial, with the traceback in the record;
//! an interrupt ends the call.

use std::sync::Mutex;

use bench::builtin::make_bench;
use bench::trial::{Bench, NoWatcher, TrialOutcome};
use control::policy::chosen::{Aim, Answer, Chooser, ChooserError, Situation};
use control::worth::Candidate;
use nalgebra::Isometry3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use scenarios::record::{Condition, TrialRecord};
use scenarios::{Scenario, phase::Phase};
use serde_json::{Value, json};

use crate::arrays::{failure, picture, pose_row, table, value_error};
use crate::hand::HAND;

/// The benchmark of a seed.
#[pyclass(frozen, module = "ftac._native")]
pub struct Benchmark(Bench);

/// A Python object that is asked.
struct Asked<'a> {
    policy: &'a Py<PyAny>,
    /// What is no failure of the policy, and ends the call.
    interrupt: Mutex<Option<PyErr>>,
}

impl Chooser for Asked<'_> {
    fn choose(&mut self, situation: &Situation) -> Result<Answer, ChooserError> {
        Python::attach(|py| {
            let asked = told(py, situation).and_then(|told| self.policy.call_method1(py, "choose", (told,)));
            let answer = asked.and_then(|answer| answer.extract::<Option<(usize, f64, f64, f64)>>(py));
            match answer {
                Ok(None) => Ok(Answer::Keep),
                Ok(Some((candidate, x, y, yaw))) => Ok(Answer::Take { candidate, aim: Aim { x, y, yaw } }),
                Err(error) => {
                    let trace = error.traceback(py).and_then(|trace| trace.format().ok()).unwrap_or_default();
                    let words = format!("{trace}{error}");
                    if !error.is_instance_of::<PyException>(py) {
                        // A lock that only this thread takes is never poisoned.
                        *self.interrupt.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(error);
                    }
                    Err(words.into())
                }
            }
        })
    }
}

fn candidate(candidate: &Candidate) -> Value {
    json!({ "grasp": candidate.grasp, "worth": candidate.worth })
}

/// A situation as the package takes it.
fn told<'py>(py: Python<'py>, situation: &Situation) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("phase", if situation.phase == Phase::Decide { "decide" } else { "confirm" })?;
    all.set_item("time", situation.time)?;
    all.set_item("time_left", situation.time_left)?;
    all.set_item("tries", situation.tries)?;
    let servos = situation.servos.iter().map(|servo| [servo.position, servo.velocity, servo.current]);
    all.set_item("servos", table(py, servos))?;
    let arm = situation.arm;
    let joints = (0..arm.position.len()).map(|n| [arm.position[n], arm.velocity[n], arm.torque[n]]);
    all.set_item("arm", table(py, joints))?;
    let row = |pose: &Isometry3<f64>| PyArray1::from_slice(py, &pose_row(pose));
    all.set_item("palm", row(&situation.palm))?;
    let images = PyDict::new(py);
    for frame in situation.images {
        let camera = HAND.cameras.get(frame.camera).map_or("", |camera| camera.name.as_str());
        images.set_item(camera, picture(py, touch::IMAGE_SIZE, frame.image.rgb.clone())?)?;
    }
    all.set_item("tactile", images)?;
    all.set_item("objects", situation.objects)?;
    all.set_item("seen", table(py, situation.seen.iter().map(|seen| pose_row(&seen.pose()))))?;
    all.set_item("yaws", situation.seen.map(|seen| seen.yaw))?;
    all.set_item("sees_second", situation.sees_second)?;
    all.set_item("held", situation.felt.map(|felt| row(&felt.estimate.palm_from_object)))?;
    let covariance = situation.felt.map(|felt| {
        let matrix = &felt.estimate.covariance;
        Array2::from_shape_fn((6, 6), |at| matrix[at]).into_pyarray(py)
    });
    all.set_item("held_covariance", covariance)?;
    all.set_item("grip", (situation.grip.first, situation.grip.second))?;
    all.set_item("first", json!(situation.first).to_string())?;
    let candidates: Vec<Value> = situation.candidates.iter().map(candidate).collect();
    all.set_item("candidates", Value::from(candidates).to_string())?;
    Ok(all)
}

fn text(record: &TrialRecord) -> PyResult<String> {
    serde_json::to_string(record).map_err(value_error)
}

#[pymethods]
impl Benchmark {
    #[new]
    fn new(py: Python<'_>, seed: u64) -> PyResult<Self> {
        let made = py.detach(|| {
            let combos = proving::builtin::plans()?.plans.len();
            make_bench(Scenario::benchmark(), combos, seed, true)
        });
        Ok(Self(made.map_err(|error| failure(&error))?))
    }

    /// A trial with a policy's choices: its record as JSON.
    fn play(&self, py: Python<'_>, policy: Py<PyAny>, combination: usize, trial: usize) -> PyResult<String> {
        self.check(combination)?;
        let mut chooser = Asked { policy: &policy, interrupt: Mutex::new(None) };
        let played = py.detach(|| self.0.chosen(combination, trial, &mut chooser));
        if let Some(error) = chooser.interrupt.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
            return Err(error);
        }
        py.check_signals()?;
        let TrialOutcome { record, .. } = played.map_err(|error| failure(&error))?;
        text(&record)
    }

    /// The same trial under a condition of the benchmark.
    fn condition(&self, py: Python<'_>, name: &str, combination: usize, trial: usize) -> PyResult<String> {
        self.check(combination)?;
        let condition: Condition = name.parse().map_err(value_error)?;
        let played = py.detach(|| match condition {
            Condition::Ideal => self.0.ideal(combination, &mut NoWatcher).map(|outcome| outcome.record),
            _ => {
                let results = self.0.trial(combination, trial, &[condition], &[], &mut NoWatcher)?;
                results.records.into_iter().next().ok_or_else(|| anyhow::anyhow!("no trial was played"))
            }
        });
        py.check_signals()?;
        text(&played.map_err(|error| failure(&error))?)
    }
}

impl Benchmark {
    fn check(&self, combination: usize) -> PyResult<()> {
        let count = self.0.plans.plans.len();
        if combination < count {
            return Ok(());
        }
        Err(value_error(format!("combination: found {combination}, expected 0 to {}", count - 1)))
    }
}
