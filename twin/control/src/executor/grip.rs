//! Grip of the executor: which digits hold, and their cable tensions.

use dexterous_grasping::grasp::pulled_digits;
use hand_model::robot::{Observation, TactileFrame};
use hand_model::{Digit, DigitVector};

use super::{Executor, Phase, Skill, SkillStage};
use crate::motion::tension::closing_tension;
use crate::palpation;
use crate::slip::{self, SlipController};

impl Executor {
    /// Digits that keep their tension because they hold an object.
    pub fn holding_digits(&self) -> Vec<Digit> {
        pulled_digits(&self.holding_tension(self.held_count))
    }

    /// Opens all digits except `holding`.
    pub fn keep_only(&mut self, holding: &[Digit]) {
        for target in &mut self.targets[..self.held_count] {
            for digit in self.motion.hand().digits().iter().filter(|digit| !holding.contains(digit)) {
                target.grasp.close_tension[digit.index()] = 0.0;
            }
        }
    }

    /// Enables the reaction to slip while carrying: more tension. Requests images for it.
    pub fn react_to_slip(&mut self) {
        self.slip = Some(SlipController::default());
    }

    /// Number of slips felt of each object so far; empty if slip reaction is disabled.
    pub fn slip_counts(&self) -> Vec<u32> {
        self.slip.as_ref().map_or_else(Vec::new, SlipController::slip_counts)
    }

    /// Present tension set-points, N, including the increments of the slip reaction.
    pub(super) fn held_tension(&mut self, observation: &Observation, images: &[TactileFrame]) -> DigitVector {
        let (plan, carrying) = (self.required_tensions(), self.is_carrying());
        let (hand, tick) = (self.motion.hand(), self.motion.tick_length());
        let Some(watch) = &mut self.slip else { return plan };
        if !carrying {
            if !self.phase.has_begun_carry() {
                watch.begin(self.targets.iter().map(|target| target.grasp.digits.clone()));
            }
            return plan;
        }
        let most = slip::max_tension(hand);
        watch.tick(hand, &observation.servos, images, &plan, most, tick)
    }

    /// Sets the opposition of the thumb for the present or the last grasp. A thumb that holds something stays as it is.
    pub(super) fn set_opposition(&mut self) {
        let current = match self.phase.skill {
            Skill::Begin => Some(0),
            Skill::Approach | Skill::Grasp => Some(self.phase.object),
            _ => self.held_count.checked_sub(1),
        };
        let Some((current, target)) = current.and_then(|n| Some((n, self.targets.get(n)?))) else { return };
        if self.holding_tension(current)[Digit::Thumb.index()] == 0.0 {
            self.opposition = target.grasp.opposition;
        }
    }

    /// Tensions with which the digits keep the first `held` objects, N.
    fn holding_tension(&self, held: usize) -> DigitVector {
        let mut kept = self.motion.hand().slack_tensions();
        for target in &self.targets[..held] {
            for (kept, close) in kept.iter_mut().zip(target.grasp.close_tension) {
                *kept = kept.max(close);
            }
        }
        kept
    }

    /// Tensions that the grasps require in the present phase, N.
    pub fn required_tensions(&self) -> DigitVector {
        let Phase { skill, object, stage } = self.phase;
        let leaves = skill == Skill::Approach && self.retreat_start_height.is_some();
        let kept = self.holding_tension(if leaves { object.max(1) } else { self.held_count });
        let touching = palpation::palpation_tensions(self.motion.hand());
        self.motion.hand().each_digit(|digit| match skill {
            Skill::Approach if leaves => kept[digit].max(touching[digit]),
            Skill::Palpate => kept[digit].max(touching[digit]),
            Skill::Approach => kept[digit].max(self.target(object).grasp.pre_tension[digit]),
            Skill::Grasp => kept[digit].max(closing_tension(&self.target(object).grasp, digit, self.motion.clock())),
            Skill::PutDown if stage == SkillStage::Run && self.motion.clock() >= self.open_from => 0.0,
            _ => kept[digit],
        })
    }
}
