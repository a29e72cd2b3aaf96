//! Fallback grasps: substitutes for an object that fell over and lies in a pose that none of its own grasps expects.
//!
//! For many such objects the repertoire has grasps, because it lists a fallen can, for example, as an object of its
//! own. Any other object is grasped like the object of the repertoire that is most similar from above: a round one like
//! a ball whose centre is at the same height, one with flat sides like a box of the same height. A rod is grasped
//! across: fingers and thumb close at right angles to its axis.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use dexterous_grasping::{Grasp, Repertoire};
use hand_model::Digit;
use nalgebra::{Isometry3, Translation3, Vector3};
use world::objects::{ObjectModel, ObjectSet, Symmetry};

use crate::detection::DetectedObject;
use crate::score::{self, GraspCandidate};

/// Number of grasps that are adopted from the most similar object.
const MAX_FALLBACK_GRASPS: usize = 6;
/// First identifier of fallback grasps, so that they are not mistaken for the object's own grasps.
const FIRST_FALLBACK_ID: u32 = 1000;
/// Yaws that are tried with an object that has no axis, rad.
const YAW_CANDIDATES: [f64; 5] = [0.0, 0.5, -0.5, 1.0, -1.0];

/// Finds grasps with `digits` for `object`, detected at `detected`, which lies in a pose that none of its own grasps
/// fits. Candidates in `rollouts` have rollouts with the held object.
pub fn fallback_grasps(
    (objects, repertoire): (&ObjectSet, &Repertoire),
    (object, detected): (&ObjectModel, &DetectedObject),
    digits: &[Digit],
    rollouts: &[GraspCandidate],
) -> Vec<GraspCandidate> {
    let mut candidates = Vec::new();
    for model in objects.fallen_of(object) {
        let Some(yaw) = model.resting_yaw(&detected.rotation) else { continue };
        for grasp in repertoire.for_digits(&model.name, digits) {
            let same = |known: &&GraspCandidate| known.grasp.object == model.name && known.grasp.id == grasp.id;
            let known = rollouts.iter().filter(|known| known.grasp.digits == digits).find(same);
            let outcomes = known.map(|known| known.rollouts.clone()).unwrap_or_default();
            candidates.push((grasp.clone(), yaw + grasp.yaw, score::NO_ROLLOUT_FACTOR, outcomes));
        }
    }
    let flat = is_flat(object);
    let grasps_of = |model: &ObjectModel| -> Vec<Grasp> {
        repertoire.for_digits(&model.name, digits).take(MAX_FALLBACK_GRASPS).cloned().collect()
    };
    let unlike = |model: &ObjectModel| (model.rest_height() - detected.position.z).abs();
    let alike = objects
        .iter()
        .filter(|model| if flat { is_flat(model) } else { model.symmetry == Symmetry::Full })
        .map(|model| (unlike(model), grasps_of(model)))
        .filter(|(_, grasps)| !grasps.is_empty())
        .min_by(|a, b| a.0.total_cmp(&b.0));
    for grasp in alike.map(|(_, grasps)| grasps).unwrap_or_default() {
        for yaw in yaw_candidates(object, detected) {
            candidates.push((grasp.clone(), yaw, score::FALLBACK_FACTOR, Arc::default()));
        }
    }
    let numbered = (FIRST_FALLBACK_ID..).zip(candidates);
    numbered
        .map(|(number, (grasp, yaw, score, rollouts))| {
            let score = score * grasp.score;
            let grasp = adapt_grasp(&grasp, object, detected, yaw - detected.yaw, number);
            GraspCandidate { rollouts, ..GraspCandidate::new(grasp, score) }
        })
        .collect()
}

fn is_flat(object: &ObjectModel) -> bool {
    matches!(object.symmetry, Symmetry::Cube | Symmetry::Fold { .. })
}

/// Yaws of the hand that suit the way the object lies, rad, the smallest one first.
fn yaw_candidates(object: &ObjectModel, detected: &DetectedObject) -> Vec<f64> {
    let azimuth = |axis: Vector3<f64>| axis.y.atan2(axis.x);
    let turned = |yaw: f64, step: f64| yaw - step * (yaw / step).round();
    match object.symmetry {
        Symmetry::Axis { .. } => {
            let across = turned(azimuth(detected.rotation * Vector3::z()) + FRAC_PI_2, PI);
            vec![across, across - PI.copysign(across)]
        }
        Symmetry::Cube | Symmetry::Fold { .. } => {
            let level = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| detected.rotation * axis);
            let level = level.into_iter().min_by(|a, b| a.z.abs().total_cmp(&b.z.abs())).unwrap_or_default();
            let along = turned(azimuth(level), FRAC_PI_2);
            vec![along, along - FRAC_PI_2.copysign(along)]
        }
        Symmetry::Full | Symmetry::None => YAW_CANDIDATES.to_vec(),
    }
}

