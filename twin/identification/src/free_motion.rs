//! Pieces of a session in which one actuator winds under current while nothing but its own digit is in its way.

use hand_model::robot::{Observation, ServoGoal};
use hand_model::{ARM_JOINTS, Arm, GRAVITY, Hand};
use nalgebra::{Isometry3, Vector3};

use crate::trace::{Row, Trace};

/// A motion of one actuator, tick by tick.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeMotion {
    /// Index of the actuator.
    pub actuator: usize,
    /// Length of a tick, s.
    pub tick: f64,
    /// What the servo was sent, A.
    pub currents: Vec<f64>,
    /// What its encoder showed before each tick, rad.
    pub angles: Vec<f64>,
    /// Angle of the opposition servo, rad.
    pub opposition: Vec<f64>,
    /// What the arm's encoders showed, rad.
    pub arm: Vec<[f64; ARM_JOINTS]>,
    /// Gravity along the palm's axes, m/s2.
    pub gravity: Vec<Vector3<f64>>,
}

/// Shortest motion, in ticks.
const SHORTEST: usize = 60;

/// All motions of `actuator` in a session, by the arm and the hand as they are believed to be.
pub fn free_motions(trace: &Trace, actuator: usize, hand: &Hand, arm: &Arm) -> Vec<FreeMotion> {
    let under_current = |row: &&Row| matches!(row.goals[actuator], ServoGoal::Current(_));
    let mut motions = Vec::new();
    let mut rows = trace.rows.iter().peekable();
    while rows.peek().is_some() {
        while rows.next_if(|row| !under_current(row)).is_some() {}
        let own: Vec<&Row> = std::iter::from_fn(|| rows.next_if(under_current)).collect();
        if own.len() >= SHORTEST {
            motions.push(FreeMotion::of(&own, actuator, trace.tick, hand, arm));
        }
    }
    motions
}

impl FreeMotion {
    fn of(rows: &[&Row], actuator: usize, tick: f64, hand: &Hand, arm: &Arm) -> Self {
        let current = |row: &&Row| match row.goals[actuator] {
            ServoGoal::Current(current) => current,
            ServoGoal::Position { .. } => 0.0,
        };
        Self {
            actuator,
            tick,
            currents: rows.iter().map(current).collect(),
            angles: rows.iter().map(|row| row.servos[actuator].position).collect(),
            opposition: rows.iter().map(|row| row.servos[5].position).collect(),
            arm: rows.iter().map(|row| row.arm).collect(),
            gravity: rows.iter().map(|row| gravity(hand, arm, &row.arm)).collect(),
        }
    }

    /// The same motion, of another `hand` on another `arm`: gravity pulls from elsewhere.
    #[must_use]
    pub fn under(&self, hand: &Hand, arm: &Arm) -> Self {
        Self { gravity: self.arm.iter().map(|shown| gravity(hand, arm, shown)).collect(), ..self.clone() }
    }

    /// Appends what was observed before a tick, and the current sent in it (A), by `hand` and `arm` as they are believed to be.
    pub fn push(&mut self, observation: &Observation, current: f64, hand: &Hand, arm: &Arm) {
        self.currents.push(current);
        self.angles.push(observation.servos[self.actuator].position);
        self.opposition.push(observation.servos[5].position);
        self.arm.push(observation.arm.position);
        self.gravity.push(gravity(hand, arm, &observation.arm.position));
    }
}

/// Gravity along the palm's axes of an arm whose encoders show `shown`, m/s2; its base stands upright.
fn gravity(hand: &Hand, arm: &Arm, shown: &[f64; ARM_JOINTS]) -> Vector3<f64> {
    let palm: Isometry3<f64> = arm.tool_pose(shown) * hand.palm_from_flange.inverse();
    palm.rotation.inverse() * Vector3::new(0.0, 0.0, -GRAVITY)
}
