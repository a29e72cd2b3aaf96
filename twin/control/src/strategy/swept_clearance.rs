//! Geometry of a decision: clearance between the held object and the target during the approach and while the digits
//! close.

use dexterous_grasping::Grasp;
use nalgebra::{Isometry3, Translation3, Vector3};

use super::approach_paths::{clearance_after, first_clear_option};
use super::solids::{free_solids, held_solids, transformed};
use super::{DecisionContext, StrategyError};
use crate::collision::{Solid, clearance_along, clearance_at};
use crate::detection::DetectedObject;
use crate::executor::Executor;
use crate::score::GraspCandidate;
use crate::trajectory::PosePath;

/// Number of checked stages of the target's path into the hand.
const CLOSING_STAGES: usize = 4;
/// Number of intervals between the sampled poses of each of the two parts of a course.
const COURSE_INTERVALS: usize = 16;
/// Threshold in standard deviations: with a larger clearance no contact is expected.
const NO_CONTACT_SIGMAS: f64 = 2.0;

/// Motion of the held object along a candidate path.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HeldObjectPath {
    /// `world_from_object` of the held object along the path.
    pub poses: Vec<Isometry3<f64>>,
    /// Pose of its closest approach to the target, and the distance there, m; negative for a collision. `None` if that
    /// is before the last part of the approach.
    pub nearest: Option<(Isometry3<f64>, f64)>,
}

/// Geometry of a decision: the solids that move with the palm (palm frame), as felt and as planned, and the target (its
/// own frame).
pub(super) struct ClearanceScene<'a> {
    /// The held object alone.
    object: Vec<Solid>,
    /// The held object with the digits that hold it.
    moving: Vec<Solid>,
    /// These and the rest of the hand, which must stay clear on the path to the approach pose.
    whole_hand: Vec<Solid>,
    rollout_solids: Option<Vec<Solid>>,
    target: &'a [Solid],
    sigma: f64,
}

impl<'a> ClearanceScene<'a> {
    pub(super) fn new(situation: &DecisionContext<'a>) -> Self {
        let (hand, held) = (situation.hand, situation.held);
        let rollouts = situation.rollout_hold.map(|(pose, joints)| held_solids(hand, held, (&pose, joints)));
        let moving = held_solids(hand, held, (&held.pose, &held.joints));
        let whole = [&moving[..], &free_solids(hand, held)].concat();
        Self {
            object: transformed(held.solids, &held.pose),
            moving,
            whole_hand: whole,
            rollout_solids: rollouts,
            target: situation.target,
            sigma: held.sigma.hypot(situation.target_sigma).max(1e-4),
        }
    }

    /// Path to the approach pose of `grasp` that keeps the whole hand clear of the target at `detected`: the first one
    /// that does so, else the one with the largest clearance. Returned with its smallest distance, m.
    fn clear_via_poses(
        &self,
        executor: &Executor,
        grasp: &Grasp,
        (detected, beside): (&DetectedObject, &DetectedObject),
    ) -> Result<(f64, Vec<Isometry3<f64>>), StrategyError> {
        let fixed = transformed(self.target, &detected.pose());
        let best = first_clear_option(executor.approach_paths(), NO_CONTACT_SIGMAS * self.sigma, |stops| {
            clearance_after(stops, &self.whole_hand, &fixed, |stops| {
                let [way, _] = executor.path_to(stops, grasp, beside)?;
                Ok(way)
            })
        })?;
        Ok(best.unwrap_or((f64::NEG_INFINITY, Vec::new())))
    }

    /// Smallest distance (m) of `moving` from the target at `detected` while `path` is followed and `grasp` closes, and
    /// the palm pose there.
    fn clearance(
        &self,
        moving: &[Solid],
        path: &PosePath,
        grasp: &Grasp,
        detected: &DetectedObject,
    ) -> Result<(f64, Isometry3<f64>), StrategyError> {
        let fixed = transformed(self.target, &detected.pose());
        let along = clearance_along(path, moving, &fixed, 2000)?;
        let (mut clearance, mut palm) =
            along.map_or((f64::INFINITY, path.end()), |found| (found.min_distance, path.sample(found.time).0));
        let before = path.end().inverse() * detected.pose();
        if let Some(after) = grasp.held {
            for stage in 1..=CLOSING_STAGES {
                let part = stage as f64 / CLOSING_STAGES as f64;
                // Only the position matters for most targets; the rotation in the hand is applied at the end.
                let place = before.translation.vector.lerp(&after.translation.vector, part);
                let rotation = if stage == CLOSING_STAGES { after.rotation } else { before.rotation };
                let there = Isometry3::from_parts(Translation3::from(place), rotation);
                let found = clearance_at(&Isometry3::identity(), moving, &transformed(self.target, &there))?;
                if let Some(found) = found.filter(|found| found.min_distance < clearance) {
                    (clearance, palm) = (found.min_distance, path.end());
                }
            }
        }
        Ok((clearance, palm))
    }

