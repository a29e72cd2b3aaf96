//! Proposals: random grasps around the ways in which a hand picks up an object and keeps digits free.
//!
//! Their ranges are data of the hand ([`Grasps`]), wide enough that physics decides which proposals hold. They describe
//! a left hand of the file's size. A right hand mirrors them, and a hand of another size scales them. A parallel
//! gripper takes an object from above between its jaws.

mod jaws;

use hand_model::hand::Jaws;
use hand_model::parameters::{GraspRanges, Grasps, Handedness};
use hand_model::{Digit, DigitVector, Hand};
use nalgebra::Vector3;
use rand::{Rng, RngExt};

use crate::grasp::Grasp;

/// Size of an object, for the sampler.
#[derive(Debug, Clone)]
pub struct ObjectExtent {
    /// Name of the object.
    pub name: String,
    /// Half extents of the resting object in world axes at yaw 0, m.
    pub half: Vector3<f64>,
    /// True if the object is not symmetric about the vertical.
    pub yaw_matters: bool,
}

/// Form of a hand, as far as proposals depend on it: side, size, number of digits, and the ranges of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct HandForm {
    /// 1 for a left hand, -1 for a right one.
    side: f64,
    /// Ratio of its size to that of the hand for which the ranges are given.
    scale: f64,
    /// Number of its digits.
    digits: usize,
    grasps: Grasps,
    /// Jaws of a parallel gripper.
    jaws: Option<Jaws>,
}

impl HandForm {
    /// Reads the form from a hand's parameters.
    pub fn from_hand(hand: &Hand) -> Self {
        let side = match hand.parameters.handedness {
            Handedness::Left => 1.0,
            Handedness::Right => -1.0,
        };
        let grasps = hand.parameters.grasps().clone();
        let scale = -hand.parameters.palm.flange_xyz[1] / grasps.wrist;
        Self { side, scale, digits: hand.digits().len(), grasps, jaws: hand.jaws() }
    }

    /// Returns the ranges for a set of digits: its own, or those of the first set that agrees with it in having a thumb
    /// or not.
    fn ranges(&self, digits: &[Digit]) -> Option<&GraspRanges> {
        let opposed = digits.contains(&Digit::Thumb);
        let own = self.grasps.set.iter().find(|set| set.digits == digits);
        own.or_else(|| self.grasps.set.iter().find(|set| set.thumb.is_some() == opposed))
    }
}

/// Proposes a random grasp with `digits` of a hand. Returns `None` if there are no ranges for a set like this one.
///
/// ```
/// use dexterous_grasping::sampler::{HandForm, ObjectExtent, propose};
/// use hand_model::{Digit, Hand};
/// use nalgebra::Vector3;
/// use rand::SeedableRng;
///
/// let form = HandForm::from_hand(&Hand::ftac());
/// let can = ObjectExtent { name: "can".into(), half: Vector3::new(0.033, 0.033, 0.06), yaw_matters: false };
/// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
/// let grasp = propose(&form, &can, &[Digit::Thumb, Digit::Index, Digit::Middle], 0, &mut rng).expect("has ranges");
/// assert!(grasp.close_tension[Digit::Ring.index()] == 0.0);
/// ```
pub fn propose(hand: &HandForm, object: &ObjectExtent, digits: &[Digit], id: u32, rng: &mut impl Rng) -> Option<Grasp> {
    if let Some(jaws) = &hand.jaws {
        return Some(jaws::propose(jaws, object, digits, id, rng));
    }
    let (HandForm { side, scale, grasps, .. }, ranges) = (hand, hand.ranges(digits)?);
    let mut uniform = |range: [f64; 2]| rng.random_range(range[0]..range[1]);
    let deg = std::f64::consts::PI / 180.0;
    let radius = 0.5 * (object.half.z + 0.5 * (object.half.x + object.half.y));
    let slack: DigitVector = (0..hand.digits).map(|_| 0.0).collect();
    let (mut pre, mut close) = (slack, slack);
    let roll = deg * uniform(ranges.roll);
    let pitch = deg * uniform(ranges.pitch);
    let [along, across, gap] = [ranges.along, ranges.across, ranges.gap].map(&mut uniform);
    let opposition = deg * uniform(ranges.opposition);
    let raise = uniform(ranges.raise);
    let thumb = ranges.thumb.as_ref();
    let delay = thumb.map_or(0.0, |thumb| uniform(thumb.delay));
    let tension = uniform(ranges.tension);
    let thumb_tension = thumb.map_or(tension, |thumb| uniform(thumb.tension));
    let before = uniform(ranges.pre_tension);
    let thumb_before = thumb.map_or(before, |thumb| uniform(thumb.pre_tension));
    for digit in digits {
        let of_thumb = *digit == Digit::Thumb;
        pre[digit.index()] = if of_thumb { thumb_before } else { before };
        close[digit.index()] = if of_thumb { thumb_tension } else { tension };
    }
    let yaw = if object.yaw_matters { uniform([-0.6, 0.6]) } else { 0.0 };
    Some(Grasp {
        id,
        object: object.name.clone(),
        digits: digits.to_vec(),
        yaw,
        pitch,
        roll: side * roll,
        center: [-side * scale * across, scale * (along - grasps.wrist), scale * (grasps.palm_face - gap) - radius],
        pre_tension: pre,
        close_tension: close,
        opposition,
        raise,
        thumb_delay: delay,
        held: None,
        held_joints: None,
        held_sigmas: None,
        score: 0.0,
    })
}

