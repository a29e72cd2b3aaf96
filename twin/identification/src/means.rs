//! Robot, script and grasps that an excitation goes by.

use grasping::Grasp;
use hand_model::transmission::friction::CableFriction;
use hand_model::{ArmVector, RobotModel};
use touch::PhotometricCalibration;

use crate::script::Script;

/// Robot, script and grasps of an excitation.
#[derive(Debug, Clone, Copy)]
pub struct Means<'a> {
    pub robot: &'a RobotModel,
    /// With which the pads are read while they are pressed: that of the drawing's, as long as there is no other.
    pub pads: &'a PhotometricCalibration,
    pub script: &'a Script,
    /// Of the weighed object, best first.
    pub grasps: &'a [Grasp],
    /// What guides take as drawn: servos pull that much harder.
    pub friction: CableFriction,
    /// Posture that the script's turn from, rad.
    pub ready: ArmVector,
}
