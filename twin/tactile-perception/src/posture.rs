//! Joint angles from servo readings, although there are more joints than servos.
//!
//! Each cable's servo measures two quantities: the excursion of its digit (the cable length that the three joints have
//! taken up) and the cable's tension. With the springs this gives four equations for three angles: excursion(q) is known,
//! and at every joint K q = r(q) T + contact torque. Without contact they determine the posture; with contact the touch
//! is needed too (see [`crate::pose`]).

use hand_model::bisection::bisect;
use hand_model::robot::ServoState;
use hand_model::transmission::friction::{CableFriction, CableLosses};
use hand_model::transmission::{Crossing, MAX_SPANS};
use hand_model::{DigitVector, GRAVITY, Hand, HandVector};
use nalgebra::{DMatrix, SMatrix, SVector, UnitQuaternion, Vector3};

/// Readings from which the posture follows, in addition to the contacts on the pads.
#[derive(Debug, Clone, Copy)]
pub struct Readings<'a> {
    /// State of each servo, in actuator order.
    pub servos: &'a [ServoState],
    /// Gravity along the palm's axes, m/s2; zero if the orientation of the palm is unknown.
    pub gravity: Vector3<f64>,
}

impl<'a> Readings<'a> {
    /// Readings of a hand with the orientation `palm` from the arm's encoders.
    pub fn new(servos: &'a [ServoState], palm: &UnitQuaternion<f64>) -> Self {
        Self { servos, gravity: palm.inverse() * Vector3::new(0.0, 0.0, -GRAVITY) }
    }

    /// Readings of a hand whose orientation is unknown.
    pub fn without_gravity(servos: &'a [ServoState]) -> Self {
        Self { servos, gravity: Vector3::zeros() }
    }
}

/// Joint angles with the cable readings they follow from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// Joint angles, rad.
    pub q: HandVector,
    /// Cable tensions, N, never negative.
    pub tensions: DigitVector,
    /// Cable excursions, m.
    pub excursions: DigitVector,
}

/// Tension (N, never negative) of a cable whose servo is at rest.
pub fn cable_tension(hand: &Hand, cable: usize, servo: &ServoState) -> f64 {
    (hand.servos[cable].torque_constant * servo.current / hand.cables[cable].spool_radius).max(0.0)
}

/// Excursion (m) of a cable: the wound length less the stretch of the cable. Negative for a slack cable.
pub fn cable_excursion(hand: &Hand, cable: usize, servo: &ServoState) -> f64 {
    let own = &hand.cables[cable];
    servo.position * own.spool_radius - cable_tension(hand, cable, servo) / own.stiffness
}

/// The opposition joint and its angle (rad), clamped to its limits; `None` for a hand without it.
fn opposition(hand: &Hand, servos: &[ServoState]) -> Option<(usize, f64)> {
    let joint = hand.transmission.opposition?;
    let (limits, last) = (&hand.tree.joints[joint], hand.cables.len());
    let angle = servos[last].position / hand.servos[last].gear_ratio_opposition;
    Some((joint, angle.clamp(limits.lower, limits.upper)))
}

/// Posture of a hand that touches nothing: the spring equilibrium that takes up the measured excursions.
pub fn free_posture(hand: &Hand, servos: &[ServoState]) -> Posture {
    let mut q = hand.open_angles();
    if let Some((joint, angle)) = opposition(hand, servos) {
        q[joint] = angle;
    }
    let excursions = hand.each_digit(|cable| cable_excursion(hand, cable, &servos[cable]));
    for (cable, &excursion) in excursions.iter().enumerate() {
        for (joint, angle) in free_digit(hand, cable, excursion) {
            q[joint] = angle;
        }
    }
    Posture { q, tensions: hand.each_digit(|cable| cable_tension(hand, cable, &servos[cable])), excursions }
}

/// Covariance of all joint angles, rad2.
pub type JointCovariance = DMatrix<f64>;

/// Covariance of the joints on `cable` of a free digit at `excursion` (m), in the order of the joints along the cable.
/// It includes the error of the excursion (`sigma`, m), the backlash of the gear, and friction, which distributes an
/// excursion among the joints differently after closing than after opening. `q` are the angles without friction.
pub fn free_covariance(
    hand: &Hand,
    cable: usize,
    (q, excursion): (&[f64], f64),
    sigma: f64,
    losses: &CableLosses,
) -> SMatrix<f64, MAX_SPANS, MAX_SPANS> {
    let path = &hand.transmission.cables[cable];
    let mut covariance = SMatrix::zeros();
    let mut add = |spread: SVector<f64, MAX_SPANS>| covariance += spread * spread.transpose();
    // Response of each joint, and of the excursion, to the tension, at the one that balances the springs.
    let needed = hand.transmission.tension_for(cable, q, &hand.open_angles());
    let (mut give, mut taken) = (SVector::zeros(), 0.0);
    for (slot, (joint, residual_slope)) in spring_residuals(hand, cable, q, needed).map(|(j, _, s)| (j, s)).enumerate()
    {
        let arm = path.joints[slot].lever.moment_arm(q[joint]);
        give[slot] = arm / residual_slope;
        taken += arm * give[slot];
    }
    add(give * (excursion_sigma(hand, sigma, losses) / taken));
    if losses.friction.coefficient > 0.0 {
        let [closed, opened] =
            [1.0, -1.0].map(|state| free_digit_sliding(hand, cable, excursion, &losses.friction, state));
        let half = closed.iter().zip(&opened).map(|((_, a), (_, b))| 0.5 * (a - b));
        add(SVector::from_iterator(half.chain(std::iter::repeat(0.0)).take(MAX_SPANS)));
    }
    covariance
}

