//! Exploratory motion of the policy `touch`: palpates an object where it stands, and updates its position.

use dexterous_grasping::digit_sets;
use hand_model::Hand;
use nalgebra::{Isometry3, Matrix3};
use tactile_perception::{InHand, PoseEstimate, PosePrior};

use super::{State, Touch};
use crate::executor::Executor;
use crate::guarded::Guarded;
use crate::odds::Belief;
use crate::palpation::{self, Touching, located};
use crate::percept::Percept;
use crate::perception::{Expected, trusted};
use crate::policy::{Knowledge, PolicyError, Step};
use crate::sensing::Senses;
use crate::strategy::{Held, clearest, promise};
use crate::worth::Candidate;

/// Standard deviation of an object's rotation in the prior, rad.
const TURNED: f64 = 0.08;
/// Smallest increase of the best grasp's worth for which a touch, which takes some 3 s, pays; set by hand.
const TOUCH_PAYS: f64 = 0.06;

/// True if an object is palpated before it is grasped. That requires usable pads that form one surface, and a touch
/// that locates the object more precisely than `sigma` (m, each axis), the standard deviation without it.
pub(super) fn explores(knowledge: &Knowledge, senses: &Senses, sigma: f64) -> bool {
    let hand = &knowledge.cell.robot.hand;
    let touches = |pad: &usize| senses.uses(hand, *pad);
    // Jaws have no free digit to touch with.
    let free = hand.jaws().is_none() && palpation::plate(hand).iter().any(touches);
    knowledge.explores && sigma > palpation::LEFT_OVER && free
}

/// Returns the belief about the place of an object that has been touched.
pub(super) fn touched() -> Option<Belief> {
    Belief::located(&Matrix3::from_diagonal_element(palpation::LEFT_OVER.powi(2)))
}

impl Touch<'_> {
    /// Palpates the first or second `object` to locate it, if that is possible and pays; otherwise takes it.
    pub(super) fn touch_or_take(&mut self, object: usize, executor: &mut Executor) -> Result<Step, PolicyError> {
        if let Some([seen, touched]) = self.prospects(object, executor)
            && touched - seen < TOUCH_PAYS
        {
            let name = &self.knowledge.objects[object].name;
            self.story.tell(format!(
                "{name} is not touched: the best grasp promises {seen:.2} where it is seen, and {touched:.2} where it is felt"
            ));
            return self.take(object, executor);
        }
        let Some(Touching { way, onto }) = self.exploration(object, executor)? else {
            return self.take(object, executor);
        };
        let name = &self.knowledge.objects[object].name;
        self.story.tell(format!("{name} is touched from above to find out where it is"));
        let hand = executor.motion().hand().clone();
        let guarded = Guarded::new(onto, &hand, &palpation::fingers(&hand), |pad| self.senses.uses(&hand, pad));
        executor.palpate(object, way, guarded);
        self.state = State::Palpates { object, found: None };
        Ok(Step::Play)
    }

    /// [`prospects`] of the second object; `None` for the first one, and where no touch is possible.
    fn prospects(&self, object: usize, executor: &Executor) -> Option<[f64; 2]> {
        let felt = self.felt.as_ref().filter(|_| object == 1)?;
        explores(&self.knowledge, &self.senses, self.expected_error(object)).then_some(())?;
        let (_, following) = self.following(executor);
        prospects(&self.beside_felt(following, felt), &self.belief)
    }

    /// Palpation of an object; `None` if there are no pads for it, or the arm cannot get there.
    fn exploration(&self, object: usize, executor: &Executor) -> Result<Option<Touching>, PolicyError> {
        if !explores(&self.knowledge, &self.senses, self.expected_error(object)) {
            return Ok(None);
        }
        let hand = executor.motion().hand();
        let held = match (object, &self.felt) {
            (0, _) => empty(hand),
            (_, Some(felt)) => self.held(executor, felt),
            (_, None) => return Ok(None),
        };
        let seen = &executor.target(object).percept;
        let ways = executor.rehearsed_touches(object, &self.knowledge.objects[object].shape);
        Ok(clearest(hand, &held, (&self.solids[object], seen), ways)?)
    }

    /// Standard deviation of the hand's position relative to an object that only the eyes have located, each axis, m.
    fn expected_error(&self, object: usize) -> f64 {
        let tracked = &self.objects[object];
        tracked.uncertainty(&self.knowledge).target(tracked.looks)
    }

    /// Estimates the pose in the hand of an object that it has just touched.
    pub(super) fn perceive_touch(
        &mut self,
        object: usize,
        executor: &Executor,
        expected: &Expected,
    ) -> Result<(), PolicyError> {
        let seen = &executor.target(object).percept;
        let prior = PosePrior {
            palm_from_object: executor.motion().palm().inverse() * seen.pose(),
            sigma_translation: self.expected_error(object),
            sigma_rotation: TURNED,
        };
        let held = self.felt.as_ref().map_or(expected.palm_from_object, |felt| felt.estimate.palm_from_object);
        let held = (object == 1).then(|| InHand { shape: self.knowledge.known[0], prior: trusted(held) });
        let found = located(&self.senses, &executor.motion().look(), self.knowledge.known[object], &prior, held)?;
        self.state = State::Palpates { object, found: found.map(Box::new) };
        Ok(())
    }

    /// Updates the percept and the belief with the result of a touch.
    pub(super) fn locate(&mut self, object: usize, executor: &mut Executor, found: Option<Box<PoseEstimate>>) {
        let (palm, seen) = (executor.motion().palm(), executor.target(object).percept);
        let Some((found, covariance)) = self.found(object, found, palm, &seen) else { return };
        executor.see(object, found);
        let tracked = &mut self.objects[object];
        (tracked.located, tracked.looks) = (Belief::located(&covariance), 1);
    }

    /// Percept of the touched `object` from its estimate `found` in the hand and its percept `seen`, and the covariance
    /// of its position, m2; world frame.
    fn found(
        &mut self,
        object: usize,
        found: Option<Box<PoseEstimate>>,
        palm: Isometry3<f64>,
        seen: &Percept,
    ) -> Option<(Percept, Matrix3<f64>)> {
        let Some(estimate) = found else {
            self.story.tell("nothing was felt there".to_owned());
            return None;
        };
        let position = (palm * estimate.palm_from_object).translation.vector;
        let turn = palm.rotation.to_rotation_matrix().into_inner();
        let covariance = turn * estimate.covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
        let (looked, level) = (self.expected_error(object), self.knowledge.uncertainty.arm);
        let (off, covariance) = palpation::standing(position - seen.position.coords, &covariance, (looked, level));
        let [x, y, z]: [f64; 3] = (off * 1e3).into();
        self.story.tell(format!("felt ({x:.0}, {y:.0}, {z:.0}) mm beside where it is seen"));
        Some((Percept { position: seen.position + off, ..*seen }, covariance))
    }
}

