//! The conditions of one trial, one after the other: those that take the first object as planned from the same first grasp.

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

/// What one trial comes to.
#[derive(Debug, Clone, Default)]
pub struct TrialResults {
    /// A record a condition.
    pub records: Vec<TrialRecord>,
    /// Their tries.
    pub tries: Vec<TryRecord>,
    /// The policy `touch` with one of its means taken away.
    pub ablated: Vec<AblatedTrial>,
    /// What a mirror named, where one looked on.
    pub divergences: Vec<Named>,
}

impl TrialResults {
    /// One condition more.
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
    /// What all trials share.
    pub bench: &'a Bench,
    /// How it began.
    pub setup: &'a Setup<'a>,
    /// After the first grasp.
    pub start: Start,
    /// Generators of the trial's later looks.
    pub looks: Looks,
}

impl Branches<'_> {
    /// One condition.
    pub fn play(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        match Means::of(id.condition) {
            _ if id.condition == Condition::Own => self.own(id, watcher),
            None => self.bench.plan(&self.start, self.bench.options(id, self.looks.clone()), watcher),
            Some(means) => self.deliberate(id, means, watcher),
        }
    }

    /// The user's own policy.
    fn own(&self, id: TrialId, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let Self { bench, setup, start, looks } = self;
        let options = bench.options(id, looks.clone());
        if bench.begins_otherwise(Condition::Own) {
            return bench.own(&setup.at_rest(bench, None, watcher)?, options, watcher);
        }
        bench.own(start, options, watcher)
    }

    /// One that decides, with what `means` leaves it.
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
