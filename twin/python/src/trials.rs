//! Trials of the benchmark in which a Python object is the policy.
//!
//! It answers the same questions as a policy in a separate process, by way of the package's `policy_host`. Everything
//! but the answers runs with Python's lock (GIL) released. An exception of the policy fails its trial, with the
//! traceback in the record; an interrupt ends the call.

use bench::builtin::make_bench;
use bench::trial::{Bench, NoWatcher, TrialOutcome};
use external_policy::host::Array;
use external_policy::{Guest, Host, HostError, Pace};
use hand_model::RobotModel;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use serde_json::Value;

use crate::arrays::{failure, value_error};

/// The benchmark with a given seed.
#[pyclass(frozen, module = "ftac._native")]
pub struct Benchmark(Bench);

/// A `policy_host.Host` that answers questions.
struct Asked<'a> {
    host: &'a Py<PyAny>,
    /// An interrupt, which is no failure of the policy and ends the call.
    interrupt: Option<PyErr>,
}

impl Host for Asked<'_> {
    fn ask(&mut self, question: &Value, arrays: &[Array]) -> Result<Value, HostError> {
        let question = question.to_string();
        let answer = Python::attach(|py| {
            let arrays: Vec<_> =
                arrays.iter().map(|array| (array.shape.clone(), PyBytes::new(py, array.bytes))).collect();
            self.host.call_method1(py, "answer_text", (question, arrays))?.extract::<String>(py)
        });
        let answer: Value = match answer {
            Ok(text) => serde_json::from_str(&text).map_err(|error| HostError::Answer(error.to_string()))?,
            Err(error) => {
                let words = error.to_string();
                self.interrupt = Some(error);
                return Err(HostError::Failed(words));
            }
        };
        match answer.get("error").and_then(Value::as_str) {
            Some(why) => Err(HostError::Failed(why.to_owned())),
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
        let made = py.detach(|| {
            let combos = grasp_verification::builtin::plans()?.plans.len();
            make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), combos, seed, true)
        });
        Ok(Self(made.map_err(|error| failure(&error))?))
    }

    /// Plays a trial under a host's policy, introduced by `guest`, and returns its record as JSON.
    fn play(
        &self,
        py: Python<'_>,
        host: Py<PyAny>,
        guest: &str,
        wall: bool,
        combination: usize,
        trial: usize,
    ) -> PyResult<String> {
        self.check(combination)?;
        let guest: Guest = serde_json::from_str(guest).map_err(value_error)?;
        let pace = if wall { Pace::Wall } else { Pace::Stand };
        let mut asked = Asked { host: &host, interrupt: None };
        let played = py.detach(|| self.0.hosted(combination, trial, (&guest, pace), &mut asked));
        if let Some(error) = asked.interrupt {
            return Err(error);
        }
        py.check_signals()?;
        let TrialOutcome { record, .. } = played.map_err(|error| failure(&error))?;
        text(&record)
    }

    /// Plays the same trial under a condition of the benchmark and returns its record as JSON.
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
