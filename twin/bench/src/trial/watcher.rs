//! Watchers, which observe every tick of a trial to record it.

use anyhow::Result;
use control::executor::Executor;
use control::perception::ObjectEstimate;
use control::policy::DecisionRecord;
use hand_model::robot::RobotCommand;
use scenarios::record::{Condition, TrialRecord};
use sim::robot::GroundTruth;

/// View of one tick for a watcher.
pub struct TickView<'a> {
    /// Time of the backend, s.
    pub time: f64,
    /// Ground truth of the backend, if known.
    pub truth: Option<&'a GroundTruth>,
    /// The controller.
    pub executor: &'a Executor,
    /// Command sent in this tick, after limits; `None` if no tick passed.
    pub sent: Option<&'a RobotCommand>,
    /// Pose estimate of each object in the hand, once touch has made one.
    pub felt: &'a [ObjectEstimate],
    /// The condition, or `None` while all conditions share the first grasp.
    pub condition: Option<Condition>,
    /// Note about the last decision or action.
    pub note: Option<&'a str>,
    /// Options just scored, and the chosen one.
    pub choice: Option<&'a DecisionRecord>,
    /// True if the backend's objects are in the reverse of the combination's order.
    pub reversed: bool,
}

/// Observer of every tick of a trial.
pub trait Watcher {
    /// True if it records. Then every branch is run, even one whose outcome is known, and images are taken throughout.
    fn is_active(&self) -> bool;
    /// Processes one tick.
    fn on_tick(&mut self, moment: &TickView) -> Result<()>;
    /// Begins a branch; all earlier ticks also belong to it.
    fn on_branch(&mut self, condition: Condition) -> Result<()>;
    /// Ends a branch with this record.
    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()>;
}

/// A watcher that records nothing.
pub struct NoWatcher;

impl Watcher for NoWatcher {
    fn is_active(&self) -> bool {
        false
    }
    fn on_tick(&mut self, _: &TickView) -> Result<()> {
        Ok(())
    }
    fn on_branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }
    fn on_outcome(&mut self, _: &TrialRecord) -> Result<()> {
        Ok(())
    }
}
