//! Trials of the benchmark in which a Python object is the policy.
//!
//! It answers the same questions as a policy in a separate process, by way of the package's `policy_host`. Everything
//! but the answers runs with Python's lock (GIL) released. An exception of the policy fails its trial, with the
//! traceback in the record; an interrupt ends the call.

use bench::builtin::make_bench;
use bench::trial::{Bench, NoWatcher, TrialOutcome};
use external_policy::server::QuestionArray;
use external_policy::{PolicyIntroduction, PolicyServer, PolicyServerError, SimulatedTimePassage};
use hand_model::RobotModel;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use serde_json::Value;

use crate::arrays::{failure, value_error};
use crate::steps::steps_dict;
use crate::threads::detach;

/// The benchmark with a given seed.
#[pyclass(frozen, module = "ftac._native")]
pub struct Benchmark(Bench);

/// A `policy_host.PolicyServer` that answers questions.
struct PythonPolicyServer<'a> {
    server: &'a Py<PyAny>,
    /// An interrupt, which is no failure of the policy and ends the call.
    interrupt: Option<PyErr>,
}

impl PolicyServer for PythonPolicyServer<'_> {
    fn ask(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<Value, PolicyServerError> {
        let question = question.to_string();
        let answer = Python::attach(|py| {
            let arrays: Vec<_> =
                arrays.iter().map(|array| (array.shape.clone(), PyBytes::new(py, array.bytes))).collect();
            self.server.call_method1(py, "answer_text", (question, arrays))?.extract::<String>(py)
        });
        let answer: Value = match answer {
            Ok(text) => {
                serde_json::from_str(&text).map_err(|error| PolicyServerError::InvalidAnswer(error.to_string()))?
            }
            Err(error) => {
                let words = error.to_string();
                self.interrupt = Some(error);
                return Err(PolicyServerError::Failed(words));
            }
        };
        match answer.get("error").and_then(Value::as_str) {
            Some(why) => Err(PolicyServerError::Failed(why.to_owned())),
            None => Ok(answer),
        }
    }
}

fn text(record: &TrialRecord) -> PyResult<String> {
    serde_json::to_string(record).map_err(value_error)
}

#[pymethods]
impl Benchmark {
    #[new]
    fn new(py: Python<'_>, seed: u64) -> PyResult<Self> {
        let made = detach(py, || {
            let combos = grasp_verification::builtin::grasp_pairs()?.pairs.len();
            make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), combos, seed, true)
        })?;
        Ok(Self(made.map_err(|error| failure(&error))?))
    }

    /// Runs a trial under an external policy, introduced by `introduction`, and returns its record as JSON.
    fn run(
        &self,
        py: Python<'_>,
        host: Py<PyAny>,
        introduction: &str,
        wall: bool,
        combination: usize,
        trial: usize,
    ) -> PyResult<String> {
        self.check(combination)?;
        let introduction: PolicyIntroduction = serde_json::from_str(introduction).map_err(value_error)?;
        let pace = if wall { SimulatedTimePassage::Wall } else { SimulatedTimePassage::Paused };
        let mut asked = PythonPolicyServer { server: &host, interrupt: None };
        let finished = detach(py, || self.0.run_with_server(combination, trial, (&introduction, pace), &mut asked))?;
        if let Some(error) = asked.interrupt {
            return Err(error);
        }
        py.check_signals()?;
        let TrialOutcome { record, .. } = finished.map_err(|error| failure(&error))?;
        text(&record)
    }

    /// Runs the same trial under a condition of the benchmark and returns its record as JSON.
    fn condition(&self, py: Python<'_>, name: &str, combination: usize, trial: usize) -> PyResult<String> {
        self.check(combination)?;
        let condition: Condition = name.parse().map_err(value_error)?;
        let finished = detach(py, || match condition {
            Condition::Ideal => self.0.run_ideal(combination, &mut NoWatcher).map(|outcome| outcome.record),
            _ => {
                let results = self.0.run_each_condition(combination, trial, &[condition], &[], &mut NoWatcher)?;
                results.records.into_iter().next().ok_or_else(|| anyhow::anyhow!("no trial was finished"))
            }
        })?;
        py.check_signals()?;
        text(&finished.map_err(|error| failure(&error))?)
    }

    /// Runs the trial of the policy `touch` and returns its steps of 1/20 s: measurements, set-points, images of `side`
    /// pixels, and as JSON the question at the beginning and the record.
    fn steps<'py>(
        &self,
        py: Python<'py>,
        combination: usize,
        trial: usize,
        side: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        self.check(combination)?;
        let recorded = detach(py, || self.0.record_steps(combination, trial, side))?;
        py.check_signals()?;
        let (recorded, record) = recorded.map_err(|error| failure(&error))?;
        let all = steps_dict(py, recorded, side)?;
        all.set_item("record", text(&record)?)?;
        Ok(all)
    }
}

impl Benchmark {
    fn check(&self, combination: usize) -> PyResult<()> {
        let count = self.0.grasp_pairs.pairs.len();
        if combination < count {
            return Ok(());
        }
        Err(value_error(format!("combination: found {combination}, expected 0 to {}", count - 1)))
    }
}
