//! The policy `blind`: carries out the plan without any feedback.

use dexterous_grasping::Grasp;
use world::attempt::Attempt;

use super::{DecisionTrace, InjectedHold, PolicyError, PolicyStep, TrialPolicy};
use crate::detection::ObjectDetector;
use crate::executor::{Executor, Skill};
use crate::perception::ObjectEstimate;

/// Takes one object after another with its planned grasp, whether or not the previous ones were held.
#[derive(Debug, Clone)]
pub struct BlindPolicy {
    grasps: Vec<Grasp>,
    trace: DecisionTrace,
}

impl BlindPolicy {
    /// The policy with the planned grasp of each object.
    pub fn new(grasps: Vec<Grasp>) -> Self {
        Self { grasps, trace: DecisionTrace::default() }
    }
}

impl TrialPolicy for BlindPolicy {
    fn perceive(&mut self, _: &Executor, _: Option<InjectedHold>) -> Result<(), PolicyError> {
        Ok(())
    }

    fn decide(
        &mut self,
        executor: &mut Executor,
        _: &mut dyn ObjectDetector,
        _: f64,
    ) -> Result<PolicyStep, PolicyError> {
        let phase = executor.phase();
        if phase.skill != Skill::Snapshot {
            return Ok(PolicyStep::Finish);
        }
        let object = phase.object + 1;
        let Some(next) = self.grasps.get(object) else {
            executor.carry_aside()?;
            return Ok(PolicyStep::Continue);
        };
        if executor.take_with(object, next.clone()).is_err() {
            return Ok(PolicyStep::GiveUp);
        }
        let (grasp, why) = (next.id, "as planned, without feedback".to_owned());
        self.trace.attempts.push(Attempt { object, grasp, why, ..Attempt::default() });
        self.trace.announcements.push("the plan is carried out without feedback".to_owned());
        Ok(PolicyStep::Continue)
    }

    fn trace(&mut self) -> &mut DecisionTrace {
        &mut self.trace
    }

    fn felt(&self) -> &[ObjectEstimate] {
        &[]
    }

    fn deliberates(&self) -> bool {
        false
    }
}
