//! Limits of a command: range, speed and current.
//!
//! Speed is limited relative to the previous *command*, not to the measured state: with a measurement that lags, a
//! limited command could creep past its limit.

use hand_model::robot::ServoGoal;
use hand_model::{ActuatorVector, Arm, ArmVector};

use super::set_points::MotionLimits;
use super::torque_monitor::TorqueLimits;
use super::workspace::WorkspaceLimits;

/// Lead of the position goal ahead of the shaft under a pure current command, rad: enough to saturate the servo's
/// position control (P gain 900: full duty from 0.2 rad on), little enough to reverse quickly.
pub const GOAL_LEAD: f64 = 1.0;

/// Distance by which the goal of a pure current command may lie beyond the closed stop, rad. At the stop the shaft
/// cannot follow, and the cable must be pulled as hard as before it. A shaft that does follow has lost its cable, which
/// its angle shows ([`super::checks`]).
pub const MAX_GOAL_OVERTRAVEL: f64 = 0.5;

/// Usual tolerance of an arm's joint outside the range of its set-points, rad: 6 deg.
pub const USUAL_FOLLOWING: f64 = 0.1;
/// Usual time for which set-points are remembered, s.
pub const USUAL_LAG: f64 = 0.2;

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoLimits {
    /// Range of the output angle (least, greatest), rad.
    pub angle: (f64, f64),
    /// Maximum speed of the goal and, with a margin, of the shaft, rad/s.
    pub speed: f64,
    /// Maximum goal current, A.
    pub current: f64,
    /// Maximum current while holding, A.
    pub hold_current: f64,
    /// Maximum temperature, degrees Celsius.
    pub temperature: f64,
}

/// Limits of the arm's joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmLimits {
    /// Range of each joint's angle (least, greatest), rad; infinite for a joint that turns freely.
    pub angle: ArmVector<(f64, f64)>,
    /// Maximum speed of each set-point, rad/s.
    pub speed: ArmVector,
    /// Deceleration of each set-point when the arm is stopped, rad/s2.
    pub deceleration: ArmVector,
    /// Tolerance of a joint outside the range of its set-points of the last moments, rad.
    pub following: f64,
    /// Time for which these set-points are remembered, s: more than the arm's lag.
    pub lag: f64,
    /// Limits on acceleration and jerk of each set-point, if any.
    pub motion: Option<ArmVector<MotionLimits>>,
}

/// Time limits of the watchdogs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchdogTimeouts {
    /// Time limit of the servos' own bus watchdog, s.
    pub servo_bus: f64,
    /// Maximum age of a measurement of the arm, s.
    pub arm: f64,
    /// Maximum age of the controller's newest command, s.
    pub host: f64,
}

/// All limits that the supervisor enforces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyLimits {
    /// The servos, in actuator order.
    pub servos: ActuatorVector<ServoLimits>,
    pub arm: ArmLimits,
    /// Range of the supply voltage (least, greatest), V.
    pub voltage: (f64, f64),
    /// Maximum age of a servo measurement, s.
    pub staleness: f64,
    pub watchdogs: WatchdogTimeouts,
    /// Duration of a release, over which the current fades, s.
    pub release_time: f64,
    /// Limits on joint torques when the arm presses; `None` for an arm without torque sensors.
    pub torque: Option<TorqueLimits>,
    /// Workspace of arm and hand.
    pub workspace: Option<WorkspaceLimits>,
}

/// Goal of one servo in current-based position control.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SafeGoal {
    /// Goal of the output angle, rad.
    pub angle: f64,
    /// Current limit, A, not negative.
    pub current: f64,
}

impl ServoLimits {
    /// Limits the goal `asked`, `dt` (s) after `previous` was sent, with the shaft at `measured` (rad).
    ///
    /// A current command becomes a goal [`GOAL_LEAD`] ahead of the shaft in the requested direction under that current.
    /// One operating mode thus serves both kinds of command, and the angle limits apply to both, except for
    /// [`MAX_GOAL_OVERTRAVEL`].
    pub fn limit(&self, asked: &ServoGoal, measured: f64, previous: SafeGoal, dt: f64) -> SafeGoal {
        let (low, high) = self.angle;
        let (target, current, high) = match *asked {
            ServoGoal::Current(0.0) => (measured, 0.0, high + MAX_GOAL_OVERTRAVEL),
            ServoGoal::Current(current) => {
                (measured + GOAL_LEAD * current.signum(), current.abs(), high + MAX_GOAL_OVERTRAVEL)
            }
            ServoGoal::Position { angle, current_limit } => (angle, current_limit, high),
        };
        let reach = self.speed * dt;
        let reached = target.clamp(previous.angle - reach, previous.angle + reach);
        SafeGoal {
            // The way back from beyond the stop is limited in speed too.
            angle: reached.clamp(low, high.max(previous.angle - reach).max(low)),
            current: current.clamp(0.0, self.current),
        }
    }

