//! The exploratory motion of the policy `touch`: it touches the second object where it stands, and takes in where it is.

use grasping::Role;
use touch::{InHand, PosePrior};

use super::Touch;
use crate::executive::{Executive, Phase};
use crate::guarded::Guarded;
use crate::odds::Belief;
use crate::palpation::{self, Touching, located};
use crate::percept::Percept;
use crate::perception::{Expected, trusted};
use crate::policy::{PolicyError, Step};
use crate::strategy::clearest;

/// Standard deviation of how the second object is turned, rad.
const TURNED: f64 = 0.08;

impl Touch<'_> {
    /// Touches the second object to find out where it is, if that is possible; else takes it.
    pub(super) fn touch_or_take(&mut self, executive: &mut Executive) -> Result<Step, PolicyError> {
        let Some(onto) = self.exploration(executive)? else { return self.take_second(executive) };
        let object = &self.knowledge.objects[1];
        self.story.tell(format!("{} is touched from above to find out where it is", object.name));
        let Touching { way, onto } = onto;
        let hand = executive.hand().clone();
        let guarded = Guarded::new(onto, &hand, Role::Second.digits(), |pad| self.senses.uses(&hand, pad));
        executive.touch_second(way, guarded);
        Ok(Step::Play(Phase::Locate))
    }

    /// How the second object would be touched; `None` if there is nothing to touch it with, or the arm does not get there.
    fn exploration(&self, executive: &Executive) -> Result<Option<Touching>, PolicyError> {
        let hand = executive.hand();
        let touches = |pad: usize| palpation::is_touching(hand, pad) && self.senses.uses(hand, pad);
        let Some(felt) = self.felt.as_ref().filter(|_| self.knowledge.explores) else { return Ok(None) };
        if !(0..hand.pads.len()).any(touches) {
            return Ok(None);
        }
        let target = &self.knowledge.objects[1];
        let ways = executive.rehearsed_touches(&target.shape);
        Ok(clearest(hand, &self.held(executive, felt), (&self.solids[1], &executive.second().1), ways)?)
    }

    /// Where the object is in the hand that has just touched it.
    pub(super) fn perceive_touch(&mut self, executive: &Executive, expected: &Expected) -> Result<(), PolicyError> {
        let prior = PosePrior {
            palm_from_object: executive.palm().inverse() * executive.second().1.pose(),
            sigma_translation: self.knowledge.uncertainty.target(self.looks),
            sigma_rotation: TURNED,
        };
        let held = self.felt.as_ref().map_or(expected.palm_from_object, |felt| felt.estimate.palm_from_object);
        let held = InHand { shape: self.knowledge.known[0], prior: trusted(held) };
        self.touched = located(&self.senses, &executive.look(), self.knowledge.known[1], &prior, held)?;
        Ok(())
    }

    /// Takes in what the touch of the second object told.
    pub(super) fn locate(&mut self, executive: &mut Executive) -> Result<(), PolicyError> {
        let Some(estimate) = self.touched.take() else {
            self.story.tell("nothing was felt there".to_owned());
            return Ok(());
        };
        let (palm, seen) = (executive.palm(), executive.second().1);
        let position = (palm * estimate.palm_from_object).translation.vector;
        let turn = palm.rotation.to_rotation_matrix().into_inner();
        let covariance = turn * estimate.covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
        let (looked, level) = (self.knowledge.uncertainty.target(self.looks), self.knowledge.uncertainty.arm);
        let (off, covariance) = palpation::standing(position - seen.position.coords, &covariance, (looked, level));
        self.story.tell(format!(
            "felt ({:.0}, {:.0}, {:.0}) mm beside where it is seen",
            off.x * 1e3,
            off.y * 1e3,
            off.z * 1e3
        ));
        executive.see_second(Percept { position: seen.position + off, ..seen });
        self.located = Belief::located(&covariance);
        self.looks = 1;
        Ok(())
    }
}
