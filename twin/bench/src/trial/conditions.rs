//! The conditions of one trial, one after the other. Those that grasp the first object as planned start from the same
//! first grasp.

use anyhow::Result;
use control::policy::Recovery;
use scenarios::Ablation;
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord};
use scenarios::tries::TryRecord;

use super::branch::TrialOutcome;
use super::capabilities::PolicyCapabilities;
use super::setup::{InitialConditions, PreparedTrial};
use super::shared::Bench;
use super::simulated_detector::DetectionNoise;
use super::watcher::Watcher;
use fault_detection::fault::FaultRow;

impl From<Ablation> for PolicyCapabilities {
    fn from(ablation: Ablation) -> Self {
        let recovery =
            Recovery { retry: ablation != Ablation::NoRetry, new_detection: ablation != Ablation::NoNewDetection };
        Self { sensing: ablation.sensing(), recovery, explores: ablation != Ablation::NoExploration }
    }
}

/// Results of one trial.
#[derive(Debug, Clone, Default)]
pub struct TrialResults {
    /// One record per condition.
    pub records: Vec<TrialRecord>,
    /// Tries of the records.
    pub tries: Vec<TryRecord>,
    /// Ablations: the policy `touch` with one of its capabilities removed.
    pub ablated: Vec<AblatedTrial>,
    /// Detected faults, if fault detection ran.
    pub faults: Vec<FaultRow>,
}

impl TrialResults {
    /// Adds the outcome of another condition.
    pub fn add(&mut self, outcome: TrialOutcome) {
        self.records.push(outcome.record);
        self.tries.extend(outcome.tries);
    }
}

impl From<TrialOutcome> for TrialResults {
    fn from(outcome: TrialOutcome) -> Self {
        Self { records: vec![outcome.record], tries: outcome.tries, ..Self::default() }
    }
}

/// A trial from which conditions branch off.
pub struct Branches<'a> {
    /// Data that all trials share.
    pub bench: &'a Bench,
    /// Setup of the trial.
    pub setup: &'a InitialConditions<'a>,
    /// State after the first grasp.
    pub start: PreparedTrial,
    /// Generators of the trial's later detections.
    pub detection_noise: DetectionNoise,
}

impl Branches<'_> {
    /// Runs one condition.
    pub fn run(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        match PolicyCapabilities::for_condition(id.condition) {
            _ if id.condition == Condition::External => self.run_external_policy(id, watcher),
            None => {
                self.bench.run_blind(&self.start, self.bench.branch_settings(id, self.detection_noise.clone()), watcher)
            }
            Some(means) => self.run_deciding_policy(id, means, watcher),
        }
    }

    /// Runs the external policy.
    fn run_external_policy(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let Self { bench, setup, start, detection_noise: detections } = self;
        let options = bench.branch_settings(id, detections.clone());
        if bench.skips_planned_grasp(Condition::External) {
            return bench.run_external_policy(&setup.begin_at_rest(bench, None, watcher)?, options, watcher);
        }
        bench.run_external_policy(start, options, watcher)
    }

    /// Runs a policy that decides, with the `means` that are left to it.
    pub fn run_deciding_policy(
        &self,
        id: TrialId,
        means: PolicyCapabilities,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let Self { bench, setup, start, detection_noise: detections } = self;
        let options = bench.branch_settings(id, detections.clone());
        if let Some(why) = bench.intact_grasps.as_ref().and_then(|intact| intact.impossible.get(&id.combination)) {
            return bench.declined_trial(setup, id, why, watcher);
        }
        let own = bench.intact_grasps.as_ref().map(|_| setup.without_digits(bench, id.combination));
        let mut start = match (means.may_skip_planned_grasp(), own) {
            (true, own) => {
                own.as_ref().unwrap_or(setup).reordered_for(bench, means)?.begin_at_rest(bench, None, watcher)?
            }
            (false, Some(own)) => own.run_first_grasp(bench, None, watcher)?,
            (false, None) => PreparedTrial::clone(start),
        };
        if bench.world.scenario.disturbance.slip.is_some_and(|slip| slip.reaction) {
            start.run.snapshot.executor.react_to_slip();
        }
        bench.run_touch(&start, options, means, watcher)
    }
}