    /// Returns `previous` with the current capped for holding.
    pub fn hold(&self, previous: SafeGoal) -> SafeGoal {
        SafeGoal { current: previous.current.min(self.hold_current), ..previous }
    }
}

impl ArmLimits {
    /// Returns the limits in the arm's model; a joint that turns freely has no range.
    pub fn from_model(arm: &Arm) -> Self {
        Self {
            angle: arm.each(|joint| (arm.tree.joints[joint].lower, arm.tree.joints[joint].upper)),
            speed: arm.velocity_limits,
            deceleration: arm.acceleration_limits,
            following: USUAL_FOLLOWING,
            lag: USUAL_LAG,
            motion: None,
        }
    }

    /// Returns zero speed for every joint.
    pub fn zero_speed(&self) -> ArmVector {
        self.speed.iter().map(|_| 0.0).collect()
    }

    /// Returns the angles, rad, at which an arm comes to rest when it is stopped while its set-points are at `at` (rad)
    /// and move at `speed` (rad/s).
    pub fn stopping_position(&self, at: &[f64], speed: &[f64]) -> ArmVector {
        let stand = |joint: usize| at[joint] + 0.5 * speed[joint] * speed[joint].abs() / self.deceleration[joint];
        (0..at.len()).map(stand).collect()
    }

    /// Limits speed and range of the set-points `asked`, `dt` (s) after `previous`.
    pub fn limit(&self, asked: &[f64], previous: &[f64], dt: f64) -> ArmVector {
        let limited = |joint: usize| {
            let reach = self.speed[joint] * dt;
            let (low, high) = self.angle[joint];
            asked[joint].clamp(previous[joint] - reach, previous[joint] + reach).clamp(low, high)
        };
        (0..asked.len()).map(limited).collect()
    }

    /// Brakes: returns the set-points `dt` (s) after `previous`, and the speeds that remain of `speed` (rad/s).
    ///
    /// A set-point that stops from one cycle to the next demands more torque than a joint has, so that the arm
    /// overshoots and swings back. The set-point therefore advances by `v dt`, with `v` reduced by the deceleration in
    /// each cycle.
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

    pub(crate) fn limits() -> SafetyLimits {
        let servo = ServoLimits { angle: (0.0, 4.5), speed: 6.0, current: 0.6, hold_current: 0.4, temperature: 60.0 };
        let arm = ArmLimits {
            angle: [(-2.0, 2.0); 7].into(),
            speed: [1.0; 7].into(),
            deceleration: [8.0; 7].into(),
            following: USUAL_FOLLOWING,
            lag: USUAL_LAG,
            motion: None,
        };
        SafetyLimits {
            servos: [servo; 6].into(),
            arm,
            voltage: (9.0, 12.5),
            staleness: 0.05,
            watchdogs: WatchdogTimeouts { servo_bus: 0.1, arm: 0.1, host: 0.5 },
            release_time: 1.0,
            torque: None,
            workspace: None,
        }
    }

    /// Winding: the goal leads the shaft by the lead and no further; opening starts from there, not from the end of the
    /// range.
    #[test]
    fn current_commands_lead_the_shaft() {
        let servo = limits().servos[0];
        let mut goal = SafeGoal::default();
        for _ in 0..1000 {
            goal = servo.limit(&ServoGoal::Current(0.2), 0.5, goal, 0.005);
        }
        assert_eq!(goal, SafeGoal { angle: 0.5 + GOAL_LEAD, current: 0.2 });
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

    /// From 0.8 rad/s with 8 rad/s2 an arm comes to rest after 0.1 s and v^2 / 2a = 40 mrad, without leaving its range.
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
            measured in -1.0..6.0_f64, angle in 0.0..=4.5 + MAX_GOAL_OVERTRAVEL, current in 0.0..=0.6_f64, dt in 0.0..0.05_f64,
        ) {
            prop_assume!(match asked {
                ServoGoal::Current(current) => current.is_finite(),
                ServoGoal::Position { angle, current_limit } => angle.is_finite() && current_limit.is_finite(),
            });
            let servo = limits().servos[0];
            let goal = servo.limit(&asked, measured, SafeGoal { angle, current }, dt);
            prop_assert!((0.0..=4.5 + MAX_GOAL_OVERTRAVEL).contains(&goal.angle) && (0.0..=0.6).contains(&goal.current));
            prop_assert!((goal.angle - angle).abs() <= 6.0 * dt + 1e-12);
            if matches!(asked, ServoGoal::Position { .. }) {
                prop_assert!(goal.angle <= f64::max(4.5, angle - 6.0 * dt) + 1e-12, "only back within its limits");
            }
        }
    }
}
