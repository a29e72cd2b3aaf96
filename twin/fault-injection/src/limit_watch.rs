//! Checks every goal that reaches the emulated devices against its limits.

use hand_model::Arm;
use hand_model::robot::{RobotBackend as _, ServoGoal};
use hardware_bridge::config::LimitConfig;
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::safety::limits::MAX_GOAL_OVERTRAVEL;
use kinova_kortex::servoing::ServoingLimits;

/// Checks every command that reaches the devices against the limits.
pub struct LimitWatch {
    travel: [f64; 6],
    limits: LimitConfig,
    arm: ServoingLimits,
    goals_before: Option<Vec<f64>>,
    /// Ticks since each goal last changed: a delayed write has had longer for its step.
    unchanged: [u32; 6],
    /// Number of goals checked against their limits.
    pub checked: u64,
    /// Number of goals outside their limits.
    pub outside_limits: u64,
}

impl LimitWatch {
    pub fn new(travel: [f64; 6], arm: &Arm) -> Self {
        let arm = hardware_bridge::kortex_link::limits(arm);
        Self {
            travel,
            limits: LimitConfig::default(),
            arm,
            goals_before: None,
            unchanged: [1; 6],
            checked: 0,
            outside_limits: 0,
        }
    }

    pub fn check(&mut self, robot: &mut LockstepRobot) {
        // Goals are rounded to the servo's units.
        let (count, milliampere) = (std::f64::consts::TAU / 4096.0, 1e-3);
        let reach = self.limits.speed * robot.tick_length() + 2.0 * count;
        let held = robot.devices().watchdogs_tripped() > 0;
        let drives = robot.devices().applied_goals();
        let angles: Vec<f64> = drives
            .iter()
            .map(|drive| match drive {
                ServoGoal::Position { angle, .. } => *angle,
                ServoGoal::Current(_) => f64::NAN,
            })
            .collect();
        for (n, drive) in drives.iter().enumerate() {
            let (angle, current) = match *drive {
                ServoGoal::Position { angle, current_limit } => (angle, current_limit),
                ServoGoal::Current(current) => (0.0, current),
            };
            let within = (-count..=self.travel[n] + MAX_GOAL_OVERTRAVEL + count).contains(&angle)
                && (0.0..=self.limits.current + milliampere).contains(&current);
            // A servo that was off, or that its watchdog stopped, starts from its present position.
            let step = self.goals_before.as_ref().map_or(0.0, |before| (angles[n] - before[n]).abs());
            let allowed = reach * f64::from(self.unchanged[n]);
            self.outside_limits += u64::from(!within || (step > allowed && !held));
            self.unchanged[n] = if step == 0.0 { self.unchanged[n] + 1 } else { 1 };
        }
        self.checked += (angles.len() + self.arm.step.len()) as u64;
        self.goals_before = Some(angles);
        let status = robot.arm().status();
        let steps = status.commands.largest_step;
        self.outside_limits += (0..self.arm.step.len()).filter(|i| steps[*i] > self.arm.step[*i] + 1e-6).count() as u64;
        let goal = robot.devices().arm_joints().goal();
        self.outside_limits += (0..self.arm.step.len())
            .filter(|i| !(self.arm.lower[*i] - 1e-6..=self.arm.upper[*i] + 1e-6).contains(&goal[*i]))
            .count() as u64;
    }
}
