//! Cable tensions over time, and the servo goals that make them.

use grasping::Grasp;
use hand_model::robot::ServoGoal;
use hand_model::{ACTUATORS, Digit, Hand};

/// Current limit of the opposition servo, A.
const OPPOSITION_CURRENT: f64 = 0.6;
/// Rate limit of a cable's tension, N/s.
const TENSION_RATE: f64 = 80.0;

/// Servo goals for five cable tensions (N) and the angle of the opposition joint (rad).
pub(super) fn servo_goals(hand: &Hand, tension: &[f64; 5], opposition: f64) -> [ServoGoal; ACTUATORS] {
    hand.servo_goals(tension, opposition, OPPOSITION_CURRENT)
}

/// Moves the tensions `now` towards `wanted` (N) for one tick (s), within [`TENSION_RATE`].
pub(super) fn approach_tension(now: &mut [f64; 5], wanted: &[f64; 5], tick: f64) {
    for (now, wanted) in now.iter_mut().zip(wanted) {
        *now += (wanted - *now).clamp(-TENSION_RATE * tick, TENSION_RATE * tick);
    }
}

/// Tension of a digit (N) after `grasp` has been closing for `time` (s): the thumb may start later or earlier than the fingers.
pub fn closing_tension(grasp: &Grasp, digit: usize, time: f64) -> f64 {
    let delay = if digit == Digit::Thumb.index() { grasp.thumb_delay.max(0.0) } else { (-grasp.thumb_delay).max(0.0) };
    if time >= delay { grasp.close_tension[digit] } else { grasp.pre_tension[digit] }
}
