//! The interface between the bridge and an arm's controller.

use hand_model::ArmVector;
use hand_model::robot::ArmState;

use crate::safety::checks::ArmReading;
use crate::safety::state::ArmTrouble;

/// The arm does not answer or refuses; `text` is its own or its client's message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("arm: {text}")]
pub struct ArmLinkError {
    pub trouble: ArmTrouble,
    pub text: String,
}

impl ArmLinkError {
    /// Creates the error for a set-point sent to an arm that is not engaged.
    pub fn unready() -> Self {
        Self { trouble: ArmTrouble::Refused, text: "found a set-point, expected engage() first".to_owned() }
    }
}

/// An arm's controller. It is called once per servo cycle and must not block for more than a fraction of one.
pub trait ArmLink: Send {
    /// Reads the newest feedback. `now` is the time since the bridge's start, s; the reading's time is on that clock.
    fn read(&mut self, now: f64) -> Result<ArmReading, ArmLinkError>;

    /// Prepares to follow set-points, starting at the measured position. Called when the robot is armed.
    fn engage(&mut self) -> Result<(), ArmLinkError>;

    /// Sends new joint set-points, rad, within limits.
    fn command(&mut self, set_points: &[f64]) -> Result<(), ArmLinkError>;

    /// Stops the arm at its position and leaves set-point mode.
    fn disengage(&mut self) -> Result<(), ArmLinkError>;

    /// True if the readings hold measured torques.
    fn senses_torque(&self) -> bool {
        true
    }
}

/// A substitute for an arm: each set-point is the measurement of the next call.
#[derive(Debug, Clone)]
pub struct LoopbackArm {
    position: ArmVector,
    engaged: bool,
}

impl LoopbackArm {
    /// Creates an arm in this posture, rad.
    pub fn at(position: ArmVector) -> Self {
        Self { position, engaged: false }
    }
}

impl ArmLink for LoopbackArm {
    fn read(&mut self, now: f64) -> Result<ArmReading, ArmLinkError> {
        let state = ArmState::at_rest(self.position);
        Ok(ArmReading { received_at: now, state, fault: None })
    }

    fn engage(&mut self) -> Result<(), ArmLinkError> {
        self.engaged = true;
        Ok(())
    }

    fn command(&mut self, set_points: &[f64]) -> Result<(), ArmLinkError> {
        if !self.engaged {
            return Err(ArmLinkError::unready());
        }
        self.position = set_points.iter().copied().collect();
        Ok(())
    }

    fn disengage(&mut self) -> Result<(), ArmLinkError> {
        self.engaged = false;
        Ok(())
    }

    fn senses_torque(&self) -> bool {
        false
    }
}
