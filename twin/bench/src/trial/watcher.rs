//! Watchers: whoever records a trial sees every tick of it.

use anyhow::Result;
use control::executor::Executor;
use control::perception::Felt;
use control::policy::Choice;
use hand_model::robot::Command;
use scenarios::record::{Condition, TrialRecord};
use sim::robot::Truth;

/// What a watcher sees of a tick.
pub struct Moment<'a> {
    /// Time of the body, s.
    pub time: f64,
    /// The body's truth, where somebody knows it.
    pub truth: Option<&'a Truth>,
    /// The controller.
    pub executor: &'a Executor,
    /// What was sent in this tick, after limits; `None` where no tick passed.
    pub sent: Option<&'a Command>,
    /// Pose estimate of each object in the hand, once it was felt.
    pub felt: &'a [Felt],
    /// The condition, or `None` while all conditions share the first grasp.
    pub condition: Option<Condition>,
    /// What was just decided or done.
    pub note: Option<&'a str>,
    /// What was just weighed and chosen.
    pub choice: Option<&'a Choice>,
    /// The body's objects are in the other order than the combination names them.
    pub reversed: bool,
}

/// Sees every tick of a trial.
pub trait Watcher {
    /// Whether it records: then every branch is played, even one whose outcome is known, and images are taken throughout.
    fn active(&self) -> bool;
    /// One tick.
    fn see(&mut self, moment: &Moment) -> Result<()>;
    /// A branch begins: everything seen so far also belongs to it.
    fn branch(&mut self, condition: Condition) -> Result<()>;
    /// A branch ended with this record.
    fn outcome(&mut self, record: &TrialRecord) -> Result<()>;
}

/// Watches nothing.
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
