//! Cable tensions over time, and the servo goals that produce them.

use std::f64::consts::FRAC_PI_2;

use dexterous_grasping::Grasp;
use hand_model::robot::{ServoGoal, ServoState};
use hand_model::transmission::friction::CableFriction;
use hand_model::{ActuatorVector, Digit, DigitVector, Hand};
use tactile_perception::posture::cable_excursion;

/// Current limit of the opposition servo, A.
const OPPOSITION_CURRENT: f64 = 0.6;
/// Rate limit of a cable tension, N/s.
const TENSION_RATE: f64 = 80.0;

/// Servo goals for cable tensions (N) and the angle of the opposition joint (rad).
pub(super) fn servo_goals(hand: &Hand, tension: &[f64], opposition: f64) -> ActuatorVector<ServoGoal> {
    hand.servo_goals(tension, opposition, OPPOSITION_CURRENT)
}

/// Servo tensions (N) for which the joints of closing digits feel the tensions `wanted` (N). They compensate for the
/// guide friction up to the middle joint of a digit whose measured excursion is shared equally among its joints.
pub fn friction_compensated(
    hand: &Hand,
    friction: &CableFriction,
    servos: &[ServoState],
    wanted: &[f64],
) -> DigitVector {
    if friction.coefficient == 0.0 {
        return wanted.iter().copied().collect();
    }
    hand.each_digit(|cable| {
        let full = hand.transmission.cables[cable].full_excursion();
        let angle = FRAC_PI_2 * (cable_excursion(hand, cable, &servos[cable]) / full).clamp(0.0, 1.0);
        // Wrap of the cable up to the middle joint: all of the first joint's angle and half of its own.
        let friction = hand.cable_guide_friction(cable, friction);
        wanted[cable] / friction.tension_ratio(1.0, friction.routing + 1.5 * angle)
    })
}

/// Moves the tensions `now` towards `wanted` (N) for one tick (s), within [`TENSION_RATE`].
pub fn ramp_tension(now: &mut DigitVector, wanted: &[f64], tick: f64) {
    for (now, wanted) in now.iter_mut().zip(wanted) {
        *now += (wanted - *now).clamp(-TENSION_RATE * tick, TENSION_RATE * tick);
    }
}

/// Tension of a digit (N) after `grasp` has been closing for `time` (s). The thumb may start later or earlier than the
/// fingers.
pub fn closing_tension(grasp: &Grasp, digit: usize, time: f64) -> f64 {
    let delay = if digit == Digit::Thumb.index() { grasp.thumb_delay.max(0.0) } else { (-grasp.thumb_delay).max(0.0) };
    if time >= delay { grasp.close_tension[digit] } else { grasp.pre_tension[digit] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middle joint of a half-closed digit feels the desired tension. An open digit loses only the friction of the
    /// wrap at the palm.
    #[test]
    fn the_middle_joint_feels_what_is_wanted() {
        let hand = Hand::ftac();
        let friction = hand.parameters.cable.friction;
        let (digit, angle, wanted) = (Digit::Index.index(), 0.8, [10.0; 5]);
        let q = hand.each_joint(|_| angle);
        let path = &hand.transmission.cables[digit];
        let radius = hand.parameters.cable.spool_radius;
        let mut servos = hand.each_actuator(|_| ServoState::default());
        servos[digit].position = path.excursion(&q) / radius;
        let pulled = friction_compensated(&hand, &friction, &servos, &wanted);
        let felt = path.span_tensions(&q, pulled[digit], &friction, &[1.0; 3])[1];
        assert!((felt - 10.0).abs() < 0.2, "{felt} of {pulled:?}");
        let open = friction_compensated(&hand, &friction, &hand.each_actuator(|_| ServoState::default()), &wanted);
        assert!((open[0] / 10.0 - (friction.coefficient * friction.routing).exp()).abs() < 1e-12);
        assert_eq!(friction_compensated(&hand, &CableFriction::NONE, &servos, &wanted)[..], wanted);
    }
}
