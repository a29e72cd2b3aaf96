//! Printed by `ftac sweep` with `--json`.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Serialize;
use sweep::makespan::Point;
use sweep::merge::Merged;
use sweep::slurm::Task;

/// Printed by `sweep plan`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Planned<'a> {
    /// The sweep's name.
    pub(super) name: &'a str,
    /// Points: one value of each axis but seed, policy and ablation.
    pub(super) points: usize,
    /// Trials, each under one policy.
    pub(super) trials: usize,
    /// Names of the units of work, by their content.
    pub(super) units: Vec<&'a str>,
    /// Expected time of one core, s.
    pub(super) core_s: f64,
    /// Expected time on this machine, s.
    pub(super) wall_s: f64,
    /// Expected size of the units' files, bytes.
    pub(super) bytes: f64,
    /// Tells sweeps apart.
    pub(super) sweep: String,
}

/// A unit that could not be played.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FailedUnit {
    /// The unit's name.
    pub(super) unit: String,
    /// Reason.
    pub(super) reason: String,
}

/// A unit whose files were broken.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BrokenUnit {
    /// The unit's name.
    pub(super) unit: String,
    /// Fault of its file.
    pub(super) reason: String,
}

/// Printed by `sweep merge`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Joined {
    /// Units that were joined.
    pub(super) units: usize,
    /// Units that are not finished.
    pub(super) missing: usize,
    /// Units whose files were broken; they were laid aside.
    pub(super) broken: Vec<BrokenUnit>,
    /// Rows of the trials' table.
    pub(super) trials: usize,
    /// Rows of the tries' table.
    pub(super) tries: usize,
    /// Time that the units took, summed, s.
    pub(super) core_s: f64,
    /// Of all rows but what is wall time: the same results have the same digest.
    pub(super) digest: String,
}

impl Joined {
    pub(super) fn of(merged: Merged) -> Self {
        let Merged { units, missing, broken, trials, tries, core_s, digest } = merged;
        let broken = broken.into_iter().map(|(unit, reason)| BrokenUnit { unit, reason }).collect();
        Self { units, missing, broken, trials, tries, core_s, digest }
    }
}

/// Printed by `sweep run`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Played {
    /// The result folder.
    pub(super) folder: PathBuf,
    /// Units that this process played.
    pub(super) played: usize,
    /// Units that are finished.
    pub(super) finished: usize,
    /// Units of the sweep.
    pub(super) units: usize,
    /// Units that could not be played.
    pub(super) failed: Vec<FailedUnit>,
    /// Time of this process, s.
    pub(super) wall_s: f64,
    /// Joined results; none of a worker.
    pub(super) merged: Option<Joined>,
}

/// Printed by `sweep submit`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Handed {
    /// The result folder.
    pub(super) folder: PathBuf,
    /// Outcome: submitted, joined (jobs of this sweep are under way) or finished.
    pub(super) outcome: &'static str,
    /// Job of the workers.
    pub(super) array: Option<u64>,
    /// Job that joins their results.
    pub(super) merge: Option<u64>,
    /// Workers.
    pub(super) workers: Option<usize>,
}

/// A unit whose last attempt failed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FailedAttempt {
    /// The unit's name.
    pub(super) unit: String,
    /// Reason.
    pub(super) reason: String,
    /// Machine, process and job.
    pub(super) by: String,
}

/// Printed by `sweep status`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Standing {
    /// The sweep's name.
    pub(super) name: String,
    /// Units that are finished.
    pub(super) finished: usize,
    /// Units of the sweep.
    pub(super) units: usize,
    /// Units that somebody plays.
    pub(super) running: usize,
    /// Units whose last attempt failed.
    pub(super) failed: Vec<FailedAttempt>,
    /// Trials of the finished units.
    pub(super) trials: usize,
    /// Trials of the sweep.
    pub(super) of_trials: usize,
    /// Over the last quarter of an hour.
    pub(super) trials_per_minute: Option<f64>,
    /// Time left at that rate, s.
    pub(super) left_s: Option<f64>,
    /// State of the jobs by Slurm.
    pub(super) jobs: Vec<Task>,
    /// Error of the question to Slurm.
    pub(super) slurm_error: Option<String>,
}

/// Printed by `sweep makespan`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Replayed {
    /// A number of cores each.
    pub(super) points: Vec<Point>,
}
