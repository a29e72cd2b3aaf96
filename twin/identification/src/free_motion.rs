//! Free motions: pieces of a session in which one actuator winds under current control against its own digit only.

use hand_model::robot::{Observation, ServoGoal};
use hand_model::{ArmVector, GRAVITY, RobotModel};
use nalgebra::{Isometry3, Vector3};

use crate::tick_record::TickRecord;
use crate::trace::Trace;

/// Motion of one actuator and its lead-in, tick by tick.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeMotion {
    /// Index of the actuator.
    pub actuator: usize,
    /// Length of a tick, s.
    pub tick: f64,
    /// Number of ticks of the lead-in, in which the hand opens and the arm moves into place.
    pub lead_in: usize,
    /// Goals sent to the servo.
    pub goals: Vec<ServoGoal>,
    /// Encoder angle of the servo before each tick, rad.
    pub angles: Vec<f64>,
    /// Angle of the opposition servo, rad.
    pub opposition: Vec<f64>,
    /// Joint angles measured by the arm's encoders, rad.
    pub arm: Vec<ArmVector>,
    /// Gravity along the palm's axes, m/s2.
    pub gravity: Vec<Vector3<f64>>,
}

/// Minimum length of a motion, ticks.
const MIN_MOTION_TICKS: usize = 60;
/// Maximum length of a lead-in, s.
const MAX_LEAD_IN: f64 = 6.0;

/// Returns all motions of `actuator` in a session, with gravity according to the model `robot`.
pub fn free_motions(trace: &Trace, actuator: usize, robot: &RobotModel) -> Vec<FreeMotion> {
    let under_current = |row: &&TickRecord| matches!(row.goals[actuator], ServoGoal::Current(_));
    let longest = (MAX_LEAD_IN / trace.tick) as usize;
    let rows = &trace.rows;
    let (mut motions, mut free) = (Vec::new(), 0);
    while free < rows.len() {
        let begin = free + rows[free..].iter().take_while(|row| !under_current(row)).count();
        let end = begin + rows[begin..].iter().take_while(under_current).count();
        if end - begin >= MIN_MOTION_TICKS {
            let led = free.max(begin.saturating_sub(longest));
            motions.push(FreeMotion::from_rows(&rows[led..end], begin - led, actuator, trace.tick, robot));
        }
        free = end;
    }
    motions
}

impl FreeMotion {
    fn from_rows(rows: &[TickRecord], lead_in: usize, actuator: usize, tick: f64, robot: &RobotModel) -> Self {
        Self {
            actuator,
            tick,
            lead_in,
            goals: rows.iter().map(|row| row.goals[actuator]).collect(),
            angles: rows.iter().map(|row| row.servos[actuator].position).collect(),
            opposition: rows.iter().map(|row| row.servos[5].position).collect(),
            arm: rows.iter().map(|row| row.arm.position).collect(),
            gravity: rows.iter().map(|row| gravity(robot, &row.arm.position)).collect(),
        }
    }

    /// Returns the encoder angles before each tick of the motion proper, rad.
    pub fn measured(&self) -> &[f64] {
        &self.angles[self.lead_in..]
    }

    /// Returns the same motion with gravity according to another `robot`.
    #[must_use]
    pub fn with_robot(&self, robot: &RobotModel) -> Self {
        Self { gravity: self.arm.iter().map(|shown| gravity(robot, shown)).collect(), ..self.clone() }
    }

    /// Appends the observation before a tick and the goal sent in it, with gravity according to the model `robot`.
    pub fn push(&mut self, observation: &Observation, goal: ServoGoal, robot: &RobotModel) {
        self.goals.push(goal);
        self.angles.push(observation.servos[self.actuator].position);
        self.opposition.push(observation.servos[5].position);
        self.arm.push(observation.arm.position);
        self.gravity.push(gravity(robot, &observation.arm.position));
    }
}

/// Returns gravity along the palm's axes for an arm with encoder angles `shown`, m/s2. The base is upright.
fn gravity(robot: &RobotModel, shown: &[f64]) -> Vector3<f64> {
    let RobotModel { hand, arm, .. } = robot;
    let palm: Isometry3<f64> = arm.tool_pose(shown) * hand.palm_from_flange.inverse();
    palm.rotation.inverse() * Vector3::new(0.0, 0.0, -GRAVITY)
}
