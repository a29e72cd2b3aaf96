//! Bounds on the counts in the request of a run.
//!
//! The file may come from a third party, and its counts set the amount of work.

use std::path::Path;

use ftac_platform::data::DataError;
use robot_backends::validation::{MAX_TRIALS, check_combination_count};
use scenarios::Scenario;

use crate::journal::RunRequest;

/// Largest factor of a scenario's noise.
const MAX_NOISE_SCALE: f64 = 10.0;

impl RunRequest {
    /// Checks that the request of the run at `path` is within bounds.
    pub fn check(&self, path: &Path) -> Result<(), DataError> {
        let scenario = Scenario::parse(&self.scenario, path)?;
        check_combination_count(self.combos, &scenario, path)?;
        if !(1..=MAX_TRIALS).contains(&self.trials) {
            return Err(DataError::field(path, "trials", self.trials, format!("1 to {MAX_TRIALS}")));
        }
        let (shard, of) = self.shard;
        if !(1..=of).contains(&shard) {
            return Err(DataError::field(path, "shard", format!("[{shard}, {of}]"), "[i, n] with 1 <= i <= n"));
        }
        if !(0.0..=MAX_NOISE_SCALE).contains(&self.noise_scale) {
            return Err(DataError::field(path, "noise_scale", self.noise_scale, format!("0 to {MAX_NOISE_SCALE}")));
        }
        self.places.check(path)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_run_asks_for_no_more_than_there_is() {
        let run = |changes: &serde_json::Value| {
            let mut run = json!({
                "combos": 2, "trials": 2, "seed": 1, "robot": "sim", "shard": [1, 1], "scenario": scenarios::scenario::BENCHMARK_TOML,
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