/// Worth of the best of the `candidates` while the object is only seen, with the error of `belief`, and once it has
/// been touched. `None` if nothing was rehearsed.
fn prospects(candidates: &[Candidate], belief: &Belief) -> Option<[f64; 2]> {
    candidates.iter().any(|candidate| !candidate.rehearsed.is_empty()).then_some(())?;
    let touched = touched()?;
    Some([belief, &touched].map(|belief| promise(candidates, belief)))
}

/// An empty hand with the digits closed that take the first object.
pub(super) fn empty(hand: &Hand) -> Held<'static> {
    let digits = digit_sets(hand, 2).swap_remove(0);
    let mut joints = vec![0.0; hand.tree.joints.len()];
    for &joint in digits.iter().flat_map(|digit| hand.links(*digit)) {
        joints[joint] = hand.tree.joints[joint].upper;
    }
    Held { name: "nothing", solids: &[], pose: Isometry3::identity(), joints, digits, sigma: 0.0 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Vector3;

    use super::*;
    use crate::odds::{Rehearsed, TryOutcome};
    use crate::stand_in::tests::grasp;
    use crate::uncertainty::Uncertainty;

    /// A grasp that holds within `reach` (m) of its aim and makes contact beyond, rehearsed on a grid of 4 mm.
    fn candidate(reach: f64) -> Candidate {
        let steps = || (-6..=6).map(|n| 0.004 * f64::from(n));
        let errors = steps().flat_map(|x| steps().map(move |y| Vector3::new(x, y, 0.0)));
        let outcome = |error: &Vector3<f64>| match error.norm() <= reach {
            true => TryOutcome::Held,
            false => TryOutcome::Contact,
        };
        let rehearsed: Arc<[Rehearsed]> = errors.map(|error| Rehearsed::new(error, outcome(&error))).collect();
        Candidate { rehearsed, ..Candidate::new(grasp("ball_45", 1), 1.0) }
    }

    /// A touch does not pay for a grasp that holds wherever the object may be, nor for one that never holds. It pays
    /// for one that needs a precise aim.
    #[test]
    fn a_touch_pays_where_the_aim_decides() {
        let belief = Belief::new(&Uncertainty { arm: 0.004, eyes: 0.006, eyes_lasting: 0.5 });
        let gain = |reach: f64| {
            let [seen, touched] = prospects(&[candidate(reach)], &belief).expect("rehearsed");
            touched - seen
        };
        assert!(gain(0.1) < TOUCH_PAYS && gain(0.0) < TOUCH_PAYS, "{} {}", gain(0.1), gain(0.0));
        assert!(gain(0.008) > TOUCH_PAYS, "{}", gain(0.008));
        let unknown = Candidate { rehearsed: Arc::default(), ..candidate(0.0) };
        assert_eq!(prospects(&[unknown], &belief), None);
    }
}
