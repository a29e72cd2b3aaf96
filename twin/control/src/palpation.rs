//! Palpation: free digits touch an object before it is grasped, in order to locate it.
//!
//! The errors of detector and arm are as large as the width of a finger, and they are the same in the touch and in the
//! grasp that follows it at the same place. Index and middle finger, stretched out, come down slowly on the object's
//! rim from above until a pad feels it. The pads then show the object's pose in the hand, as they do for a held object.

use dexterous_grasping::digit_sets;
use dexterous_grasping::grasp::palm_rotation;
use hand_model::{Digit, DigitVector, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Vector3};
use tactile_perception::{ExpectedObject, KnownShape, PoseEstimate, PosePrior, TouchError};
use world::geometry::ObjectShape;

use crate::detection::DetectedObject;
use crate::motion::approach::duration;
use crate::perception::KnownObject;
use crate::sensing::{TouchPerception, is_pad_on_digits};
use crate::tactile_snapshot::TactileSnapshot;
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Cosine of the largest angle between the normals of a touching pad and of the palm's face, with the fingers
/// stretched.
const MIN_FACING_COSINE: f64 = 0.5;
/// Candidate ways to touch: pitch of the hand, fingers down, rad, and offset of the contact from the middle of the pads
/// towards the thumb, m. The held object must stay clear of the table and the touched object.
const TOUCH_CANDIDATES: [(f64, f64); 6] =
    [(0.5, 0.0), (0.7, 0.0), (0.5, 0.012), (0.7, 0.012), (0.3, 0.0), (0.9, 0.012)];
/// Time for hand and object to come to rest before the images are taken, s.
pub const SETTLING_TIME: f64 = 0.1;
/// Distances before and beyond the detected surface at which the guarded motion begins and ends, m.
const GUARDED_MARGINS: (f64, f64) = (0.012, 0.018);
/// Mean speed of the guarded motion, m/s.
const GUARDED_SPEED: f64 = 0.025;
/// Gate: estimates farther than this many prior standard deviations are rejected.
const GATE_SIGMAS: f64 = 4.0;
/// Assumed standard deviation of an object's position after a touch, each axis, m; measured on seed 1.
pub const RESIDUAL_SIGMA: f64 = 0.003;
/// Height above the start of the guarded motion from which the hand descends, m.
const DESCENT_HEIGHT: f64 = 0.04;
/// Rise after a palpation, m: the fingertips then pass above the object when they close.
pub const RETREAT_HEIGHT: f64 = 0.07;

/// Paths of the palm for touching an object.
#[derive(Debug, Clone)]
pub struct PalpationPaths {
    /// Path to the start of the guarded motion.
    pub approach: PosePath,
    /// The guarded motion.
    pub guarded_motion: PosePath,
}

/// Guarded motions with which the hand can touch an object of this `shape` detected at `detected`, the preferred one
/// first: from above, with the hand yawed by `heading` (rad).
pub fn guarded_motions(hand: &Hand, heading: f64, (shape, detected): (&ObjectShape, &DetectedObject)) -> Vec<PosePath> {
    let (middle, facing) = middle_of_pads(hand);
    let pose = detected.pose();
    let onto = |(pitch, beside): &(f64, f64)| {
        let rotation = palm_rotation(heading, *pitch, 0.0);
        let facing = rotation * facing;
        let rim = pose * shape.support(&pose.inverse_transform_vector(&-facing));
        let at = |along: f64| {
            let place = rim.coords - rotation * (middle.coords + Vector3::x() * *beside) + facing * along;
            Isometry3::from_parts(Translation3::from(place), rotation)
        };
        PosePath::new(vec![
            (0.0, at(-GUARDED_MARGINS.0)),
            ((GUARDED_MARGINS.0 + GUARDED_MARGINS.1) / GUARDED_SPEED, at(GUARDED_MARGINS.1)),
        ])
        .ok()
    };
    TOUCH_CANDIDATES.iter().filter_map(onto).collect()
}

/// Path from `here` to `there`, the start of a guarded motion, by way of a pose above it.
pub fn approach_path(
    limits: &PathLimits,
    here: &Isometry3<f64>,
    there: &Isometry3<f64>,
) -> Result<PosePath, PathError> {
    let above = there.translation.vector + Vector3::z() * DESCENT_HEIGHT;
    let above = Isometry3::from_parts(Translation3::from(above), there.rotation);
    let stops = vec![(0.0, *here), (duration(limits, here, &above), above), (duration(limits, &above, there), *there)];
    PosePath::new(stops)
}

