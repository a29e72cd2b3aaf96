//! JSON output of `ftac sweep`.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Serialize;
use sweep::makespan::MakespanPoint;
use sweep::merge::MergeResult;
use sweep::slurm::SlurmTask;

/// JSON output of `sweep plan`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SweepPlanOutput<'a> {
    /// Name of the sweep.
    pub(super) name: &'a str,
    /// Number of points: combinations of one value of each axis except seed, policy and ablation.
    pub(super) points: usize,
    /// Number of trials, each under one policy.
    pub(super) trials: usize,
    /// Names of the units of work, derived from their content.
    pub(super) units: Vec<&'a str>,
    /// Expected time on one core, s.
    pub(super) core_s: f64,
    /// Expected time on this machine, s.
    pub(super) wall_s: f64,
    /// Expected size of the units' files, bytes.
    pub(super) bytes: f64,
    /// Identity of the sweep.
    pub(super) sweep: String,
}

/// A unit that could not be run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FailedUnit {
    /// Name of the unit.
    pub(super) unit: String,
    /// Reason of the failure.
    pub(super) reason: String,
}

/// A unit with broken files.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BrokenUnit {
    /// Name of the unit.
    pub(super) unit: String,
    /// Defect of its file.
    pub(super) reason: String,
}

/// JSON output of `sweep merge`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct MergeOutput {
    /// Number of merged units.
    pub(super) units: usize,
    /// Number of unfinished units.
    pub(super) missing: usize,
    /// Units with broken files, which were set aside.
    pub(super) broken: Vec<BrokenUnit>,
    /// Number of rows of the table of trials.
    pub(super) trials: usize,
    /// Number of rows of the table of tries.
    pub(super) tries: usize,
    /// Sum of the times that the units took, s.
    pub(super) core_s: f64,
    /// Digest of all rows without wall times: the same results have the same digest.
    pub(super) digest: String,
}

impl MergeOutput {
    pub(super) fn from_merged(merged: MergeResult) -> Self {
        let MergeResult { units, missing, broken, trials, tries, core_s, digest } = merged;
        let broken = broken.into_iter().map(|(unit, reason)| BrokenUnit { unit, reason }).collect();
        Self { units, missing, broken, trials, tries, core_s, digest }
    }
}

/// JSON output of `sweep run`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SweepRunOutput {
    /// The result folder.
    pub(super) folder: PathBuf,
    /// Number of units that this process ran.
    pub(super) run: usize,
    /// Number of finished units.
    pub(super) finished: usize,
    /// Number of units of the sweep.
    pub(super) units: usize,
    /// Units that could not be run.
    pub(super) failed: Vec<FailedUnit>,
    /// Wall time of this process, s.
    pub(super) wall_s: f64,
    /// Merged results; none for a worker.
    pub(super) merged: Option<MergeOutput>,
}

/// JSON output of `sweep submit`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SubmitOutput {
    /// The result folder.
    pub(super) folder: PathBuf,
    /// Outcome: submitted, joined (jobs of this sweep are already under way) or finished.
    pub(super) outcome: &'static str,
    /// Slurm job of the workers.
    pub(super) array: Option<u64>,
    /// Slurm job that merges their results.
    pub(super) merge: Option<u64>,
    /// Number of workers.
    pub(super) workers: Option<usize>,
}

/// A unit whose last attempt failed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FailedAttempt {
    /// Name of the unit.
    pub(super) unit: String,
    /// Reason of the failure.
    pub(super) reason: String,
    /// Machine, process and job of the attempt.
    pub(super) by: String,
}

/// JSON output of `sweep status`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct StatusOutput {
    /// Name of the sweep.
    pub(super) name: String,
    /// Number of finished units.
    pub(super) finished: usize,
    /// Number of units of the sweep.
    pub(super) units: usize,
    /// Number of units under way.
    pub(super) running: usize,
    /// Units whose last attempt failed.
    pub(super) failed: Vec<FailedAttempt>,
    /// Number of trials of the finished units.
    pub(super) trials: usize,
    /// Number of trials of the sweep.
    pub(super) of_trials: usize,
    /// Rate over the last quarter of an hour, 1/min.
    pub(super) trials_per_minute: Option<f64>,
    /// Remaining time at that rate, s.
    pub(super) left_s: Option<f64>,
    /// States of the jobs as Slurm reports them.
    pub(super) jobs: Vec<SlurmTask>,
    /// Error of the query to Slurm.
    pub(super) slurm_error: Option<String>,
}

/// JSON output of `sweep makespan`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct MakespanOutput {
    /// One entry per number of cores.
    pub(super) points: Vec<MakespanPoint>,
}