/// Adapts `grasp` of another object to `object`: its place in the hand is that of the other object, its rotation that
/// of its present pose.
fn adapt_grasp(grasp: &Grasp, object: &ObjectModel, detected: &DetectedObject, yaw: f64, id: u32) -> Grasp {
    let mut taken = Grasp { id, object: object.name.clone(), yaw, held_joints: None, ..grasp.clone() };
    let rotation = taken.palm_rotation(detected.yaw).inverse() * detected.rotation;
    let place = grasp.held.map_or(Vector3::from(grasp.center), |held| held.translation.vector);
    taken.held = Some(Isometry3::from_parts(Translation3::from(place), rotation));
    taken
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Point3, UnitQuaternion};

    use super::*;
    use crate::outcome_model::{Rollout, TryOutcome};

    const PINCH: [Digit; 3] = [Digit::Thumb, Digit::Index, Digit::Middle];

    fn lying(rotation: UnitQuaternion<f64>) -> DetectedObject {
        DetectedObject { position: Point3::new(0.6, 0.1, 0.0225), rotation, yaw: 0.4 }
    }

    pub(crate) fn grasp(object: &str, id: u32) -> Grasp {
        Grasp {
            id,
            object: object.into(),
            digits: PINCH.to_vec(),
            yaw: 0.0,
            pitch: 0.2,
            roll: -0.3,
            center: [0.01 * f64::from(id), -0.04, -0.02],
            pre_tension: [0.0; 5].into(),
            close_tension: [10.0; 5].into(),
            opposition: 0.5,
            raise: 0.0,
            thumb_delay: 0.0,
            held: None,
            held_joints: None,
            held_sigmas: None,
            score: 1.0,
        }
    }

    /// A rod that points ahead is grasped with the hand turned by 90 degrees, a crosswise one with the hand ahead.
    #[test]
    fn rods_are_grasped_across() {
        let set = ObjectSet::standard();
        let rod = set.get("cylinder_45").unwrap();
        let ahead = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
        let crosswise = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        assert!(yaw_candidates(rod, &lying(ahead)).iter().all(|yaw| (yaw.abs() - FRAC_PI_2).abs() < 1e-9));
        assert!(yaw_candidates(rod, &lying(crosswise))[0].abs() < 1e-9);
    }

    /// Rollouts of a fallen object's own grasps come with them. A grasp with another number has none.
    #[test]
    fn rollouts_of_fallen_things_are_known() {
        let set = ObjectSet::standard().with_fallen();
        let (can, lying_can) = (set.get("can_50").unwrap(), set.get("can_50_fallen").unwrap());
        let own = |id: u32| Grasp { object: lying_can.name.clone(), ..grasp("", id) };
        let mut repertoire = Repertoire::default();
        repertoire.grasps.insert(lying_can.name.clone(), vec![own(4), own(5)]);
        let outcome = Rollout::new(Vector3::zeros(), TryOutcome::Missed);
        let rollouts = [GraspCandidate { rollouts: [outcome].into(), ..GraspCandidate::new(own(5), 1.0) }];
        let seen = DetectedObject { rotation: lying_can.rest, ..lying(lying_can.rest) };
        let found = fallback_grasps((&set, &repertoire), (can, &seen), &PINCH, &rollouts);
        let known: Vec<usize> = found.iter().map(|candidate| candidate.rollouts.len()).collect();
        assert_eq!(known, [0, 1]);
    }

    /// The grasp of the ball of the same height is adopted, and the hand comes from the intended side whatever the yaw
    /// of the detected pose.
    #[test]
    fn a_lying_can_is_grasped_like_the_ball_as_high() {
        let set = ObjectSet::standard();
        let mut repertoire = Repertoire::default();
        for (name, id) in [("golf_ball", 1), ("tennis_ball", 2)] {
            repertoire.grasps.insert(name.into(), vec![grasp(name, id)]);
        }
        let crosswise = lying(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2));
        let rod = set.get("cylinder_45").unwrap();
        let found = fallback_grasps((&set, &repertoire), (rod, &crosswise), &PINCH, &[]);
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|candidate| candidate.grasp.center[0] == 0.01 && candidate.grasp.object == rod.name));
        let pose = found[0].grasp.palm_pose(&crosswise.position, crosswise.yaw);
        assert!((pose.rotation.angle_to(&grasp("golf_ball", 1).palm_rotation(0.0))) < 1e-9);
        let held = found[0].grasp.held.unwrap();
        assert!((pose * held).rotation.angle_to(&crosswise.rotation) < 1e-9);
        assert!(fallback_grasps((&set, &repertoire), (rod, &crosswise), &[Digit::Ring, Digit::Little], &[]).is_empty());
    }
}
