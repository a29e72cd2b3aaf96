//! The policy `blind`: carries out the plan without any feedback.

use dexterous_grasping::Grasp;
use world::attempt::Attempt;

use super::{Injected, Policy, PolicyError, Step, Story};
use crate::executor::{Executor, Skill};
use crate::percept::Eyes;
use crate::perception::Felt;

/// Takes one object after another with its planned grasp, whether or not the previous ones were held.
#[derive(Debug, Clone)]
pub struct Blind {
    grasps: Vec<Grasp>,
    story: Story,
}

impl Blind {
    /// The policy with the planned grasp of each object.
    pub fn new(grasps: Vec<Grasp>) -> Self {
        Self { grasps, story: Story::default() }
    }
}

impl Policy for Blind {
    fn perceive(&mut self, _: &Executor, _: Option<Injected>) -> Result<(), PolicyError> {
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, _: &mut dyn Eyes, _: f64) -> Result<Step, PolicyError> {
        let phase = executor.phase();
        if phase.skill != Skill::Look {
            return Ok(Step::Finish);
        }
        let object = phase.object + 1;
        let Some(next) = self.grasps.get(object) else {
            executor.carry_aside()?;
            return Ok(Step::Play);
        };
        if executor.take_with(object, next.clone()).is_err() {
            return Ok(Step::GiveUp);
        }
        let (grasp, why) = (next.id, "as planned, unseen".to_owned());
        self.story.attempts.push(Attempt { object, grasp, why, ..Attempt::default() });
        self.story.announcements.push("the plan is carried out unseen".to_owned());
        Ok(Step::Play)
    }

    fn story(&mut self) -> &mut Story {
        &mut self.story
    }

    fn felt(&self) -> &[Felt] {
        &[]
    }

    fn deliberates(&self) -> bool {
        false
    }
}
