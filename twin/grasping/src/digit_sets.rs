//! Proposals for any set of digits: a ball held by one or more fingers against the palm, or between thumb and fingers.
//!
//! [`crate::sampler`] covers the two ways in which the benchmark's pairs are picked up. To carry more than two objects,
//! each must be held with fewer digits. The distributions are wide; which proposals hold is decided in physics.

use hand_model::{Digit, Hand};
use rand::{Rng, RngExt};

use crate::grasp::Grasp;
use crate::sampler::{PALM_FACE, WRIST};

/// A random grasp of a ball of `radius` (m) called `object` with `digits`.
pub fn propose_with(hand: &Hand, digits: &[Digit], object: &str, radius: f64, id: u32, rng: &mut impl Rng) -> Grasp {
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let deg = std::f64::consts::PI / 180.0;
    let fingers: Vec<Digit> = digits.iter().copied().filter(|digit| *digit != Digit::Thumb).collect();
    let column = |digit: &Digit| hand.tree.joints[hand.links(*digit)[0]].origin.translation.x;
    let middle = fingers.iter().map(column).sum::<f64>() / fingers.len().max(1) as f64;
    let opposed = fingers.len() < digits.len();
    let (mut pre, mut close) = (hand.slack(), hand.slack());
    for digit in digits {
        pre[digit.index()] = uniform(1.0, 4.0);
        close[digit.index()] = uniform(10.0, 36.0);
    }
    let [roll, pitch, along, gap] = if opposed {
        [uniform(-15.0, 35.0), uniform(5.0, 45.0), uniform(0.086, 0.134), uniform(0.002, 0.03)]
    } else {
        [uniform(-85.0, 10.0), uniform(-20.0, 25.0), uniform(0.045, 0.115), uniform(0.001, 0.016)]
    };
    Grasp {
        id,
        object: object.to_owned(),
        digits: Digit::ALL.into_iter().filter(|digit| digits.contains(digit)).collect(),
        yaw: 0.0,
        pitch: deg * pitch,
        roll: deg * roll,
        center: [middle + uniform(-0.02, 0.02), along - WRIST, PALM_FACE - gap - radius],
        pre_tension: pre,
        close_tension: close,
        opposition: deg * if opposed { uniform(40.0, 90.0) } else { uniform(0.0, 20.0) },
        raise: uniform(0.0, if opposed { 0.02 } else { 0.008 }),
        thumb_delay: if opposed { uniform(-0.25, 0.18) } else { 0.0 },
        held: None,
        held_joints: None,
        score: 0.0,
    }
}