/// Fingers that palpate: those that stay free while a first object is held. The thumb is excluded, because a held
/// object may lie on it.
pub fn palpating_fingers(hand: &Hand) -> Vec<Digit> {
    let mut fingers = digit_sets(hand, 2).swap_remove(1);
    fingers.retain(|digit| *digit != Digit::Thumb);
    fingers
}

/// Cable tensions during palpation, N.
pub fn palpation_tensions(hand: &Hand) -> DigitVector {
    let mut tensions = hand.slack_tensions();
    for digit in palpating_fingers(hand) {
        tensions[digit.index()] = hand.parameters.palpation.map_or(0.0, |known| known.tension);
    }
    tensions
}

/// Palpating pads and their poses in the palm frame with the fingers stretched: the pads on the palmar side of the
/// palpating fingers beyond the first link of each. None in a hand whose file has no parameters for palpation.
fn palpating_pads(hand: &Hand) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
    let known = hand.parameters.palpation;
    let links = hand.tree.forward(&hand.each_joint(|_| known.map_or(0.0, |known| known.curl)));
    let fingers = if known.is_some() { palpating_fingers(hand) } else { Vec::new() };
    let outer: Vec<usize> = fingers.iter().flat_map(|digit| &hand.links(*digit)[1..]).copied().collect();
    let places = hand.pads.iter().enumerate().filter_map(move |(n, pad)| {
        let link = pad.link.filter(|link| outer.contains(link))?;
        Some((n, links[link] * pad.link_from_pad))
    });
    places.filter(|(_, place)| -(place * Vector3::z()).z > MIN_FACING_COSINE)
}

/// Palpating pads, provided that they form one surface: the gaps between the pads of neighbouring fingers are smaller
/// than a pad's width. None for a hand whose fingers are farther apart, because neither finger would feel a ball in
/// between, and none for a hand without such pads.
pub fn contiguous_pads(hand: &Hand) -> Vec<usize> {
    let pads: Vec<_> = palpating_pads(hand).collect();
    let apart = |(one, at): &(usize, Isometry3<f64>), (other, there): &(usize, Isometry3<f64>)| {
        let width = 0.5 * (hand.pads[*one].w + hand.pads[*other].w);
        (at.translation.x - there.translation.x).abs() - width > width
    };
    let gap = pads.iter().any(|one| pads.iter().all(|other| on_one_digit(hand, one.0, other.0) || apart(one, other)));
    let fingers = pads.iter().any(|(pad, _)| !on_one_digit(hand, pads[0].0, *pad));
    if fingers && gap { Vec::new() } else { pads.into_iter().map(|(pad, _)| pad).collect() }
}

fn on_one_digit(hand: &Hand, one: usize, other: usize) -> bool {
    hand.digit_of(hand.pads[one].link) == hand.digit_of(hand.pads[other].link)
}

/// Centre of the palpating pads and their mean normal, both in the palm frame, with the fingers stretched.
fn middle_of_pads(hand: &Hand) -> (Point3<f64>, Vector3<f64>) {
    let places: Vec<_> = palpating_pads(hand).map(|(_, place)| place).collect();
    let middle = places.iter().map(|place| place.translation.vector).sum::<Vector3<f64>>() / places.len() as f64;
    let facing = places.iter().map(|place| place * Vector3::z()).sum::<Vector3<f64>>();
    (middle.into(), facing.normalize())
}

/// Estimates the pose of a touched object in the hand from the free digits. `None` if they feel nothing that can be the
/// object. `first` is the held object, if there is one.
pub fn estimate_touched_pose(
    senses: &TouchPerception,
    snapshot: &TactileSnapshot,
    object: &KnownObject,
    prior: &PosePrior,
    first: Option<ExpectedObject>,
) -> Result<Option<PoseEstimate>, TouchError> {
    let (pipeline, shape) = (senses.pipeline(), object as &dyn KnownShape);
    let mut touches = senses.perceive(snapshot)?.touches;
    let objects: Vec<ExpectedObject> = first.into_iter().chain([ExpectedObject { shape, prior: *prior }]).collect();
    pipeline.mark_self_contacts(&mut touches, snapshot.readings, &objects)?;
    let fingers = palpating_fingers(pipeline.hand());
    touches.retain(|touch| is_pad_on_digits(pipeline.hand(), touch.pad, &fingers));
    if touches.iter().all(|touch| touch.object_patches().next().is_none()) {
        return Ok(None);
    }
    let found = pipeline.estimate_pose(&touches, snapshot.readings, prior, shape)?;
    let off = found.palm_from_object.translation.vector - prior.palm_from_object.translation.vector;
    Ok((off.norm() < GATE_SIGMAS * prior.sigma_translation).then_some(found))
}

