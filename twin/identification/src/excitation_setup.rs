//! Inputs of an excitation: robot, script and grasps.

use dexterous_grasping::Grasp;
use hand_model::transmission::friction::CableFriction;
use hand_model::{ArmVector, RobotModel};
use tactile_perception::PhotometricCalibration;

use crate::script::ExcitationScript;

/// Robot, script and grasps of an excitation.
#[derive(Debug, Clone, Copy)]
pub struct ExcitationSetup<'a> {
    pub robot: &'a RobotModel,
    /// Calibration for images of pressed pads: that of the nominal pads, unless there is another.
    pub pads: &'a PhotometricCalibration,
    pub script: &'a ExcitationScript,
    /// Grasps of the payload, best first.
    pub grasps: &'a [Grasp],
    /// Nominal friction in the cable guides, which the servo forces compensate.
    pub friction: CableFriction,
    /// Ready posture of the arm, to which the script's postures are relative, rad.
    pub ready: ArmVector,
}
