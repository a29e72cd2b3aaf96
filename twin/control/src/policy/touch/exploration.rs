//! Exploratory motion of the policy `touch`: palpates an object where it stands, and updates its position.

use dexterous_grasping::digit_sets;
use hand_model::Hand;
use nalgebra::{Isometry3, Matrix3};
use tactile_perception::{ExpectedObject, PoseEstimate, PosePrior};

use super::{ExecutorActivity, TouchPolicy};
use crate::detection::DetectedObject;
use crate::executor::Executor;
use crate::guarded::GuardedMotion;
use crate::outcome_model::AimPosterior;
use crate::palpation::{self, PalpationPaths, estimate_touched_pose};
use crate::perception::{ExpectedHolds, default_prior};
use crate::policy::{Knowledge, PolicyError, PolicyStep};
use crate::score::GraspCandidate;
use crate::sensing::TouchPerception;
use crate::strategy::{HeldObject, best_candidate_score, clearest_palpation};

/// Prior standard deviation of an object's rotation, rad.
const ROTATION_SIGMA: f64 = 0.08;
/// Smallest increase of the best grasp's score for which a touch, which takes some 3 s, pays; set by hand.
const MIN_TOUCH_GAIN: f64 = 0.06;

/// True if an object is palpated before it is grasped. That requires usable pads that form one surface, and a touch
/// that locates the object more precisely than `sigma` (m, each axis), the standard deviation without it.
pub(super) fn should_palpate(knowledge: &Knowledge, senses: &TouchPerception, sigma: f64) -> bool {
    let hand = &knowledge.cell.robot.hand;
    let touches = |pad: &usize| senses.uses_pad(hand, *pad);
    // Jaws have no free digit to touch with.
    let free = hand.jaws().is_none() && palpation::contiguous_pads(hand).iter().any(touches);
    knowledge.palpates && sigma > palpation::RESIDUAL_SIGMA && free
}

/// Returns the posterior of the position of an object that has been touched.
pub(super) fn touch_posterior() -> Option<AimPosterior> {
    AimPosterior::from_touch(&Matrix3::from_diagonal_element(palpation::RESIDUAL_SIGMA.powi(2)))
}

impl TouchPolicy<'_> {
    /// Palpates the first or second `object` to locate it, if that is possible and pays; otherwise takes it.
    pub(super) fn palpate_or_take(
        &mut self,
        object: usize,
        executor: &mut Executor,
    ) -> Result<PolicyStep, PolicyError> {
        if let Some([seen, touched]) = self.touch_scores(object, executor)
            && touched - seen < MIN_TOUCH_GAIN
        {
            let name = &self.knowledge.objects[object].name;
            self.trace.record(format!(
                "{name} is not palpated: the best grasp scores {seen:.2} without touch and {touched:.2} with touch"
            ));
            return self.take(object, executor);
        }
        let Some(PalpationPaths { approach: way, guarded_motion: onto }) = self.palpation(object, executor)? else {
            return self.take(object, executor);
        };
        let name = &self.knowledge.objects[object].name;
        self.trace.record(format!("{name} is touched from above to locate it"));
        let hand = executor.motion().hand().clone();
        let guarded = GuardedMotion::new(onto, &hand, &palpation::palpating_fingers(&hand), |pad| {
            self.senses.uses_pad(&hand, pad)
        });
        executor.palpate(object, way, guarded);
        self.activity = ExecutorActivity::Palpates { object, found: None };
        Ok(PolicyStep::Continue)
    }

    /// [`scores_before_after_touch`] of the second object; `None` for the first one, and where no touch is possible.
    fn touch_scores(&self, object: usize, executor: &Executor) -> Option<[f64; 2]> {
        let felt = self.felt.as_ref().filter(|_| object == 1)?;
        should_palpate(&self.knowledge, &self.senses, self.expected_error(object)).then_some(())?;
        let (_, following) = self.second_candidates(executor);
        scores_before_after_touch(&self.reweighted_for_hold(following, felt), &self.aim_posterior)
    }

    /// Palpation of an object; `None` if there are no pads for it, or the arm cannot get there.
    fn palpation(&self, object: usize, executor: &Executor) -> Result<Option<PalpationPaths>, PolicyError> {
        if !should_palpate(&self.knowledge, &self.senses, self.expected_error(object)) {
            return Ok(None);
        }
        let hand = executor.motion().hand();
        let held = match (object, &self.felt) {
            (0, _) => empty_hand(hand),
            (_, Some(felt)) => self.held(executor, felt),
            (_, None) => return Ok(None),
        };
        let seen = &executor.target(object).detected;
        let paths = executor.feasible_palpations(object, &self.knowledge.objects[object].shape);
        Ok(clearest_palpation(hand, &held, (&self.solids[object], seen), paths)?)
    }

    /// Standard deviation of the hand's position relative to an object that only the detector has located, each axis,
    /// m.
    fn expected_error(&self, object: usize) -> f64 {
        let tracked = &self.objects[object];
        tracked.uncertainty(&self.knowledge).aim_sigma(tracked.detections)
    }

    /// Estimates the pose in the hand of an object that it has just touched.
    pub(super) fn perceive_touch(
        &mut self,
        object: usize,
        executor: &Executor,
        expected: &ExpectedHolds,
    ) -> Result<(), PolicyError> {
        let seen = &executor.target(object).detected;
        let prior = PosePrior {
            palm_from_object: executor.motion().palm().inverse() * seen.pose(),
            sigma_translation: self.expected_error(object),
            sigma_rotation: ROTATION_SIGMA,
        };
        let held = self.felt.as_ref().map_or(expected.palm_from_object, |felt| felt.estimate.palm_from_object);
        let held = (object == 1)
            .then(|| ExpectedObject { shape: self.knowledge.known_objects[0], prior: default_prior(held) });
        let found = estimate_touched_pose(
            &self.senses,
            &executor.motion().snapshot(),
            self.knowledge.known_objects[object],
            &prior,
            held,
        )?;
        self.activity = ExecutorActivity::Palpates { object, found: found.map(Box::new) };
        Ok(())
    }

    /// Updates the detected pose and the posterior with the result of a touch.
    pub(super) fn update_from_touch(
        &mut self,
        object: usize,
        executor: &mut Executor,
        found: Option<Box<PoseEstimate>>,
    ) {
        let (palm, seen) = (executor.motion().palm(), executor.target(object).detected);
        let Some((found, covariance)) = self.detection_from_touch(object, found, palm, &seen) else { return };
        executor.update_detection(object, found);
        let tracked = &mut self.objects[object];
        (tracked.touch_posterior, tracked.detections) = (AimPosterior::from_touch(&covariance), 1);
    }

    /// Detected pose of the touched `object` from its estimate `found` in the hand and its earlier detected pose
    /// `seen`, and the covariance of its position, m2; world frame.
    fn detection_from_touch(
        &mut self,
        object: usize,
        found: Option<Box<PoseEstimate>>,
        palm: Isometry3<f64>,
        seen: &DetectedObject,
    ) -> Option<(DetectedObject, Matrix3<f64>)> {
        let Some(estimate) = found else {
            self.trace.record("nothing was felt there".to_owned());
            return None;
        };
        let position = (palm * estimate.palm_from_object).translation.vector;
        let turn = palm.rotation.to_rotation_matrix().into_inner();
        let covariance = turn * estimate.covariance.fixed_view::<3, 3>(0, 0) * turn.transpose();
        let (looked, level) = (self.expected_error(object), self.knowledge.uncertainty.arm);
        let (off, covariance) =
            palpation::condition_on_table(position - seen.position.coords, &covariance, (looked, level));
        let [x, y, z]: [f64; 3] = (off * 1e3).into();
        self.trace.record(format!("felt ({x:.0}, {y:.0}, {z:.0}) mm from the detected position"));
        Some((DetectedObject { position: seen.position + off, ..*seen }, covariance))
    }
}

