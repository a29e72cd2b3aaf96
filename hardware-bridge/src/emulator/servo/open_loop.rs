//! Velocity control, and direct control of the duty cycle. Profiles are not emulated: goals are approached at once.

use dynamixel_bus::register::Unit;
use dynamixel_bus::x_series::mode;
use dynamixel_bus::xc330;

use super::EmulatedServo;

/// Maximum lead of the velocity-control goal ahead of the shaft, counts: a blocked shaft does not run after its goal
/// once free.
const MAX_GOAL_LEAD: f64 = 100.0;
/// Stall current (A) and no-load speed (rad/s) at the supply (V) for which the e-Manual states them.
const STALL_CURRENT: f64 = 0.80;
const NO_LOAD_SPEED: f64 = 6.81;
const NOMINAL_VOLTAGE: f64 = 11.1;

impl EmulatedServo {
    /// Advances the goal of velocity control by `dt` (s).
    pub(super) fn advance_velocity_goal(&mut self, dt: f64) {
        if !self.torque() || self.get(&xc330::OPERATING_MODE) != mode::VELOCITY {
            return;
        }
        let speed = self.get(&xc330::GOAL_VELOCITY) as f64 * Unit::Velocity.per_count();
        let position = self.position() as f64;
        let wanted = self.velocity_goal + speed * dt / Unit::Angle.per_count();
        self.velocity_goal = wanted.clamp(position - MAX_GOAL_LEAD, position + MAX_GOAL_LEAD);
    }

    /// Computes the current of a DC motor under the goal duty cycle, A, signed as the shaft's angle: the supply drives
    /// it against the back-EMF.
    pub(super) fn open_loop_current(&self) -> f64 {
        let duty = self.sign() * self.get(&xc330::GOAL_PWM) as f64 * Unit::DutyCycle.per_count();
        STALL_CURRENT * (duty * self.voltage / NOMINAL_VOLTAGE - self.shaft.velocity / NO_LOAD_SPEED)
    }
}

#[cfg(test)]
mod tests {
    use hand_model::robot::{ServoGoal, ServoState};

    use super::*;
    use dynamixel_bus::protocol2::ServoError;
    use dynamixel_bus::register::Register;

    fn write(servo: &mut EmulatedServo, register: &Register, counts: i64) -> Result<(), ServoError> {
        servo.write(register.address, &counts.to_le_bytes()[..usize::from(register.size)])
    }

    fn on(operating_mode: i64) -> EmulatedServo {
        let mut servo = EmulatedServo::provisioned(1, 0);
        write(&mut servo, &xc330::OPERATING_MODE, operating_mode).expect("torque is off");
        write(&mut servo, &xc330::TORQUE_ENABLE, 1).expect("on");
        servo
    }

    fn shaft(position: f64, velocity: f64) -> ServoState {
        ServoState { position, velocity, current: 0.1, temperature: 0.0 }
    }

    /// A free shaft that follows its goal turns with the goal velocity; the goal of a blocked shaft does not run away.
    #[test]
    fn velocity_control() {
        let mut servo = on(mode::VELOCITY);
        write(&mut servo, &xc330::GOAL_VELOCITY, 100).expect("below the limit");
        let speed = 100.0 * Unit::Velocity.per_count();
        let mut position = 0.0;
        for step in 1..=100 {
            servo.advance(0.01 * f64::from(step), 0.01, shaft(position, speed));
            let ServoGoal::Position { angle, .. } = servo.applied_goal() else { panic!("no position") };
            position = angle;
        }
        assert!((position - speed).abs() < 2e-3, "{position} after a second at {speed} rad/s");
        for step in 0..100 {
            servo.advance(1.0 + 0.01 * f64::from(step), 0.01, shaft(position, 0.0));
        }
        let ServoGoal::Position { angle, .. } = servo.applied_goal() else { panic!("no position") };
        assert!(angle - position < 0.16, "{angle} is far ahead of {position}");
        assert_eq!(write(&mut servo, &xc330::GOAL_VELOCITY, 400), Err(ServoError::DataLimit));
    }

    /// At full duty a stalled motor draws the published current, and one at the published speed draws none.
    #[test]
    fn bare_duty_cycle() {
        let mut servo = on(mode::PWM);
        assert!(matches!(servo.applied_goal(), ServoGoal::Current(current) if (current - STALL_CURRENT).abs() < 1e-12));
        servo.advance(0.01, 0.01, shaft(0.0, NO_LOAD_SPEED));
        assert!(matches!(servo.applied_goal(), ServoGoal::Current(current) if current.abs() < 1e-12));
        write(&mut servo, &xc330::GOAL_PWM, -443).expect("half, backwards");
        servo.advance(0.02, 0.01, shaft(0.0, 0.0));
        assert!(
            matches!(servo.applied_goal(), ServoGoal::Current(current) if (current + 0.5 * STALL_CURRENT).abs() < 1e-3)
        );
    }

    /// A tripped bus watchdog stops both modes.
    #[test]
    fn the_watchdog_stops_them() {
        for (operating_mode, goal) in [(mode::VELOCITY, &xc330::GOAL_VELOCITY), (mode::PWM, &xc330::GOAL_PWM)] {
            let mut servo = on(operating_mode);
            write(&mut servo, goal, 200).expect("taken");
            write(&mut servo, &xc330::BUS_WATCHDOG, 5).expect("100 ms");
            servo.feed_watchdog(0.0);
            servo.advance(0.2, 0.01, shaft(1.0, 0.0));
            assert!(servo.watchdog_tripped());
            servo.advance(0.4, 0.01, shaft(1.0, 0.0));
            match servo.applied_goal() {
                ServoGoal::Position { angle, .. } => assert!((angle - 1.0).abs() < 2e-3, "{angle}"),
                ServoGoal::Current(current) => assert_eq!(current, 0.0),
            }
        }
    }
}