    /// Distance (m) of the held object alone from the target at `detected` when the palm has arrived at the end of
    /// `path`.
    fn separation(&self, path: &PosePath, detected: &DetectedObject) -> Result<f64, StrategyError> {
        let found = clearance_at(&path.end(), &self.object, &transformed(self.target, &detected.pose()))?;
        Ok(found.map_or(f64::INFINITY, |found| found.min_distance))
    }

    /// Swept clearance of the felt hold on its path to the target and during the grasp of `candidate`, at the offset
    /// `aim` (m) of the aim.
    pub(super) fn swept_clearance(
        &self,
        executor: &Executor,
        candidate: &GraspCandidate,
        aim: &Vector3<f64>,
    ) -> Result<SweptClearance, StrategyError> {
        let (percept, grasp) = (executor.target(1).detected, &candidate.grasp);
        let beside = DetectedObject { position: percept.position + aim, ..percept };
        let risk = |clearance: f64| normal_cdf(-clearance / self.sigma);
        let (there, stops) = self.clear_via_poses(executor, grasp, (&percept, &beside))?;
        let [first, last] = executor.path_to(&stops, grasp, &beside)?;
        let (taking, palm) = self.clearance(&self.moving, &last, grasp, &percept)?;
        // Rollouts after many holds include the obstacles of each of them.
        let verified = candidate.rollouts.iter().any(|rollout| rollout.hold.is_some());
        let contact = if verified || taking > NO_CONTACT_SIGMAS * self.sigma {
            0.0
        } else {
            let known = match &self.rollout_solids {
                Some(rollout) if !candidate.rollouts.is_empty() => {
                    risk(self.clearance(rollout, &last, grasp, &percept)?.0)
                }
                _ => 0.0,
            };
            (risk(taking) - known).max(0.0)
        };
        let on_the_way = if there > NO_CONTACT_SIGMAS * self.sigma { 0.0 } else { risk(there) };
        let contact = 1.0 - (1.0 - contact) * (1.0 - on_the_way);
        let nearest = (taking <= there && taking.is_finite()).then_some(palm);
        let separation = self.separation(&last, &percept)?;
        Ok(SweptClearance { clearance: taking.min(there), separation, contact, stops, path: [first, last], nearest })
    }
}

/// Swept clearance of the held object at the target.
pub(super) struct SweptClearance {
    /// Smallest distance, m.
    pub clearance: f64,
    /// See [`super::Assessment::separation`].
    pub separation: f64,
    /// Probability of a contact that the rollouts did not include. They began at the planned pose of the trial, with
    /// the same last part of the approach.
    pub contact: f64,
    /// Via poses of the path to the approach pose.
    pub stops: Vec<Isometry3<f64>>,
    /// The path to the approach pose, and the last part of the approach.
    path: [PosePath; 2],
    /// Palm pose at the smallest clearance, if that is on the last part of the approach.
    nearest: Option<Isometry3<f64>>,
}

impl SweptClearance {
    /// Course of the object that is held at `palm_from_object`.
    pub fn held_object_path(&self, palm_from_object: &Isometry3<f64>) -> HeldObjectPath {
        let sampled = |path: &PosePath| {
            let step = path.duration() / COURSE_INTERVALS as f64;
            (0..=COURSE_INTERVALS).map(|n| path.sample(step * n as f64).0 * palm_from_object).collect::<Vec<_>>()
        };
        let nearest = self.nearest.map(|palm| (palm * palm_from_object, self.clearance));
        HeldObjectPath { poses: self.path.iter().flat_map(sampled).collect(), nearest }
    }
}

/// Cumulative distribution function of the standard normal distribution.
fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::normal_cdf;

    #[test]
    fn normal_distribution() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.841344746), (-1.959963984540054, 0.025)] {
            assert!((normal_cdf(x) - p).abs() < 1e-9, "{x}");
        }
    }
}