/// Scores of the best of the `candidates` while the object is only detected, with the error of `posterior`, and once it
/// has been touched. `None` if there are no rollouts.
fn scores_before_after_touch(candidates: &[GraspCandidate], posterior: &AimPosterior) -> Option<[f64; 2]> {
    candidates.iter().any(|candidate| !candidate.rollouts.is_empty()).then_some(())?;
    let touched = touch_posterior()?;
    Some([posterior, &touched].map(|posterior| best_candidate_score(candidates, posterior)))
}

/// An empty hand in which the digits that take the first object are closed.
pub(super) fn empty_hand(hand: &Hand) -> HeldObject<'static> {
    let digits = digit_sets(hand, 2).swap_remove(0);
    let mut joints = vec![0.0; hand.tree.joints.len()];
    for &joint in digits.iter().flat_map(|digit| hand.links(*digit)) {
        joints[joint] = hand.tree.joints[joint].upper;
    }
    HeldObject { name: "nothing", solids: &[], pose: Isometry3::identity(), joints, digits, sigma: 0.0 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::Vector3;

    use super::*;
    use crate::fallback_grasp::tests::grasp;
    use crate::outcome_model::{Rollout, TryOutcome};
    use crate::uncertainty::Uncertainty;

    /// A grasp that holds within `reach` (m) of its aim and makes contact beyond, with rollouts on a grid of 4 mm.
    fn candidate(reach: f64) -> GraspCandidate {
        let steps = || (-6..=6).map(|n| 0.004 * f64::from(n));
        let errors = steps().flat_map(|x| steps().map(move |y| Vector3::new(x, y, 0.0)));
        let outcome = |error: &Vector3<f64>| match error.norm() <= reach {
            true => TryOutcome::Held,
            false => TryOutcome::Contact,
        };
        let rollouts: Arc<[Rollout]> = errors.map(|error| Rollout::new(error, outcome(&error))).collect();
        GraspCandidate { rollouts: rollouts, ..GraspCandidate::new(grasp("ball_45", 1), 1.0) }
    }

    /// A touch does not pay for a grasp that holds wherever the object may be, nor for one that never holds. It pays
    /// for one that needs a precise aim.
    #[test]
    fn a_touch_pays_where_the_aim_decides() {
        let posterior = AimPosterior::new(&Uncertainty { arm: 0.004, detector: 0.006, detector_persistent_share: 0.5 });
        let gain = |reach: f64| {
            let [seen, touched] = scores_before_after_touch(&[candidate(reach)], &posterior).expect("rollouts");
            touched - seen
        };
        assert!(gain(0.1) < MIN_TOUCH_GAIN && gain(0.0) < MIN_TOUCH_GAIN, "{} {}", gain(0.1), gain(0.0));
        assert!(gain(0.008) > MIN_TOUCH_GAIN, "{}", gain(0.008));
        let unknown = GraspCandidate { rollouts: Arc::default(), ..candidate(0.0) };
        assert_eq!(scores_before_after_touch(&[unknown], &posterior), None);
    }
}
