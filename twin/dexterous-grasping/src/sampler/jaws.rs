//! Proposals for a parallel gripper, which comes from above with its jaws beside the object.

use std::f64::consts::FRAC_PI_2;

use hand_model::hand::Jaws;
use hand_model::{Digit, DigitVector};
use rand::{Rng, RngExt};

use super::ObjectExtent;
use crate::grasp::Grasp;

/// Least clearance between the jaws' opening and an object that they take, m.
const OPENING_CLEARANCE: f64 = 0.006;
/// Least distance of the jaws' tips from the table, and of the palm from the object's top, m.
const TABLE_CLEARANCE: f64 = 0.005;
/// Range of heights at which an object is taken, m.
const HEIGHT_RANGE: f64 = 0.018;
/// Range of the force of each jaw, N.
const FORCE_RANGE: [f64; 2] = [12.0, 40.0];

/// Draws a random proposal.
pub(super) fn propose(jaws: &Jaws, object: &ObjectExtent, digits: &[Digit], id: u32, rng: &mut impl Rng) -> Grasp {
    // Jaws close along the object's y at yaw 0 and along its x at a quarter turn.
    let quarters = [(0.0, object.half.y), (FRAC_PI_2, object.half.x), (-FRAC_PI_2, object.half.x)];
    let fits = |(_, half): &(f64, f64)| 2.0 * half + OPENING_CLEARANCE < jaws.opening;
    let narrow: Vec<f64> = quarters.into_iter().filter(fits).map(|(yaw, _)| yaw).collect();
    let quarter =
        if object.yaw_matters && !narrow.is_empty() { narrow[rng.random_range(0..narrow.len())] } else { 0.0 };
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    // Height of the pads' centre above the object's centre.
    let lowest = (jaws.tip_reach + TABLE_CLEARANCE - object.half.z).max(object.half.z + TABLE_CLEARANCE - jaws.depth);
    let force = uniform(FORCE_RANGE[0], FORCE_RANGE[1]);
    // Both jaws pull with the same force, or neither does.
    let pull = |value: f64| -> DigitVector { [if digits.is_empty() { 0.0 } else { value }; 2].into_iter().collect() };
    Grasp {
        id,
        object: object.name.clone(),
        digits: digits.to_vec(),
        yaw: quarter + uniform(-0.15, 0.15),
        pitch: FRAC_PI_2 + uniform(-0.2, 0.2),
        roll: 0.0,
        center: [
            jaws.center.x + uniform(-0.003, 0.003),
            jaws.center.y + lowest + uniform(0.0, HEIGHT_RANGE),
            jaws.center.z + uniform(-0.005, 0.005),
        ],
        pre_tension: pull(0.0),
        close_tension: pull(force),
        opposition: 0.0,
        raise: 0.0,
        thumb_delay: 0.0,
        held: None,
        held_joints: None,
        held_sigmas: None,
        score: 0.0,
    }
}
