//! Bounds on the counts that a session's task may ask for.
//!
//! The file may come from a third party. A count in it is the amount of work to come.

use std::path::Path;

use ftac_platform::data::DataError;
use scenarios::Scenario;

use crate::{PoseSources, TrialTask};

/// Largest number of trials of a combination.
pub const MAX_TRIALS: usize = 100_000;
/// Tolerance of a quaternion's norm about 1.
const NORM_TOLERANCE: f64 = 1e-6;

impl TrialTask {
    /// Parses the task that the session at `path` carries, with its scenario.
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
        check_combination_count(self.combos, scenario, path)?;
        if self.combination >= self.combos {
            let expected = format!("0 to {}", self.combos - 1);
            return Err(DataError::field(path, "combination", self.combination, expected));
        }
        if self.trial >= MAX_TRIALS {
            return Err(DataError::field(path, "trial", self.trial, format!("0 to {}", MAX_TRIALS - 1)));
        }
        self.places.check(path)
    }
}

impl PoseSources {
    /// Checks the poses in the file at `path`.
    pub fn check(&self, path: &Path) -> Result<(), DataError> {
        let Some(base) = &self.base else { return Ok(()) };
        let norm = base[3..].iter().map(|part| part * part).sum::<f64>().sqrt();
        if base.iter().all(|number| number.is_finite()) && (norm - 1.0).abs() < NORM_TOLERANCE {
            return Ok(());
        }
        Err(DataError::field(path, "base", format!("{base:?}"), "a position (m) and a quaternion of norm 1"))
    }
}

/// Checks the number of combinations that the file at `path` asks for.
pub fn check_combination_count(found: usize, scenario: &Scenario, path: &Path) -> Result<(), DataError> {
    let most = scenario.combination_count();
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

    fn task(changes: &serde_json::Value) -> Result<TrialTask, DataError> {
        let mut task = json!({
            "robot": "emulated", "seed": 1, "combination": 0, "trial": 0, "condition": "touch", "watched": false, "combos": 60,
            "scenario": scenarios::scenario::BENCHMARK_TOML,
        });
        for (name, value) in changes.as_object().expect("changes") {
            task[name] = value.clone();
        }
        TrialTask::parse(task.to_string().as_bytes(), Path::new("trial.mcap")).map(|(task, _)| task)
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
}
