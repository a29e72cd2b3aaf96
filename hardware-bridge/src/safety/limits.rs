//! Limits of a command: range, speed and current.
//!
//! Speed is limited relative to the previous *command*, not to the measured state: a measurement that lags would let a limited command creep past
//! its limit.

use crate::driven::SERVOS;
use hand_model::robot::ServoGoal;
use hand_model::{Arm, ArmVector};

use super::pressing::PressLimits;
use super::set_points::Motion;
use super::space::SpaceLimits;

/// How far ahead of the shaft the goal of a pure current command is put, rad: enough to saturate the servo's position control (P gain 900:
/// full duty from 0.2 rad on), little enough to come back from quickly.
pub const LEAD: f64 = 1.0;

/// How far beyond the closed stop the goal of a pure current command may be, rad: at the stop the cable is to be pulled as hard as
/// before it, and the shaft cannot follow. A shaft that does follow has lost its cable, which its angle tells ([`super::checks`]).
pub const BEYOND: f64 = 0.5;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoLimits {
    /// Least and greatest output angle, rad.
    pub angle: (f64, f64),
    /// Fastest change of the goal, and fastest allowed shaft, rad/s.
    pub speed: f64,
    /// Greatest goal current, A.
    pub current: f64,
    /// Greatest current while holding, A.
    pub hold_current: f64,
    /// Hottest, degrees Celsius.
    pub temperature: f64,
}

/// Limits of the arm's joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmLimits {
    /// Least and greatest angle of each joint, rad; infinite where a joint turns freely.
    pub angle: ArmVector<(f64, f64)>,
    /// Fastest change of each set-point, rad/s.
    pub speed: ArmVector,
    /// How fast each set-point slows down when the arm is stopped, rad/s2.
    pub deceleration: ArmVector,
    /// Bounds of acceleration and jerk of each set-point, if there are any.
    pub motion: Option<ArmVector<Motion>>,
}

/// When silence is too long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Watchdogs {
    /// The servos' own bus watchdog, s.
    pub servo_bus: f64,
    /// Largest age of a measurement of the arm, s.
    pub arm: f64,
    /// Age of the controller's newest command, s.
    pub host: f64,
}

/// Everything that is allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// The servos, in actuator order.
    pub servos: [ServoLimits; SERVOS],
    pub arm: ArmLimits,
    /// Least and greatest supply, V.
    pub voltage: (f64, f64),
    /// Oldest servo measurement to act on, s.
    pub staleness: f64,
    /// When silence is too long.
    pub watchdogs: Watchdogs,
    /// Time in which a release lets the current fade, s.
    pub release_time: f64,
    /// How much the arm may press; nothing is known of an arm without torque sensors.
    pub press: Option<PressLimits>,
    /// Where arm and hand may be.
    pub space: Option<SpaceLimits>,
}

/// What is sent to one servo: current-based position control.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SafeGoal {
    /// Output angle, rad.
    pub angle: f64,
    /// Greatest current, A, not negative.
    pub current: f64,
}

impl ServoLimits {
    /// What may be sent when `asked` comes, with the shaft at `measured` (rad), `previous` sent before, and `dt` (s) since.
    ///
    /// A current command becomes a goal [`LEAD`] ahead of the shaft in the wanted direction under that current, so that one operating mode serves
    /// both kinds of command, and the angle limits bind in both, but for [`BEYOND`].
    pub fn limit(&self, asked: &ServoGoal, measured: f64, previous: SafeGoal, dt: f64) -> SafeGoal {
        let (low, high) = self.angle;
        let (target, current, high) = match *asked {
            ServoGoal::Current(0.0) => (measured, 0.0, high + BEYOND),
            ServoGoal::Current(current) => (measured + LEAD * current.signum(), current.abs(), high + BEYOND),
            ServoGoal::Position { angle, current_limit } => (angle, current_limit, high),
        };
        let reach = self.speed * dt;
        let reached = target.clamp(previous.angle - reach, previous.angle + reach);
        SafeGoal {
            // Coming back from beyond the stop takes its time too.
            angle: reached.clamp(low, high.max(previous.angle - reach).max(low)),
            current: current.clamp(0.0, self.current),
        }
    }

    /// `previous` with the current capped for holding.
    pub fn hold(&self, previous: SafeGoal) -> SafeGoal {
        SafeGoal { current: previous.current.min(self.hold_current), ..previous }
    }
}

impl ArmLimits {
    /// Those of the arm's model; a joint that turns freely has no range.
    pub fn of(arm: &Arm) -> Self {
        Self {
            angle: arm.each(|joint| (arm.tree.joints[joint].lower, arm.tree.joints[joint].upper)),
            speed: arm.velocity_limits,
            deceleration: arm.acceleration_limits,
            motion: None,
        }
    }

    /// No speed of any joint.
    pub fn still(&self) -> ArmVector {
        self.speed.iter().map(|_| 0.0).collect()
    }

    /// Where an arm whose set-points are at `at` (rad) and move at `speed` (rad/s) comes to a stand when it is stopped, rad.
    pub fn stand(&self, at: &[f64], speed: &[f64]) -> ArmVector {
        let stand = |joint: usize| at[joint] + 0.5 * speed[joint] * speed[joint].abs() / self.deceleration[joint];
        (0..at.len()).map(stand).collect()
    }

