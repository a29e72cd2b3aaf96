//! Joint angles from servo readings: fifteen joints, six servos.
//!
//! Each cable's servo measures two quantities: the excursion of its digit (the cable length that the three joints have
//! taken up) and the cable's tension. With the springs this gives four equations for three angles: excursion(q) is known,
//! and at every joint K q = r(q) T + contact torque. Without contact they determine the posture; with contact the touch
//! is needed too (see [`crate::pose`]).

use hand_model::digit::Digit;
use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, HAND_JOINTS, Hand};

/// Joint angles with the cable readings they follow from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// Joint angles, rad.
    pub q: [f64; HAND_JOINTS],
    /// Cable tensions, N, never negative.
    pub tensions: [f64; 5],
    /// Cable excursions, m.
    pub excursions: [f64; 5],
}

/// Tension (N, never negative) of a cable whose servo is at rest.
pub fn cable_tension(hand: &Hand, servo: &ServoState) -> f64 {
    (hand.parameters.servo.torque_constant * servo.current / hand.parameters.cable.spool_radius).max(0.0)
}

/// Excursion (m) of a cable: the wound length less the cable's stretch. Negative for a slack cable.
pub fn cable_excursion(hand: &Hand, servo: &ServoState) -> f64 {
    servo.position * hand.parameters.cable.spool_radius - cable_tension(hand, servo) / hand.parameters.cable.stiffness
}

/// Angle (rad) of the opposition joint, within its limits.
pub fn opposition_angle(hand: &Hand, servo: &ServoState) -> f64 {
    let joint = &hand.tree.joints[hand.transmission.opposition_joint];
    (servo.position / hand.parameters.servo.gear_ratio_opposition).clamp(joint.lower, joint.upper)
}

/// The posture of a hand that touches nothing: the spring equilibrium that takes up the measured excursions.
pub fn free_posture(hand: &Hand, servos: &[ServoState; ACTUATORS]) -> Posture {
    let mut q = [0.0; HAND_JOINTS];
    q[hand.transmission.opposition_joint] = opposition_angle(hand, &servos[5]);
    let excursions = std::array::from_fn(|cable| cable_excursion(hand, &servos[cable]));
    for (cable, &excursion) in excursions.iter().enumerate() {
        for (joint, angle) in free_digit(hand, cable, excursion) {
            q[joint] = angle;
        }
    }
    Posture { q, tensions: std::array::from_fn(|cable| cable_tension(hand, &servos[cable])), excursions }
}

/// Angles (joint, rad) on `cable` in spring equilibrium without contact at the given `excursion` (m).
pub fn free_digit(hand: &Hand, cable: usize, excursion: f64) -> Vec<(usize, f64)> {
    let path = &hand.transmission.cables[cable];
    let upper = path.joints.iter().map(|(joint, _)| hand.tree.joints[*joint].upper).fold(f64::INFINITY, f64::min);
    let taken_up = |angles: &[(usize, f64)]| -> f64 {
        path.joints.iter().zip(angles).map(|((_, guides), (_, angle))| guides.excursion(*angle)).sum()
    };
    // Excursion increases with tension: bisect for the tension that a free digit would need.
    let (mut low, mut high) = (0.0, 1.0);
    while taken_up(&hand.transmission.free_angles(cable, high, upper)) < excursion && high < 1e3 {
        high *= 2.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if taken_up(&hand.transmission.free_angles(cable, middle, upper)) < excursion {
            low = middle
        } else {
            high = middle
        }
    }
    hand.transmission.free_angles(cable, 0.5 * (low + high), upper)
}

/// Excursion residual (m) of `cable` at joint angles `q`, and its derivative (the moment arms) for each joint it crosses.
pub fn excursion_residual(hand: &Hand, cable: usize, q: &[f64], excursion: f64) -> (f64, [(usize, f64); 3]) {
    let path = &hand.transmission.cables[cable];
    let mut derivative = [(usize::MAX, 0.0); 3];
    for (slot, (joint, guides)) in derivative.iter_mut().zip(&path.joints) {
        *slot = (*joint, guides.moment_arm(q[*joint]));
    }
    (path.excursion(q) - excursion, derivative)
}

/// Equilibrium residual K q - r(q) T (N m) of every joint on `cable`, as (joint, residual, derivative by its own angle). In
/// equilibrium it equals the contact torque.
pub fn spring_residuals(hand: &Hand, cable: usize, q: &[f64], tension: f64) -> impl Iterator<Item = (usize, f64, f64)> {
    hand.transmission.cables[cable].joints.iter().map(move |(joint, guides)| {
        const STEP: f64 = 1e-5;
        let (angle, spring) = (q[*joint], hand.transmission.springs[*joint]);
        let slope = (guides.moment_arm(angle + STEP) - guides.moment_arm(angle - STEP)) / (2.0 * STEP);
        (*joint, spring * angle - guides.moment_arm(angle) * tension, spring - slope * tension)
    })
}

/// The digit whose chain holds `link`; `None` for the palm.
pub fn digit_of(link: Option<usize>) -> Option<Digit> {
    link.and_then(|link| Digit::ALL.get(link / 3).copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Servo readings of a free hand in equilibrium at the given tensions.
    fn free_servos(hand: &Hand, tensions: [f64; 5], opposition: f64) -> ([ServoState; ACTUATORS], [f64; HAND_JOINTS]) {
        let mut q = [0.0; HAND_JOINTS];
        q[0] = opposition;
        for (cable, tension) in tensions.iter().enumerate() {
            for (joint, angle) in hand.transmission.free_angles(cable, *tension, std::f64::consts::FRAC_PI_2) {
                q[joint] = angle;
            }
        }
        let (radius, servo) = (hand.parameters.cable.spool_radius, hand.parameters.servo);
        let mut servos = [ServoState::default(); ACTUATORS];
        for ((state, path), tension) in servos.iter_mut().zip(&hand.transmission.cables).zip(&tensions) {
            let stretch = tension / hand.parameters.cable.stiffness;
            state.position = (path.excursion(&q) + stretch) / radius;
            state.current = tension * radius / servo.torque_constant;
        }
        servos[5].position = opposition * servo.gear_ratio_opposition;
        (servos, q)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn free_posture_is_recovered(tension in 0.0f64..9.0, opposition in 0.0f64..1.5) {
            let hand = Hand::ftac();
            let (servos, q) = free_servos(&hand, [tension, 0.8 * tension, 0.5 * tension, 0.2 * tension, 0.0], opposition);
            let posture = free_posture(&hand, &servos);
            for (joint, (found, set)) in posture.q.iter().zip(&q).enumerate() {
                prop_assert!((found - set).abs() < 1e-4, "joint {joint}: {found} {set}");
            }
            for cable in 0..5 {
                prop_assert!(excursion_residual(&hand, cable, &posture.q, posture.excursions[cable]).0.abs() < 1e-6);
                for (joint, residual, _) in spring_residuals(&hand, cable, &posture.q, posture.tensions[cable]) {
                    prop_assert!(residual.abs() < 1e-4 || q[joint] > 1.57);
                }
            }
        }
    }

    #[test]
    fn slack_cable_means_open_digit() {
        let hand = Hand::ftac();
        let posture = free_posture(&hand, &[ServoState { position: -0.2, ..ServoState::default() }; ACTUATORS]);
        assert!(posture.q.iter().all(|angle| angle.abs() < 1e-6), "{:?}", posture.q);
    }
}
