//! `[limits]`: limits that the supervisor enforces, with defaults for everything.

use hand_model::{Arm, ArmVector, RobotModel};
use kinova_kortex::joints::JOINTS;
use serde::{Deserialize, Serialize};

use crate::safety::limits::{ArmLimits, SafetyLimits, ServoLimits, USUAL_FOLLOWING, USUAL_LAG, WatchdogTimeouts};
use crate::safety::set_points::MotionLimits;
use crate::safety::torque_monitor::TorqueLimits;
use crate::safety::workspace::WorkspaceLimits;
use crate::supported_robot::SUPPORTED_ARM;

/// Greatest torque that a limit of a joint may have, N m, unless the arm's own drives have more.
const MAX_TORQUE: f64 = 60.0;

/// Returns the current that the weakest servo of a robot takes, A.
pub(super) fn least_current_limit(robot: &RobotModel) -> f64 {
    robot.hand.servos.iter().map(|servo| servo.current_limit).fold(f64::INFINITY, f64::min)
}

/// Limits of the robot; those of the servos are the same for every servo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitConfig {
    /// Maximum speed of a servo's goal, rad/s.
    pub speed: f64,
    /// Maximum goal current, A.
    pub current: f64,
    /// Maximum current while holding, A.
    pub hold_current: f64,
    /// Maximum temperature of a servo, degrees Celsius.
    pub temperature: f64,
    /// Range of the supply voltage (least, greatest), V.
    pub voltage: [f64; 2],
    /// Maximum age of a servo measurement, s.
    pub staleness: f64,
    /// Time limit of the servos' own bus watchdog, s, in steps of 0.02.
    pub servo_watchdog: f64,
    /// Longest silence of the arm, s.
    pub arm_watchdog: f64,
    /// Longest silence of the controller, s, while it moves the robot.
    pub host_watchdog: f64,
    /// Longest silence that the controller may announce, to compute, s.
    pub pause: f64,
    /// Duration of a release, over which the current fades, s.
    pub release_time: f64,
    pub arm: ArmLimitConfig,
    pub space: WorkspaceConfig,
}

/// Limits on the arm's motion and joint torques.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmLimitConfig {
    /// Maximum acceleration of each joint's set-point, rad/s2.
    pub acceleration: ArmVector,
    /// Maximum jerk of each joint's set-point, rad/s3.
    pub jerk: ArmVector,
    /// Maximum torque of each joint, N m.
    pub torque: ArmVector,
    /// Maximum residual of each joint, N m: torque that weight, motion and payload leave unexplained.
    pub residual: ArmVector,
    /// Heaviest load in the hand, kg.
    pub payload: f64,
    /// Longest time for which a residual may be above its limit, s.
    pub jolt: f64,
    /// Longest time for which a torque may be above its limit, s.
    pub torque_time: f64,
    /// Greatest distance of a joint from its set-points of the last moments, rad.
    pub following: f64,
    /// Time for which these set-points are remembered, s: more than the arm's lag.
    pub lag: f64,
}

/// Workspace limits of arm and hand, in the frame of the arm's base, m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorkspaceConfig {
    /// Height of the table.
    pub table: f64,
    /// Tolerance: depth below the table to which set-points may send a part.
    pub tolerance: f64,
    /// Least x, y and z of every part from the elbow on; `high` has the greatest.
    pub low: [f64; 3],
    pub high: [f64; 3],
    /// Least distance between parts of the robot.
    pub clearance: f64,
}

impl Default for LimitConfig {
    fn default() -> Self {
        Self {
            speed: 6.0,
            current: 0.6,
            hold_current: 0.4,
            temperature: 60.0,
            voltage: [9.0, 12.6],
            staleness: 0.05,
            servo_watchdog: 0.1,
            arm_watchdog: 0.1,
            host_watchdog: 0.3,
            pause: 5.0,
            release_time: 1.0,
            arm: ArmLimitConfig::default(),
            space: WorkspaceConfig::default(),
        }
    }
}

impl ArmLimitConfig {
    /// Returns the limits that have a number for each joint, by name.
    fn joint_limits(&self) -> [(String, ArmVector); 4] {
        let own = self;
        [("acceleration", own.acceleration), ("jerk", own.jerk), ("torque", own.torque), ("residual", own.residual)]
            .map(|(name, values)| (format!("limits.arm.{name}"), values))
    }
}

impl Default for ArmLimitConfig {
    fn default() -> Self {
        Self {
            acceleration: [9.0; JOINTS].into(),
            jerk: [2100.0; JOINTS].into(),
            torque: [37.0, 37.0, 37.0, 37.0, 8.5, 8.5, 8.5].into(),
            residual: [18.0, 40.0, 30.0, 14.0, 10.0, 12.0, 6.0].into(),
            payload: 4.0,
            jolt: 0.03,
            torque_time: 2.0,
            following: USUAL_FOLLOWING,
            lag: USUAL_LAG,
        }
    }
}

impl Default for WorkspaceConfig {
    fn default() -> Self {
        Self { table: 0.0, tolerance: 0.04, low: [-0.6, -1.1, -0.1], high: [1.15, 1.1, 1.5], clearance: 0.0 }
    }
}

