//! The XC330 servo, which winds a cable or turns the thumb: current limit, speed-torque line, rotor inertia, encoder.
//!
//! A servo in current control produces `torque_constant * current`; current-based position control is a PD law on the
//! output angle whose current is clamped. In both modes the speed-torque line, `stall * (1 - |speed| / no_load)`,
//! clamps the driving torque. The cable is a one-sided spring between spool and joints.

use hand_model::parameters::{Cable, Servo as ServoParameters};
use hand_model::robot::{ServoGoal, ServoState};

use crate::backlash::Backlash;

/// Sub-steps of the motor within one physics step; the rotor on its cable rings at about 50 rad/s.
const SUBSTEPS: usize = 8;
/// Proportional gain of current-based position control, A/rad.
const POSITION_GAIN: f64 = 6.0;
/// Derivative gain of current-based position control, A s/rad.
const POSITION_DAMPING: f64 = 0.25;

/// State of one servo.
#[derive(Debug, Clone)]
pub struct ServoModel {
    parameters: ServoParameters,
    /// Output angle, rad.
    pub angle: f64,
    /// Output speed, rad/s.
    pub speed: f64,
    /// Input current, A.
    pub current: f64,
    /// Its last goal.
    pub goal: ServoGoal,
    backlash: Backlash,
}

impl ServoModel {
    /// Creates a servo at rest at angle 0, whose gear has this backlash (rad at its output).
    pub fn new(parameters: ServoParameters, backlash: f64) -> Self {
        let play = Backlash::new(backlash);
        Self { parameters, angle: 0.0, speed: 0.0, current: 0.0, goal: ServoGoal::Current(0.0), backlash: play }
    }

    /// Scales its torque by `factor` from now on, at the same currents and speeds.
    pub fn weaken(&mut self, factor: f64) {
        self.parameters.torque_constant *= factor;
        self.parameters.stall_torque *= factor;
    }

    fn motor_torque(&mut self) -> f64 {
        let p = &self.parameters;
        let (wanted, limit) = match self.goal {
            ServoGoal::Current(current) => (current, p.current_limit),
            ServoGoal::Position { angle, current_limit } => (
                POSITION_GAIN * (angle - self.angle) - POSITION_DAMPING * self.speed,
                current_limit.min(p.current_limit),
            ),
        };
        let mut current = wanted.clamp(-limit, limit);
        let available = p.stall_torque * (1.0 - self.speed.abs() / p.no_load_speed).max(0.0);
        let driving = current * self.speed > 0.0;
        if driving {
            let cap = available / p.torque_constant;
            current = current.clamp(-cap, cap);
        }
        self.current = current;
        p.torque_constant * current
    }

    /// Advances the servo by `dt` (s) with its cable on joints whose excursion is `excursion` (m), moving at `rate`
    /// (m/s). Returns the mean cable tension, N.
    pub fn step_cable(&mut self, cable: &Cable, excursion: f64, rate: f64, dt: f64) -> f64 {
        let h = dt / SUBSTEPS as f64;
        let mut total = 0.0;
        for n in 0..SUBSTEPS {
            let taken_up = excursion + rate * h * n as f64;
            let wound = cable.spool_radius * (self.angle - self.backlash.lag());
            let tension = (cable.stiffness * (wound - taken_up)).max(0.0);
            let before = self.angle;
            self.advance(cable.spool_radius * tension, h);
            self.backlash.update(self.angle - before, tension);
            total += tension;
        }
        // With a slack cable the spool stops at its open mark.
        if self.angle < 0.0 {
            self.angle = 0.0;
            self.speed = self.speed.max(0.0);
        }
        total / SUBSTEPS as f64
    }

    /// Returns the part of a twist (rad) between the servo, geared by `ratio`, and its load that the backlash of its
    /// gear does not absorb.
    pub fn beyond_backlash(&mut self, twist: f64, ratio: f64) -> f64 {
        self.backlash.transmitted_twist(twist, ratio)
    }

