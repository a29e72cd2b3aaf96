//! The workcell as the control stack knows it: the robot, where its arm stands, and the posture in which a trial begins.

use hand_model::RobotModel;
use nalgebra::Isometry3;

use crate::inverse_kinematics::{ArmKinematics, ArmServo, IkError, IkSettings, Joints, Mount};

/// The robot and its nominal place.
#[derive(Debug, Clone)]
pub struct Workcell {
    pub robot: RobotModel,
    /// Where the arm stands, nominally.
    pub world_from_base: Isometry3<f64>,
    /// Posture a trial begins in, rad.
    pub ready: Joints,
}

impl Workcell {
    /// The nominal arm with the palm as the controlled frame.
    pub fn kinematics(&self) -> ArmKinematics {
        let tool_from_palm = self.robot.hand.palm_from_flange.inverse();
        let mount = Mount { world_from_base: self.world_from_base, tool_from_palm };
        ArmKinematics::new((*self.robot.arm).clone(), mount)
    }

    /// Arm posture for a palm pose, searched from `seed`; `None` if it is out of reach.
    pub fn posture(&self, palm: &Isometry3<f64>, seed: &Joints) -> Option<Joints> {
        self.kinematics().solve(palm, seed)
    }

    /// Whether the arm reaches a palm pose from the posture in which trials begin.
    pub fn reaches(&self, palm: &Isometry3<f64>) -> bool {
        self.posture(palm, &self.ready).is_some()
    }

    /// An arm servo at rest in a posture.
    pub fn arm_servo(&self, posture: Joints) -> Result<ArmServo, IkError> {
        ArmServo::new(self.kinematics(), IkSettings::default(), posture)
    }
}
