//! Residuals between robot and reference model as separable quantities: cable tensions, and the force on the hand.

use hand_model::arm::MAX_ARM_JOINTS;
use hand_model::gravity::pack_torques;
use hand_model::robot::ServoState;
use hand_model::{DigitVector, Hand};
use nalgebra::{SMatrix, Vector3};

use super::reference_model::Innovation;

/// Tikhonov damping of the singular values of the arm's Jacobian. Forces along a direction in which the arm can hardly
/// move are not observable. With a cut-off instead, the force jumped by 0.7 N as the arm passed through such a posture.
const JACOBIAN_DAMPING: f64 = 0.03;
/// Speed below which dry friction is scaled down in proportion, rad/s.
const DRY_FRICTION_SPEED: f64 = 0.1;

/// State of a cable.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CableState {
    /// Tension that the cable bears, N: that of the servo's current, less the shares of rotor inertia and bearing
    /// friction.
    pub tension: f64,
    /// Tension of the model's cable, N: that of a free digit with the same spool position.
    pub reference_tension: f64,
    /// Tension that the current would hold at rest, N.
    pub servo_tension: f64,
    /// Increase of the tension within the tick with the digit blocked, N.
    pub blocked_increase: f64,
    /// Cable on the spool, m.
    pub wound_length: f64,
    /// Winding speed, m/s.
    pub speed: f64,
}

/// Residuals of one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residuals {
    pub cables: DigitVector<CableState>,
    /// External force on the robot's hand beyond the model's, world axes, N.
    pub force: Vector3<f64>,
}

impl Residuals {
    /// Computes the residuals of a tick of length `tick` (s) between the readings `before` and `now`, with the
    /// arm's `jacobian` at the palm (world axes).
    pub fn new(
        hand: &Hand,
        [before, now]: [&[ServoState]; 2],
        tick: f64,
        innovation: &Innovation,
        jacobian: &SMatrix<f64, 6, MAX_ARM_JOINTS>,
    ) -> Self {
        let cable = |n: usize| {
            let (servo, radius) = (&hand.servos[n], hand.cables[n].spool_radius);
            let (before, now) = (&before[n], &now[n]);
            let speed = 0.5 * (before.velocity + now.velocity);
            let dry = servo.friction * (speed / DRY_FRICTION_SPEED).clamp(-1.0, 1.0);
            let torque = 0.5 * servo.torque_constant * (before.current + now.current)
                - servo.damping * speed
                - dry
                - servo.rotor_inertia * (now.velocity - before.velocity) / tick;
            CableState {
                tension: torque / radius,
                reference_tension: innovation.tensions[n],
                servo_tension: servo.torque_constant * now.current / radius,
                blocked_increase: (hand.cables[n].stiffness * radius * speed * tick).max(0.0),
                wound_length: radius * now.position,
                speed: radius * now.velocity,
            }
        };
        // The arm balances the wrench on the hand: torque = -J^T wrench.
        let torque = pack_torques(&innovation.arm_torque);
        let svd = jacobian.transpose().svd(true, true);
        let force = svd.u.zip(svd.v_t).map_or_else(Vector3::zeros, |(u, v_t)| {
            let damped = svd.singular_values.map(|value| value / (value.powi(2) + JACOBIAN_DAMPING.powi(2)));
            let along = (u.transpose() * -torque).component_mul(&damped);
            (v_t.transpose() * along).fixed_rows::<3>(0).into_owned()
        });
        Self { cables: hand.each_digit(cable), force }
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Arm;

    use super::*;

    fn innovation() -> Innovation {
        Innovation { tensions: [0.0; 5].into(), ..Innovation::default() }
    }

    /// At rest a cable bears the tension that the current holds. A spool that speeds up under it bears none.
    #[test]
    fn a_cable_bears_what_does_not_turn_the_rotor() {
        let hand = Hand::ftac();
        let (servo, radius) = (&hand.servos[1], hand.cables[1].spool_radius);
        let still = ServoState { current: 0.1, ..ServoState::default() };
        let jacobian = SMatrix::<f64, 6, MAX_ARM_JOINTS>::zeros();
        let holding = Residuals::new(&hand, [&[still; 6]; 2], 0.01, &innovation(), &jacobian).cables[1];
        assert!((holding.tension - 0.1 * servo.torque_constant / radius).abs() < 1e-9);
        assert_eq!(holding.tension, holding.servo_tension);
        // Torque of 0.1 A over the rotor's inertia, less the bearing friction at the mean speed.
        let faster = 0.1 * servo.torque_constant * 0.01 / (servo.rotor_inertia + 0.5 * 0.01 * servo.damping);
        let spun = ServoState { velocity: faster, ..still };
        let states = [&[still; 6][..], &[spun; 6][..]];
        let free = Residuals::new(&hand, states, 0.01, &innovation(), &jacobian).cables[1];
        assert!(free.tension.abs() < 1e-9, "{}", free.tension);
    }

    /// The torques of a force on the palm reproduce that force.
    #[test]
    fn a_force_on_the_palm_is_found() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let links = arm.tree.forward(&Arm::gen3().home);
        let point = nalgebra::Point3::new(0.02, 0.0, -0.1);
        let jacobian: SMatrix<f64, 6, MAX_ARM_JOINTS> =
            arm.tree.jacobian(&links, 6, &point).fixed_view::<6, 7>(0, 0).into_owned();
        let force = Vector3::new(3.0, -4.0, -6.0);
        let torque = -(jacobian.fixed_rows::<3>(0).transpose() * force);
        let still = hand.each_actuator(|_| ServoState::default());
        let innovation = Innovation { arm_torque: torque.iter().copied().collect(), ..innovation() };
        let found = Residuals::new(&hand, [&still; 2], 0.01, &innovation, &jacobian).force;
        assert!((found - force).norm() < 0.03 * force.norm(), "{found}");
    }

    /// As the arm passes through a singular posture, in which it can hardly move its hand in some direction, the force
    /// for the same torques does not jump.
    #[test]
    fn a_force_does_not_jump_where_the_arm_is_singular() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let point = nalgebra::Point3::new(0.02, 0.0, -0.1);
        let still = hand.each_actuator(|_| ServoState::default());
        let innovation = Innovation { arm_torque: [0.1, -0.3, 0.2, 0.4, -0.1, 0.2, 0.05].into(), ..innovation() };
        let force = |elbow: f64| {
            let mut at = Arm::gen3().home;
            at[3] = elbow;
            let jacobian: SMatrix<f64, 6, MAX_ARM_JOINTS> =
                arm.tree.jacobian(&arm.tree.forward(&at), 6, &point).fixed_view::<6, 7>(0, 0).into_owned();
            Residuals::new(&hand, [&still; 2], 0.01, &innovation, &jacobian).force
        };
        let all: Vec<Vector3<f64>> = (-400..=400).map(|n| force(0.001 * f64::from(n))).collect();
        let jump = all.windows(2).map(|pair| (pair[1] - pair[0]).norm()).fold(0.0, f64::max);
        assert!(jump < 0.2, "{jump} N in a thousandth of a radian");
    }
}