impl LimitConfig {
    /// Returns all limits, for servos with this travel (rad) and for this arm.
    pub fn limits(&self, travel: &[f64], arm: &Arm) -> SafetyLimits {
        let own = self;
        let motion = arm.each(|joint| MotionLimits {
            speed: arm.velocity_limits[joint],
            acceleration: own.arm.acceleration[joint],
            jerk: own.arm.jerk[joint],
        });
        let servos = travel.iter().map(|&travel| ServoLimits {
            angle: (0.0, travel),
            speed: own.speed,
            current: own.current,
            hold_current: own.hold_current,
            temperature: own.temperature,
        });
        SafetyLimits {
            servos: servos.collect(),
            arm: ArmLimits {
                motion: Some(motion),
                following: own.arm.following,
                lag: own.arm.lag,
                ..ArmLimits::from_model(arm)
            },
            voltage: (own.voltage[0], own.voltage[1]),
            staleness: own.staleness,
            watchdogs: WatchdogTimeouts {
                servo_bus: own.servo_watchdog,
                arm: own.arm_watchdog,
                host: own.host_watchdog,
            },
            release_time: own.release_time,
            torque: Some(TorqueLimits {
                torque: own.arm.torque,
                residual: own.arm.residual,
                payload: own.arm.payload,
                jolt_time: own.arm.jolt,
                torque_time: own.arm.torque_time,
            }),
            workspace: Some(WorkspaceLimits {
                table: own.space.table,
                tolerance: own.space.tolerance,
                low: own.space.low,
                high: own.space.high,
                clearance: own.space.clearance,
            }),
        }
    }

    /// Returns the limits for a robot of this model: the usual ones, with the torques of a Gen3, and no more current than
    /// the weakest servo takes. Another arm is stopped only where it presses harder than its drives can.
    pub fn for_robot(robot: &RobotModel) -> Self {
        let arm = &robot.arm;
        let current = Self::default().current.min(least_current_limit(robot));
        let hold_current = Self::default().hold_current.min(current);
        let own = Self { current, hold_current, ..Self::default() };
        if arm.name == SUPPORTED_ARM {
            return own;
        }
        let usual = ArmLimitConfig::default();
        let arm = ArmLimitConfig {
            acceleration: arm.acceleration_limits,
            jerk: arm.each(|joint| usual.jerk[joint]),
            torque: arm.effort_limits,
            residual: arm.effort_limits,
            ..usual
        };
        Self { arm, ..own }
    }

    /// Returns the first number that is not permitted (name, found, expected), for an arm whose joints have these greatest
    /// efforts (N m), servo cycles at `rate` (Hz), and servos that take up to `max_current` (A).
    pub(super) fn first_error(&self, efforts: &[f64], rate: f64, max_current: f64) -> Option<(String, String, String)> {
        for (name, values) in self.arm.joint_limits() {
            if values.len() != efforts.len() {
                let expected = format!("{}, one for each joint of the arm", efforts.len());
                return Some((name, format!("{} numbers", values.len()), expected));
            }
        }
        let outside = |(_, value, low, high): &(String, f64, f64, f64)| !(low..=high).contains(&value);
        let (name, value, low, high) = self.ranges(efforts, rate, max_current).into_iter().find(outside)?;
        Some((name, value.to_string(), format!("{low} to {high}")))
    }

    /// Returns every number with its name and permitted range (name, value, least, greatest).
    fn ranges(&self, efforts: &[f64], rate: f64, max_current: f64) -> Vec<(String, f64, f64, f64)> {
        let own = self;
        let single = [
            ("speed", own.speed, 0.1, 10.0),
            ("current", own.current, 0.01, max_current),
            ("hold_current", own.hold_current, 0.0, own.current),
            ("temperature", own.temperature, 30.0, 70.0),
            ("voltage[0]", own.voltage[0], 5.5, own.voltage[1]),
            ("voltage[1]", own.voltage[1], own.voltage[0], 14.0),
            ("staleness", own.staleness, 2.0 / rate, 1.0),
            ("servo_watchdog", own.servo_watchdog, 0.04_f64.max(2.0 / rate), 2.54),
            ("arm_watchdog", own.arm_watchdog, 0.01, 1.0),
            ("host_watchdog", own.host_watchdog, 0.02, 10.0),
            ("pause", own.pause, own.host_watchdog, 60.0),
            ("release_time", own.release_time, 0.1, 10.0),
            ("arm.payload", own.arm.payload, 0.0, 10.0),
            ("arm.jolt", own.arm.jolt, 0.0, 1.0),
            ("arm.torque_time", own.arm.torque_time, 0.0, 10.0),
            ("arm.following", own.arm.following, 0.01, 1.0),
            ("arm.lag", own.arm.lag, 0.0, 2.0),
            ("space.table", own.space.table, -1.0, 1.0),
            ("space.tolerance", own.space.tolerance, 0.0, 0.2),
            ("space.clearance", own.space.clearance, -0.01, 0.2),
        ];
        let single = single.into_iter().map(|(name, value, low, high)| (format!("limits.{name}"), value, low, high));
        let most = efforts.iter().fold(MAX_TORQUE, |most, effort| effort.max(most));
        let bounds = [(0.1, 1000.0), (1.0, 1e6), (0.1, most), (0.1, most)];
        let joints = own.arm.joint_limits().into_iter().zip(bounds).flat_map(|((name, values), (low, high))| {
            values.into_iter().enumerate().map(move |(n, value)| (format!("{name}[{n}]"), value, low, high))
        });
        let sides = (0..3).flat_map(|axis| {
            let (low, high) = (own.space.low[axis], own.space.high[axis]);
            [("low", low, -5.0, high), ("high", high, low, 5.0)]
                .map(|(name, value, least, most)| (format!("limits.space.{name}[{axis}]"), value, least, most))
        });
        single.chain(joints).chain(sides).collect()
    }
}