/// Joint angles (joint, rad) on `cable` in spring equilibrium without contact at the given `excursion` (m).
pub fn free_digit(hand: &Hand, cable: usize, excursion: f64) -> Vec<(usize, f64)> {
    free_digit_sliding(hand, cable, excursion, &CableFriction::NONE, 0.0)
}

/// [`free_digit`] with all guides in the same `state` of friction: 1 after closing, -1 after opening.
pub fn free_digit_sliding(
    hand: &Hand,
    cable: usize,
    excursion: f64,
    friction: &CableFriction,
    state: f64,
) -> Vec<(usize, f64)> {
    let friction = &hand.cable_guide_friction(cable, friction);
    let angles = |tension: f64| hand.transmission.free_angles_with_friction(cable, tension, friction, state);
    let path = &hand.transmission.cables[cable];
    let taken_up = |angles: &[(usize, f64)]| -> f64 {
        path.joints.iter().zip(angles).map(|(crossing, (_, angle))| crossing.lever.excursion(*angle)).sum()
    };
    // The excursion increases with the tension that a free digit would need.
    let missing = |tension: f64| taken_up(&angles(tension)) - excursion;
    let mut high = 1.0;
    while missing(high) < 0.0 && high < 1e3 {
        high *= 2.0;
    }
    angles(bisect(missing, [0.0, high], 40))
}

/// Excursion residual (m) of `cable` at joint angles `q`, and its derivative (the moment arm) for each joint that it
/// crosses.
pub fn excursion_residual(hand: &Hand, cable: usize, q: &[f64], excursion: f64) -> (f64, [(usize, f64); 3]) {
    let path = &hand.transmission.cables[cable];
    let mut derivative = [(usize::MAX, 0.0); 3];
    for (slot, Crossing { joint, lever, .. }) in derivative.iter_mut().zip(&path.joints) {
        *slot = (*joint, lever.moment_arm(q[*joint]));
    }
    (path.excursion(q) - excursion, derivative)
}

/// Equilibrium residual K q - r(q) T (N m) of every joint on `cable`, as (joint, residual, derivative by its own angle). In
/// equilibrium it equals the contact torque.
pub fn spring_residuals(hand: &Hand, cable: usize, q: &[f64], tension: f64) -> impl Iterator<Item = (usize, f64, f64)> {
    hand.transmission.cables[cable].joints.iter().map(move |Crossing { joint, lever, .. }| {
        const DIFFERENCE_STEP: f64 = 1e-5;
        let (torque, spring) = (hand.transmission.spring_torque(*joint, q[*joint]), hand.transmission.springs[*joint]);
        let angle = q[*joint];
        let slope = (lever.moment_arm(angle + DIFFERENCE_STEP) - lever.moment_arm(angle - DIFFERENCE_STEP))
            / (2.0 * DIFFERENCE_STEP);
        (*joint, torque - lever.moment_arm(angle) * tension, spring - slope * tension)
    })
}

/// Standard deviation (N m) of the torque of `cable` at each joint that it crosses, in order, due to friction in the
/// guides, for a `tension` (N). A sticking guide transmits anything from exp(-mu wrap) to exp(mu wrap) of the tension
/// at the spool. A sliding one is at an end of that range, so half the range is taken as the standard deviation.
pub fn friction_sigmas(hand: &Hand, cable: usize, q: &[f64], tension: f64, losses: &CableLosses) -> [f64; MAX_SPANS] {
    let path = &hand.transmission.cables[cable];
    let friction = hand.cable_guide_friction(cable, &losses.friction);
    let mut sigmas = path.wraps(q, &friction);
    for (sigma, Crossing { joint, lever, .. }) in sigmas.iter_mut().zip(&path.joints) {
        *sigma = lever.moment_arm(q[*joint]).abs() * tension * (friction.coefficient * *sigma).sinh();
    }
    sigmas
}

/// Standard deviation of a measured excursion, m: `sigma` combined with half the backlash of the servo gear at the
/// largest spool.
pub fn excursion_sigma(hand: &Hand, sigma: f64, losses: &CableLosses) -> f64 {
    let radius = hand.cables.iter().map(|cable| cable.spool_radius).fold(0.0, f64::max);
    sigma.hypot(0.5 * losses.backlash * radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::ActuatorVector;
    use proptest::prelude::*;

    /// Servo readings of a free hand in equilibrium at the given tensions.
    fn free_servos(hand: &Hand, tensions: DigitVector, opposition: f64) -> (ActuatorVector<ServoState>, HandVector) {
        let mut q = hand.open_angles();
        q[0] = opposition;
        for (cable, tension) in tensions.iter().enumerate() {
            for (joint, angle) in hand.transmission.free_angles(cable, *tension) {
                q[joint] = angle;
            }
        }
        let (radius, servo) = (hand.parameters.cable.spool_radius, hand.parameters.servo);
        let mut servos = hand.each_actuator(|_| ServoState::default());
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
            let (servos, q) = free_servos(&hand, [tension, 0.8 * tension, 0.5 * tension, 0.2 * tension, 0.0].into(), opposition);
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
        let posture = free_posture(&hand, &[ServoState { position: -0.2, ..ServoState::default() }; 6]);
        assert!(posture.q.iter().all(|angle| angle.abs() < 1e-6), "{:?}", posture.q);
    }
}
