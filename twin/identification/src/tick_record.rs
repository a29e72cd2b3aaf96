//! Ticks of a session.

use hand_model::robot::{ArmState, ServoGoal, ServoState};
use hand_model::{ActuatorVector, ArmVector};

use crate::payload::Payload;

/// One tick: the values measured at its start, and the goals sent then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickRecord {
    /// Time, s.
    pub time: f64,
    pub servos: ActuatorVector<ServoState>,
    pub arm: ArmState,
    pub goals: ActuatorVector<ServoGoal>,
}

/// Payload of a session, and the ticks of payload calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct PayloadRow {
    pub payload: Payload,
    /// Ready posture of the arm, to which the script's postures are relative, rad.
    pub ready: ArmVector,
    /// Ticks from the time at which the arm first stood in one of the postures.
    pub rows: Vec<TickRecord>,
}