    /// Advances a servo that turns a joint through a stiff shaft with a `load` (N m) at the output.
    pub fn step_shaft(&mut self, load: f64, dt: f64) {
        let h = dt / SUBSTEPS as f64;
        for _ in 0..SUBSTEPS {
            self.advance(load, h);
        }
    }

    fn advance(&mut self, load: f64, h: f64) {
        let torque = self.motor_torque() - load - self.parameters.damping * self.speed;
        self.speed += torque / self.parameters.rotor_inertia * h;
        if self.parameters.friction > 0.0 {
            // Dry friction reduces the speed until the servo stops.
            let most = self.parameters.friction / self.parameters.rotor_inertia * h;
            self.speed -= self.speed.clamp(-most, most);
        }
        self.angle += self.speed * h;
    }

    /// Returns the readings of the servo: angle quantised by the encoder, unquantised speed, current in whole mA, and a
    /// constant temperature.
    pub fn state(&self) -> ServoState {
        let step = std::f64::consts::TAU / f64::from(self.parameters.encoder_counts);
        ServoState {
            position: (self.angle / step).round() * step,
            velocity: self.speed,
            current: (self.current * 1000.0).round() / 1000.0,
            temperature: 30.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::Hand;

    fn servo() -> (ServoModel, Cable) {
        let hand = Hand::ftac();
        (ServoModel::new(hand.parameters.servo, 0.0), hand.parameters.cable)
    }

    /// On a blocked cable the tension settles at torque over spool radius.
    #[test]
    fn stalled_tension() {
        let (mut servo, cable) = servo();
        servo.goal = ServoGoal::Current(0.15);
        let mut tension = 0.0;
        for _ in 0..480 {
            tension = servo.step_cable(&cable, 0.0, 0.0, 1.0 / 240.0);
        }
        let expected = 0.15 * 0.96748 / cable.spool_radius;
        assert!((tension - expected).abs() < 0.02 * expected, "{tension} {expected}");
    }

    /// Unloaded, the servo approaches but never exceeds its no-load speed.
    #[test]
    fn speed_limit() {
        let (mut servo, cable) = servo();
        servo.goal = ServoGoal::Current(0.9);
        for _ in 0..240 {
            servo.step_cable(&cable, 1.0, 0.0, 1.0 / 240.0);
            assert!(servo.speed <= 6.85);
        }
        assert!(servo.speed > 5.0, "{}", servo.speed);
    }

    /// A taut cable holds the spool behind the encoder: with the cable blocked, the servo turns half the backlash
    /// farther than one without.
    #[test]
    fn a_taut_cable_takes_up_the_play() {
        let (mut without, cable) = servo();
        let width = 0.0044;
        let mut with = ServoModel::new(without.parameters, width);
        let mut tensions = [0.0; 2];
        for (servo, tension) in [&mut without, &mut with].into_iter().zip(&mut tensions) {
            servo.goal = ServoGoal::Current(0.15);
            for _ in 0..480 {
                *tension = servo.step_cable(&cable, 0.0, 0.0, 1.0 / 240.0);
            }
        }
        assert!((tensions[0] - tensions[1]).abs() < 0.02 * tensions[0], "{tensions:?}");
        assert!((with.angle - without.angle - 0.5 * width).abs() < 0.02 * width, "{} {}", with.angle, without.angle);
    }

    /// Position control reaches its goal and respects the current limit.
    #[test]
    fn position_control() {
        let (mut servo, cable) = servo();
        servo.goal = ServoGoal::Position { angle: 2.0, current_limit: 0.3 };
        for _ in 0..480 {
            servo.step_cable(&cable, 1.0, 0.0, 1.0 / 240.0);
            assert!(servo.current.abs() <= 0.3 + 1e-12);
        }
        assert!((servo.angle - 2.0).abs() < 0.01, "{}", servo.angle);
    }
}