/// Varies `grasp` by a small random change of each of its parameters. The result was not closed in physics yet: pose,
/// joint angles and score are those of a proposal.
pub fn vary(grasp: &Grasp, id: u32, rng: &mut impl Rng) -> Grasp {
    let mut near = |value: f64, spread: f64| value + spread * rng.random_range(-1.0..1.0);
    let mut new = grasp.clone();
    new.id = id;
    new.pitch = near(grasp.pitch, 0.12);
    new.roll = near(grasp.roll, 0.12);
    for axis in 0..3 {
        new.center[axis] = near(grasp.center[axis], 0.006);
    }
    new.opposition = near(grasp.opposition, 0.1).clamp(0.0, 1.57);
    new.raise = near(grasp.raise, 0.004).max(0.0);
    new.thumb_delay = near(grasp.thumb_delay, 0.05);
    for n in 0..grasp.close_tension.len() {
        new.pre_tension[n] = near(grasp.pre_tension[n], 0.1 * grasp.pre_tension[n]);
        new.close_tension[n] = near(grasp.close_tension[n], 0.1 * grasp.close_tension[n]);
    }
    new.held = None;
    new.held_joints = None;
    new.held_sigmas = None;
    new.score = 0.0;
    new
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digit_sets::digit_sets;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn same_seed_same_proposals() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: true };
        let form = HandForm::from_hand(&Hand::ftac());
        let pinch = [Digit::Thumb, Digit::Index, Digit::Middle];
        let draw = |seed| propose(&form, &object, &pinch, 1, &mut ChaCha8Rng::seed_from_u64(seed)).expect("ranges");
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
    }

    /// A right hand's proposals are the mirror image of a left hand's. Those of the built-in hand are unscaled.
    #[test]
    fn a_right_hand_mirrors_proposals() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: true };
        let left = HandForm::from_hand(&Hand::ftac());
        assert_eq!((left.side, left.scale, left.digits, left.jaws), (1.0, 1.0, 5, None));
        let side = [Digit::Ring, Digit::Little];
        let draw = |form| propose(form, &object, &side, 1, &mut ChaCha8Rng::seed_from_u64(5)).expect("ranges");
        let (one, other) = (draw(&left), draw(&HandForm { side: -1.0, ..left.clone() }));
        let mirrored = one.palm_rotation(0.0) * Vector3::from(one.center);
        let found = other.palm_rotation(-2.0 * other.yaw) * Vector3::from(other.center);
        assert!((mirrored.component_mul(&Vector3::new(1.0, -1.0, 1.0)) - found).norm() < 1e-12, "{mirrored} {found}");
    }

    /// Only the digits of the set are pulled, even if the hand's file has no ranges for the set.
    #[test]
    fn only_its_digits_are_pulled() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: false };
        let (hand, mut rng) = (Hand::ftac(), ChaCha8Rng::seed_from_u64(1));
        for digits in [digit_sets(&hand, 2), digit_sets(&hand, 3)].concat() {
            let grasp = propose(&HandForm::from_hand(&hand), &object, &digits, 0, &mut rng).expect("ranges");
            assert_eq!(crate::grasp::pulled_digits(&grasp.close_tension), digits);
        }
    }
}