/// Conditions a touch on the fact that the object stands on the table, so that its height is known. The object was
/// found `off` (m, world) from its detected position, with this covariance (m2), from an isotropic prior with the first
/// of `sigmas` (m) as standard deviation. The second one is the standard deviation of its height.
pub fn condition_on_table(
    off: Vector3<f64>,
    covariance: &Matrix3<f64>,
    sigmas: (f64, f64),
) -> (Vector3<f64>, Matrix3<f64>) {
    let (prior, level) = sigmas;
    let information = level.powi(-2) - prior.powi(-2);
    if information <= 0.0 {
        return (off, *covariance);
    }
    let along = covariance * Vector3::z();
    let gain = along / (along.z + 1.0 / information);
    (off - gain * off.z, covariance - gain * along.transpose())
}

#[cfg(test)]
mod tests {
    use hand_model::RobotModel;

    use super::*;

    /// The outer pads of index and middle finger touch, also on a robot with further pads on backs and sides. The
    /// fingertips of the Allegro Hand are 56 mm apart, which leaves room for something as wide as a pad.
    #[test]
    fn pads_that_touch_make_one_surface() {
        let robot = |file: &str| {
            let path = std::path::Path::new("../../hand-model/data/robots").join(file);
            RobotModel::read(&path).expect(file).hand
        };
        let names =
            |hand: &Hand| contiguous_pads(hand).iter().map(|pad| hand.pads[*pad].name.clone()).collect::<Vec<_>>();
        let outer = ["index_middle", "index_distal", "middle_middle", "middle_distal"];
        assert_eq!(names(&Hand::ftac()), outer);
        assert_eq!(names(&robot("ftac_more_pads.toml")), outer);
        assert_eq!(names(&robot("ftac_right.toml")), outer);
        assert!(contiguous_pads(&robot("allegro_gen3.toml")).is_empty());
        assert_eq!(palpating_fingers(&Hand::ftac()), [Digit::Index, Digit::Middle]);
    }

    /// Once the guarded motion has reached the detected surface, the centre of the pads is on that surface and faces
    /// it.
    #[test]
    fn pads_meet_the_object_where_it_is_seen() {
        let hand = Hand::ftac();
        let shape = ObjectShape::Sphere { radius: 0.03 };
        let detected = DetectedObject::from_ball_pose(&Isometry3::translation(0.6, -0.1, 0.03));
        let paths = guarded_motions(&hand, 0.3, (&shape, &detected));
        assert_eq!(paths.len(), TOUCH_CANDIDATES.len());
        let (middle, facing) = middle_of_pads(&hand);
        for (onto, (_, beside)) in paths.iter().zip(TOUCH_CANDIDATES) {
            let (before, beyond) = (onto.start(), onto.end());
            let share = GUARDED_MARGINS.0 / (GUARDED_MARGINS.0 + GUARDED_MARGINS.1);
            let palm = Isometry3::from_parts(
                before.translation.vector.lerp(&beyond.translation.vector, share).into(),
                before.rotation,
            );
            let outward = palm * (middle + Vector3::x() * beside) - detected.position;
            assert!((outward.norm() - 0.03).abs() < 1e-9, "{outward}");
            assert!((outward.normalize() + palm * facing).norm() < 1e-9, "{outward}");
        }
    }

    /// With only the prior, the height takes its own standard deviation and the rest stays; a correlated axis changes
    /// with it.
    #[test]
    fn the_table_tells_the_height() {
        let (off, found) =
            condition_on_table(Vector3::new(0.0, 0.001, 0.004), &(Matrix3::identity() * 1e-4), (0.01, 0.005));
        assert!((found - Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-4, 0.25e-4))).norm() < 1e-12, "{found}");
        assert!((off - Vector3::new(0.0, 0.001, 0.001)).norm() < 1e-12, "{off}");
        let mut covariance = Matrix3::identity() * 1e-4;
        (covariance[(0, 2)], covariance[(2, 0)]) = (0.8e-4, 0.8e-4);
        let (off, found) = condition_on_table(Vector3::new(0.003, 0.0, 0.004), &covariance, (0.01, 0.005));
        assert!(found[(0, 0)] < 0.6e-4 && off.x < 0.001, "{found} {off}");
        // A prior with a smaller height variance is left unchanged.
        assert_eq!(condition_on_table(off, &covariance, (0.004, 0.005)), (off, covariance));
    }
}
