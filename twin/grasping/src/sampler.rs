//! Proposals: random grasps around the two ways in which this hand picks up an object and keeps digits free.
//!
//! The centres of the distributions come from experiments in physics: ring and little finger take an object from the
//! side, ulnar edge down, against the palm; thumb, index and middle take one from above with the thumb opposed. The
//! distributions are wide; which proposals hold is decided in physics. They are those of the left F-TAC Hand, which a right hand mirrors and one
//! of another size scales. A parallel gripper takes an object from above between its jaws ([`jaws`]).

mod jaws;

use hand_model::hand::Jaws;
use hand_model::parameters::Handedness;
use hand_model::{Digit, DigitVector, Hand};
use nalgebra::Vector3;
use rand::{Rng, RngExt};

use crate::grasp::{Grasp, Role};

/// Size of an object, for the sampler.
#[derive(Debug, Clone)]
pub struct ObjectExtent {
    pub name: String,
    /// Half extents of the resting object in world axes at yaw 0, m.
    pub half: Vector3<f64>,
    /// Whether the object is not symmetric about the vertical.
    pub yaw_matters: bool,
}

/// Distance of the palm's face from the palm frame's origin along -z, m.
pub(crate) const PALM_FACE: f64 = 0.0156;
/// Distance from the wrist to the palm frame's origin along y, m.
pub(crate) const WRIST: f64 = 0.1072;

/// How a hand differs from the one for which proposals are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandForm {
    /// 1 for a left hand, -1 for a right one.
    side: f64,
    /// Its size over that of the F-TAC Hand.
    scale: f64,
    /// How many digits it has.
    digits: usize,
    /// Of a parallel gripper.
    jaws: Option<Jaws>,
}

impl HandForm {
    pub fn of(hand: &Hand) -> Self {
        let side = match hand.parameters.handedness {
            Handedness::Left => 1.0,
            Handedness::Right => -1.0,
        };
        let scale = -hand.parameters.palm.flange_xyz[1] / WRIST;
        Self { side, scale, digits: hand.digits().len(), jaws: hand.jaws() }
    }
}

/// A random proposal for a hand.
pub fn propose(hand: HandForm, object: &ObjectExtent, role: Role, id: u32, rng: &mut impl Rng) -> Grasp {
    let HandForm { side, scale, digits, jaws } = hand;
    if let Some(jaws) = jaws {
        return jaws::propose(&jaws, object, role, id, rng);
    }
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let deg = std::f64::consts::PI / 180.0;
    let radius = 0.5 * (object.half.z + 0.5 * (object.half.x + object.half.y));
    let slack: DigitVector = (0..digits).map(|_| 0.0).collect();
    let (mut pre, mut close) = (slack, slack);
    let (yaw, pitch, roll, along, across, gap, opposition, raise, delay);
    match role {
        Role::First => {
            roll = deg * uniform(-75.0, -30.0);
            pitch = deg * uniform(-15.0, 10.0);
            along = uniform(0.045, 0.085);
            across = uniform(0.012, 0.036);
            gap = uniform(0.004, 0.016);
            opposition = deg * uniform(0.0, 20.0);
            raise = uniform(0.0, 0.008);
            delay = 0.0;
            let tension = uniform(12.0, 24.0);
            let before = uniform(1.0, 3.5);
            for digit in role.digits(digits) {
                pre[digit.index()] = before;
                close[digit.index()] = tension;
            }
        }
        Role::Second => {
            roll = deg * uniform(-8.0, 30.0);
            pitch = deg * uniform(13.0, 36.0);
            along = uniform(0.086, 0.134);
            across = uniform(-0.045, 0.0);
            gap = uniform(0.002, 0.030);
            opposition = deg * uniform(50.0, 90.0);
            raise = uniform(0.004, 0.025);
            delay = uniform(-0.25, 0.18);
            let (fingers, thumb) = (uniform(14.0, 40.0), uniform(12.0, 36.0));
            let (before, before_thumb) = (uniform(1.5, 4.0), uniform(1.5, 4.0));
            for digit in &role.digits(digits)[1..] {
                pre[digit.index()] = before;
                close[digit.index()] = fingers;
            }
            pre[Digit::Thumb.index()] = before_thumb;
            close[Digit::Thumb.index()] = thumb;
        }
    }
    yaw = if object.yaw_matters { uniform(-0.6, 0.6) } else { 0.0 };
    Grasp {
        id,
        object: object.name.clone(),
        digits: role.digits(digits).to_vec(),
        yaw,
        pitch,
        roll: side * roll,
        center: [-side * scale * across, scale * (along - WRIST), scale * (PALM_FACE - gap) - radius],
        pre_tension: pre,
        close_tension: close,
        opposition,
        raise,
        thumb_delay: delay,
        held: None,
        held_joints: None,
        score: 0.0,
    }
}

/// A proposal near `grasp`: a small random change of each of its parameters.
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
    new.score = 0.0;
    new
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn same_seed_same_proposals() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: true };
        let form = HandForm::of(&Hand::ftac());
        let draw = |seed| propose(form, &object, Role::Second, 1, &mut ChaCha8Rng::seed_from_u64(seed));
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
    }

    /// A right hand's proposals are the mirror image of a left hand's; those of the built-in hand are the distributions' own.
    #[test]
    fn a_right_hand_mirrors_proposals() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: true };
        let left = HandForm::of(&Hand::ftac());
        assert_eq!(left, HandForm { side: 1.0, scale: 1.0, digits: 5, jaws: None });
        let draw = |form| propose(form, &object, Role::First, 1, &mut ChaCha8Rng::seed_from_u64(5));
        let (one, other) = (draw(left), draw(HandForm { side: -1.0, ..left }));
        let mirrored = one.palm_rotation(0.0) * Vector3::from(one.center);
        let found = other.palm_rotation(-2.0 * other.yaw) * Vector3::from(other.center);
        assert!((mirrored.component_mul(&Vector3::new(1.0, -1.0, 1.0)) - found).norm() < 1e-12, "{mirrored} {found}");
    }

    /// Only the digits of the role are ever pulled.
    #[test]
    fn role_digits_only() {
        let object = ObjectExtent { name: "ball".into(), half: Vector3::repeat(0.02), yaw_matters: false };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for role in [Role::First, Role::Second] {
            let grasp = propose(HandForm::of(&Hand::ftac()), &object, role, 0, &mut rng);
            for digit in Digit::ALL {
                assert_eq!(grasp.close_tension[digit.index()] > 0.0, role.digits(5).contains(&digit));
            }
        }
    }
}
