//! The conditions of one trial, one after the other. Those that grasp the first object as planned start from the same
//! first grasp.

use anyhow::Result;
use control::policy::Recovery;
use scenarios::Ablation;
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord};
use scenarios::tries::TryRecord;

use super::branch::TrialOutcome;
use super::eyes::Looks;
use super::means::Means;
use super::setup::{Setup, Start};
use super::shared::Bench;
use super::watcher::Watcher;
use fault_detection::divergence::Named;

impl From<Ablation> for Means {
    fn from(ablation: Ablation) -> Self {
        let recovery = Recovery { retry: ablation != Ablation::NoRetry, new_look: ablation != Ablation::NoNewLook };
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
    /// Ablations: the policy `touch` with one of its means removed.
    pub ablated: Vec<AblatedTrial>,
    /// Diagnoses of a mirror, if one ran.
    pub divergences: Vec<Named>,
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
    pub setup: &'a Setup<'a>,
    /// State after the first grasp.
    pub start: Start,
    /// Generators of the trial's later looks.
    pub looks: Looks,
}

impl Branches<'_> {
    /// Plays one condition.
    pub fn play(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        match Means::of(id.condition) {
            _ if id.condition == Condition::Own => self.own(id, watcher),
            None => self.bench.plan(&self.start, self.bench.options(id, self.looks.clone()), watcher),
            Some(means) => self.deliberate(id, means, watcher),
        }
    }

    /// Plays the user's own policy.
    fn own(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let Self { bench, setup, start, looks } = self;
        let options = bench.options(id, looks.clone());
        if bench.begins_otherwise(Condition::Own) {
            return bench.own(&setup.at_rest(bench, None, watcher)?, options, watcher);
        }
        bench.own(start, options, watcher)
    }

    /// Plays a policy that decides, with the `means` that are left to it.
    pub fn deliberate(&self, id: TrialId, means: Means, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let Self { bench, setup, start, looks } = self;
        let options = bench.options(id, looks.clone());
        if let Some(why) = bench.intact.as_ref().and_then(|intact| intact.impossible.get(&id.combination)) {
            return bench.decline(setup, id, why, watcher);
        }
        let own = bench.intact.as_ref().map(|_| setup.without_digits(bench, id.combination));
        let mut start = match (means.begin_otherwise(), own) {
            (true, own) => own.as_ref().unwrap_or(setup).ordered(bench, means)?.at_rest(bench, None, watcher)?,
            (false, Some(own)) => own.first_grasp(bench, None, watcher)?,
            (false, None) => Start::clone(start),
        };
        if bench.world.scenario.disturbance.slip.is_some_and(|slip| slip.reaction) {
            start.run.snapshot.executor.react_to_slip();
        }
        bench.touch(&start, options, means, watcher)
    }
}
