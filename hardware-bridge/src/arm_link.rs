//! What the bridge wants of an arm's controller.

use hand_model::ARM_JOINTS;
use hand_model::robot::ArmState;

use crate::safety::checks::ArmReading;

/// Why the arm does not answer or obey, in its client's words.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("arm: {0}")]
pub struct ArmLinkError(pub String);

/// An arm's controller. Called once a servo cycle, so no call may block longer than a fraction of one.
pub trait ArmLink: Send {
    /// The newest feedback; `now` is s since the bridge's start, and the reading's time is on that clock.
    fn read(&mut self, now: f64) -> Result<ArmReading, ArmLinkError>;

    /// Gets ready to follow set-points, starting from where the arm is. Called when the robot is armed.
    fn engage(&mut self) -> Result<(), ArmLinkError>;

    /// New joint set-points, rad, within limits.
    fn command(&mut self, set_points: &[f64; ARM_JOINTS]) -> Result<(), ArmLinkError>;

    /// Stops where it is and leaves the mode that follows set-points.
    fn disengage(&mut self) -> Result<(), ArmLinkError>;
}

/// No arm: what is asked is what is measured, one call later.
#[derive(Debug, Clone, Default)]
pub struct LoopbackArm {
    position: [f64; ARM_JOINTS],
    engaged: bool,
}

impl LoopbackArm {
    /// An arm in this posture, rad.
    pub fn at(position: [f64; ARM_JOINTS]) -> Self {
        Self { position, engaged: false }
    }
}

impl ArmLink for LoopbackArm {
    fn read(&mut self, now: f64) -> Result<ArmReading, ArmLinkError> {
        let state = ArmState { position: self.position, ..ArmState::default() };
        Ok(ArmReading { at: now, state, fault: false })
    }

    fn engage(&mut self) -> Result<(), ArmLinkError> {
        self.engaged = true;
        Ok(())
    }

    fn command(&mut self, set_points: &[f64; ARM_JOINTS]) -> Result<(), ArmLinkError> {
        if !self.engaged {
            return Err(ArmLinkError("found a set-point, expected engage() first".into()));
        }
        self.position = *set_points;
        Ok(())
    }

    fn disengage(&mut self) -> Result<(), ArmLinkError> {
        self.engaged = false;
        Ok(())
    }
}
