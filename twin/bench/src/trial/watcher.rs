//! Watchers, which see every tick of a trial to record it.

use anyhow::Result;
use control::executor::Executor;
use control::perception::Felt;
use control::policy::Choice;
use hand_model::robot::Command;
use scenarios::record::{Condition, TrialRecord};
use sim::robot::Truth;

/// View of one tick for a watcher.
pub struct Moment<'a> {
    /// Time of the body, s.
    pub time: f64,
    /// Ground truth of the body, if it is known.
    pub truth: Option<&'a Truth>,
    /// The controller.
    pub executor: &'a Executor,
    /// Command sent in this tick, after limits; `None` if no tick passed.
    pub sent: Option<&'a Command>,
    /// Pose estimate of each object in the hand, once it was felt.
    pub felt: &'a [Felt],
    /// The condition, or `None` while all conditions share the first grasp.
    pub condition: Option<Condition>,
    /// Note about the last decision or action.
    pub note: Option<&'a str>,
    /// Options just weighed, and the chosen one.
    pub choice: Option<&'a Choice>,
    /// True if the body's objects are in the reverse of the combination's order.
    pub reversed: bool,
}

/// Observer of every tick of a trial.
pub trait Watcher {
    /// True if it records. Then every branch is played, even one whose outcome is known, and images are taken
    /// throughout.
    fn active(&self) -> bool;
    /// Processes one tick.
    fn see(&mut self, moment: &Moment) -> Result<()>;
    /// Begins a branch; everything seen so far also belongs to it.
    fn branch(&mut self, condition: Condition) -> Result<()>;
    /// Ends a branch with this record.
    fn outcome(&mut self, record: &TrialRecord) -> Result<()>;
}

/// A watcher that records nothing.
pub struct NoWatcher;

impl Watcher for NoWatcher {
    fn active(&self) -> bool {
        false
    }
    fn see(&mut self, _: &Moment) -> Result<()> {
        Ok(())
    }
    fn branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }
    fn outcome(&mut self, _: &TrialRecord) -> Result<()> {
        Ok(())
    }
}
