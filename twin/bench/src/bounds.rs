//! How much a session's task or a result's run may ask for: no more than there can be.
//!
//! Both are files that others may have written. A count in one is the length of work to come.

use std::path::Path;

use platform::data::DataError;
use scenarios::Scenario;

use crate::body::{Places, Task};
use crate::journal::RunRequest;

/// Most trials of a combination.
pub const MOST_TRIALS: usize = 100_000;
/// Largest factor of a scenario's noise.
const MOST_NOISE: f64 = 10.0;
/// How far the norm of a quaternion may be from 1.
const NORM: f64 = 1e-6;

impl Task {
    /// The task that the session at `path` carries, and its scenario.
    pub fn parse(text: &[u8], path: &Path) -> Result<(Self, Scenario), DataError> {
        let task: Self = serde_json::from_slice(text).map_err(|error| {
            let expected = "a trial recorded by `ftac trial --session` or `ftac bench`";
            DataError::field(path, "task", format!("no trial ({error})"), expected)
        })?;
        let scenario = Scenario::parse(&task.scenario, path)?;
        task.check(&scenario, path)?;
        Ok((task, scenario))
    }

    fn check(&self, scenario: &Scenario, path: &Path) -> Result<(), DataError> {
        combinations(self.combos, scenario, path)?;
        if self.combination >= self.combos {
            let expected = format!("0 to {}", self.combos - 1);
            return Err(DataError::field(path, "combination", self.combination, expected));
        }
        if self.trial >= MOST_TRIALS {
            return Err(DataError::field(path, "trial", self.trial, format!("0 to {}", MOST_TRIALS - 1)));
        }
        self.places.check(path)
    }
}

impl RunRequest {
    /// Checks what the run kept at `path` asks for.
    pub fn check(&self, path: &Path) -> Result<(), DataError> {
        let scenario = Scenario::parse(&self.scenario, path)?;
        combinations(self.combos, &scenario, path)?;
        if !(1..=MOST_TRIALS).contains(&self.trials) {
            return Err(DataError::field(path, "trials", self.trials, format!("1 to {MOST_TRIALS}")));
        }
        let (shard, of) = self.shard;
        if !(1..=of).contains(&shard) {
            return Err(DataError::field(path, "shard", format!("[{shard}, {of}]"), "[i, n] with 1 <= i <= n"));
        }
        if !(0.0..=MOST_NOISE).contains(&self.noise_scale) {
            return Err(DataError::field(path, "noise_scale", self.noise_scale, format!("0 to {MOST_NOISE}")));
        }
        self.places.check(path)
    }
}

impl Places {
    fn check(&self, path: &Path) -> Result<(), DataError> {
        let Some(base) = &self.base else { return Ok(()) };
        let norm = base[3..].iter().map(|part| part * part).sum::<f64>().sqrt();
        if base.iter().all(|number| number.is_finite()) && (norm - 1.0).abs() < NORM {
            return Ok(());
        }
        Err(DataError::field(path, "base", format!("{base:?}"), "a place (m) and a quaternion of norm 1"))
    }
}

fn combinations(found: usize, scenario: &Scenario, path: &Path) -> Result<(), DataError> {
    let most = scenario.combinations();
    let good = (1..=most).contains(&found);
    if good {
        Ok(())
    } else {
        Err(DataError::field(path, "combos", found, format!("1 to {most}, the scenario's pairs")))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn task(changes: &serde_json::Value) -> Result<Task, DataError> {
        let mut task = json!({
            "robot": "emulated", "seed": 1, "combination": 0, "trial": 0, "condition": "touch", "watched": false, "combos": 60,
            "scenario": scenarios::scenario::BENCHMARK,
        });
        for (name, value) in changes.as_object().expect("changes") {
            task[name] = value.clone();
        }
        Task::parse(task.to_string().as_bytes(), Path::new("trial.mcap")).map(|(task, _)| task)
    }

    #[test]
    fn a_session_asks_for_no_more_than_there_is() {
        assert_eq!(task(&json!({})).expect("a task").combos, 60);
        let scenario = "version = 1\nname = \"theirs\"\nextends = \"benchmark\"\nobjects = [\"/etc/shadow\"]\n";
        for (changes, words) in [
            (json!({ "combos": 1_000_000_000_000_u64 }), "trial.mcap: combos: found 1000000000000, expected 1 to "),
            (json!({ "combos": 0 }), "combos: found 0, expected 1 to "),
            (json!({ "combination": 60 }), "combination: found 60, expected 0 to 59"),
            (json!({ "trial": u64::MAX }), "trial: found 18446744073709551615, expected 0 to 99999"),
            (json!({ "base": [0, 0, 0, 0, 0, 0, 0] }), "base: found [0.0, "),
            (json!({ "scenario": scenario }), "trial.mcap: objects[0]: found \"/etc/shadow\", expected no file"),
            (json!({ "robot": 7 }), "trial.mcap: task: found no trial (invalid type: integer `7`"),
        ] {
            let error = task(&changes).expect_err("refused").to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_run_asks_for_no_more_than_there_is() {
        let run = |changes: &serde_json::Value| {
            let mut run = json!({
                "combos": 2, "trials": 2, "seed": 1, "robot": "sim", "shard": [1, 1], "scenario": scenarios::scenario::BENCHMARK,
            });
            for (name, value) in changes.as_object().expect("changes") {
                run[name] = value.clone();
            }
            serde_json::from_value::<RunRequest>(run).expect("a run").check(Path::new("run.json"))
        };
        run(&json!({})).expect("a run");
        for (changes, words) in [
            (json!({ "combos": 1_000_000_000_000_u64 }), "run.json: combos: found 1000000000000"),
            (json!({ "trials": 1_000_000_000_000_u64 }), "trials: found 1000000000000, expected 1 to 100000"),
            (json!({ "shard": [3, 2] }), "shard: found [3, 2]"),
            (json!({ "noise_scale": 1e300 }), "noise_scale: found 1"),
        ] {
            let error = run(&changes).expect_err("refused").to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