    /// The set-points that may be sent, `dt` (s) after `previous`.
    pub fn limit(&self, asked: &[f64], previous: &[f64], dt: f64) -> ArmVector {
        let limited = |joint: usize| {
            let reach = self.speed[joint] * dt;
            let (low, high) = self.angle[joint];
            asked[joint].clamp(previous[joint] - reach, previous[joint] + reach).clamp(low, high)
        };
        (0..asked.len()).map(limited).collect()
    }

    /// The set-points `dt` (s) after `previous` of an arm that is to stop, and the speeds that are left of `speed` (rad/s).
    ///
    /// A set-point that stops from one cycle to the next asks for more torque than a joint has: the arm runs past it, and swings back. So it
    /// goes on by `v dt`, with `v` smaller by the deceleration each cycle.
    pub fn brake(&self, previous: &[f64], speed: &[f64], dt: f64) -> (ArmVector, ArmVector) {
        let slowed = |joint: usize| {
            let top = speed[joint].clamp(-self.speed[joint], self.speed[joint]);
            top.signum() * (top.abs() - self.deceleration[joint] * dt).max(0.0)
        };
        let slower: ArmVector = (0..previous.len()).map(slowed).collect();
        let gone_on = |joint: usize| {
            let (low, high) = self.angle[joint];
            (previous[joint] + slower[joint] * dt).clamp(low, high)
        };
        ((0..previous.len()).map(gone_on).collect(), slower)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn limits() -> Limits {
        let servo = ServoLimits { angle: (0.0, 4.5), speed: 6.0, current: 0.6, hold_current: 0.4, temperature: 60.0 };
        let arm = ArmLimits {
            angle: [(-2.0, 2.0); 7].into(),
            speed: [1.0; 7].into(),
            deceleration: [8.0; 7].into(),
            motion: None,
        };
        Limits {
            servos: [servo; SERVOS],
            arm,
            voltage: (9.0, 12.5),
            staleness: 0.05,
            watchdogs: Watchdogs { servo_bus: 0.1, arm: 0.1, host: 0.5 },
            release_time: 1.0,
            press: None,
            space: None,
        }
    }

    /// Winding: the goal runs ahead of the shaft by the lead and no further; opening starts from there, not from the end of the range.
    #[test]
    fn current_commands_lead_the_shaft() {
        let servo = limits().servos[0];
        let mut goal = SafeGoal::default();
        for _ in 0..1000 {
            goal = servo.limit(&ServoGoal::Current(0.2), 0.5, goal, 0.005);
        }
        assert_eq!(goal, SafeGoal { angle: 0.5 + LEAD, current: 0.2 });
        let back = servo.limit(&ServoGoal::Current(-0.1), 0.5, goal, 0.005);
        assert!((back.angle - (1.5 - 0.03)).abs() < 1e-12 && back.current == 0.1);
        assert_eq!(servo.limit(&ServoGoal::Current(0.0), 0.5, goal, 10.0), SafeGoal { angle: 0.5, current: 0.0 });
    }

    #[test]
    fn holding_keeps_the_goal_and_caps_the_current() {
        let servo = limits().servos[0];
        assert_eq!(servo.hold(SafeGoal { angle: 2.0, current: 0.2 }), SafeGoal { angle: 2.0, current: 0.2 });
        assert_eq!(servo.hold(SafeGoal { angle: 2.0, current: 0.6 }).current, 0.4);
    }

    /// From 0.8 rad/s with 8 rad/s2 an arm stands after 0.1 s and v^2 / 2a = 40 mrad; it does not leave its range for that.
    #[test]
    fn an_arm_brakes() {
        let arm = limits().arm;
        let mut at = ArmVector::from([0.0, 1.99, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let mut speed = ArmVector::from([0.8, 0.8, -0.8, 0.0, 5.0, 0.0, 0.0]);
        for _ in 0..100 {
            (at, speed) = arm.brake(&at, &speed, 0.001);
        }
        assert!(speed[0].abs() < 1e-9 && (at[0] - 0.04).abs() < 5e-4, "{at:?} {speed:?}");
        assert!((at[1], at[2], at[3]) == (2.0, -at[0], 0.0), "{at:?}");
        assert!(at[4] < 0.1, "never faster than its top speed: {}", at[4]);
    }

    proptest! {
        #[test]
        fn never_outside(
            asked in prop_oneof![
                any::<f64>().prop_map(ServoGoal::Current),
                any::<(f64, f64)>().prop_map(|(angle, current_limit)| ServoGoal::Position { angle, current_limit }),
            ],
            measured in -1.0..6.0_f64, angle in 0.0..=4.5 + BEYOND, current in 0.0..=0.6_f64, dt in 0.0..0.05_f64,
        ) {
            prop_assume!(match asked {
                ServoGoal::Current(current) => current.is_finite(),
                ServoGoal::Position { angle, current_limit } => angle.is_finite() && current_limit.is_finite(),
            });
            let servo = limits().servos[0];
            let goal = servo.limit(&asked, measured, SafeGoal { angle, current }, dt);
            prop_assert!((0.0..=4.5 + BEYOND).contains(&goal.angle) && (0.0..=0.6).contains(&goal.current));
            prop_assert!((goal.angle - angle).abs() <= 6.0 * dt + 1e-12);
            if matches!(asked, ServoGoal::Position { .. }) {
                prop_assert!(goal.angle <= f64::max(4.5, angle - 6.0 * dt) + 1e-12, "only back within its limits");
            }
        }
    }
}
