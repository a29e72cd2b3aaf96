//! The policy `blind`: carries out the plan and asks nobody.

use grasping::Grasp;
use world::attempt::Attempt;

use super::{Injected, Policy, PolicyError, Step, Story};
use crate::executor::{Executor, Skill};
use crate::percept::Eyes;
use crate::perception::Felt;

/// Takes the second object with the planned grasp, whatever happened to the first.
#[derive(Debug, Clone)]
pub struct Blind {
    second: Grasp,
    story: Story,
}

impl Blind {
    /// With `second` as the planned grasp of the second object.
    pub fn new(second: Grasp) -> Self {
        Self { second, story: Story::default() }
    }
}

impl Policy for Blind {
    fn perceive(&mut self, _: &Executor, _: Option<Injected>) -> Result<(), PolicyError> {
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, _: &mut dyn Eyes, _: f64) -> Result<Step, PolicyError> {
        let phase = executor.phase();
        match phase.skill {
            Skill::Look if phase.object == 0 => Ok(match executor.take_with(1, self.second.clone()) {
                Ok(()) => {
                    let (grasp, why) = (self.second.id, "as planned, unseen".to_owned());
                    self.story.attempts.push(Attempt { object: 1, grasp, why, ..Attempt::default() });
                    self.story.announcements.push("the plan is carried out unseen".to_owned());
                    Step::Play
                }
                Err(_) => Step::GiveUp,
            }),
            Skill::Look => {
                executor.carry_aside()?;
                Ok(Step::Play)
            }
            _ => Ok(Step::Finish),
        }
    }

    fn story(&mut self) -> &mut Story {
        &mut self.story
    }

    fn felt(&self) -> Option<&Felt> {
        None
    }

    fn deliberates(&self) -> bool {
        false
    }
}
