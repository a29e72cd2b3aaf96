//! Ticks of a session.

use hand_model::robot::{ArmState, ServoGoal, ServoState};
use hand_model::{ActuatorVector, ArmVector};

use crate::weight::Weight;

/// A tick: what was measured at its beginning, and what was sent then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// s.
    pub time: f64,
    pub servos: ActuatorVector<ServoState>,
    pub arm: ArmState,
    pub goals: ActuatorVector<ServoGoal>,
}

/// The weighed object of a session, and the ticks of weighing.
#[derive(Debug, Clone, PartialEq)]
pub struct Weighed {
    pub weight: Weight,
    /// Posture that the script's turn from, rad.
    pub ready: ArmVector,
    /// From when the arm first stood in one of the postures.
    pub rows: Vec<Row>,
}
