//! Workcell in the controller's model: the robot, the pose of its base, and the posture at the start of a trial.

use hand_model::RobotModel;
use nalgebra::Isometry3;

use crate::inverse_kinematics::{ArmKinematics, ArmMount, ArmServo, IkError, IkSettings, Joints};

/// The robot and its nominal pose.
#[derive(Debug, Clone)]
pub struct Workcell {
    pub robot: RobotModel,
    /// Nominal pose of the arm's base.
    pub world_from_base: Isometry3<f64>,
    /// Arm posture at the start of a trial, rad.
    pub ready_posture: Joints,
}

impl Workcell {
    /// Kinematics of the nominal arm with the palm as the controlled frame.
    pub fn kinematics(&self) -> ArmKinematics {
        let tool_from_palm = self.robot.hand.palm_from_flange.inverse();
        let mount = ArmMount { world_from_base: self.world_from_base, tool_from_palm };
        ArmKinematics::new((*self.robot.arm).clone(), mount)
    }

    /// Finds an arm posture for a palm pose, searched from `seed`; `None` if the pose is out of reach.
    pub fn posture(&self, palm: &Isometry3<f64>, seed: &Joints) -> Option<Joints> {
        self.kinematics().solve(palm, seed)
    }

    /// True if the arm reaches a palm pose from the posture at the start of a trial.
    pub fn reaches(&self, palm: &Isometry3<f64>) -> bool {
        self.posture(palm, &self.ready_posture).is_some()
    }

    /// Arm servo at rest in a posture.
    pub fn arm_servo(&self, posture: Joints) -> Result<ArmServo, IkError> {
        ArmServo::new(self.kinematics(), IkSettings::default(), posture)
    }
}
