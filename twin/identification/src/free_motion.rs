//! Pieces of a session in which one actuator winds under current while nothing but its own digit is in its way.

use hand_model::robot::{Observation, ServoGoal};
use hand_model::{ArmVector, GRAVITY, RobotModel};
use nalgebra::{Isometry3, Vector3};

use crate::row::Row;
use crate::trace::Trace;

/// A motion of one actuator and what led to it, tick by tick.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeMotion {
    /// Index of the actuator.
    pub actuator: usize,
    /// Length of a tick, s.
    pub tick: f64,
    /// So many ticks lead to it, in which the hand opens and the arm comes.
    pub lead_in: usize,
    /// What the servo was sent.
    pub goals: Vec<ServoGoal>,
    /// What its encoder showed before each tick, rad.
    pub angles: Vec<f64>,
    /// Angle of the opposition servo, rad.
    pub opposition: Vec<f64>,
    /// What the arm's encoders showed, rad.
    pub arm: Vec<ArmVector>,
    /// Gravity along the palm's axes, m/s2.
    pub gravity: Vec<Vector3<f64>>,
}

/// Shortest motion, in ticks.
const SHORTEST: usize = 60;
/// Longest lead-in, s.
const LEAD_IN: f64 = 6.0;

/// All motions of `actuator` in a session, by the arm and the hand as they are believed to be.
pub fn free_motions(trace: &Trace, actuator: usize, robot: &RobotModel) -> Vec<FreeMotion> {
    let under_current = |row: &&Row| matches!(row.goals[actuator], ServoGoal::Current(_));
    let longest = (LEAD_IN / trace.tick) as usize;
    let rows = &trace.rows;
    let (mut motions, mut free) = (Vec::new(), 0);
    while free < rows.len() {
        let begin = free + rows[free..].iter().take_while(|row| !under_current(row)).count();
        let end = begin + rows[begin..].iter().take_while(under_current).count();
        if end - begin >= SHORTEST {
            let led = free.max(begin.saturating_sub(longest));
            motions.push(FreeMotion::of(&rows[led..end], begin - led, actuator, trace.tick, robot));
        }
        free = end;
    }
    motions
}

impl FreeMotion {
    fn of(rows: &[Row], lead_in: usize, actuator: usize, tick: f64, robot: &RobotModel) -> Self {
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

    /// What the encoder showed before each tick of the motion itself, rad.
    pub fn measured(&self) -> &[f64] {
        &self.angles[self.lead_in..]
    }

    /// The same motion, of another `hand` on another `arm`: gravity pulls from elsewhere.
    #[must_use]
    pub fn under(&self, robot: &RobotModel) -> Self {
        Self { gravity: self.arm.iter().map(|shown| gravity(robot, shown)).collect(), ..self.clone() }
    }

    /// Appends what was observed before a tick, and what the servo was sent in it, by `hand` and `arm` as they are believed to be.
    pub fn push(&mut self, observation: &Observation, goal: ServoGoal, robot: &RobotModel) {
        self.goals.push(goal);
        self.angles.push(observation.servos[self.actuator].position);
        self.opposition.push(observation.servos[5].position);
        self.arm.push(observation.arm.position);
        self.gravity.push(gravity(robot, &observation.arm.position));
    }
}

/// Gravity along the palm's axes of an arm whose encoders show `shown`, m/s2; its base stands upright.
fn gravity(robot: &RobotModel, shown: &[f64]) -> Vector3<f64> {
    let RobotModel { hand, arm, .. } = robot;
    let palm: Isometry3<f64> = arm.tool_pose(shown) * hand.palm_from_flange.inverse();
    palm.rotation.inverse() * Vector3::new(0.0, 0.0, -GRAVITY)
}
