//! Sizes of a session's robot, and checks of messages against them.

use hand_model::arm::MAX_ARM_JOINTS;
use hand_model::hand::MAX_ACTUATORS;
use hand_model::{ActuatorVector, ArmVector, RobotModel};

/// An invalid field: its name, the value found, the value expected.
pub(crate) type InvalidField = (&'static str, String, String);

/// Sizes that messages must have.
///
/// ```
/// use hand_model::RobotModel;
/// use robot_session_log::RobotSizes;
///
/// let sizes = RobotSizes::from_robot(&RobotModel::ftac_gen3());
/// assert_eq!(sizes, RobotSizes::Of { cameras: 18, arm_joints: 7, servos: 6 });
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotSizes {
    /// A robot with these numbers of cameras (whose images all have one size), arm joints and servos.
    Of {
        /// Number of tactile cameras.
        cameras: usize,
        /// Number of the arm's joints.
        arm_joints: usize,
        /// Number of servos.
        servos: usize,
    },
    /// Any robot, with or without an arm; images are not checked.
    Any,
}

impl RobotSizes {
    /// Returns the sizes of `robot`.
    pub fn from_robot(robot: &RobotModel) -> Self {
        let (cameras, arm_joints) = (robot.hand.cameras.len(), robot.arm.joints());
        Self::Of { cameras, arm_joints, servos: robot.hand.servos.len() }
    }

    /// Returns the robot's number of servos, or `found` in a session of any robot.
    pub(crate) fn servos(self, found: usize) -> ServoCount {
        match self {
            Self::Of { servos, .. } => ServoCount(servos),
            Self::Any => ServoCount(found.min(MAX_ACTUATORS)),
        }
    }

    pub(crate) fn arm(self, field: &'static str, values: &[f64]) -> Result<ArmVector, InvalidField> {
        let (fits, expected) = match self {
            Self::Of { arm_joints, .. } => (values.len() == arm_joints, arm_joints.to_string()),
            Self::Any => (values.len() <= MAX_ARM_JOINTS, format!("0 to {MAX_ARM_JOINTS}")),
        };
        if !fits {
            return Err((field, format!("{} numbers", values.len()), format!("{expected} numbers")));
        }
        Ok(values.iter().copied().collect())
    }
}

/// Length of every list of servos in an observation or a command.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ServoCount(usize);

impl ServoCount {
    pub(crate) fn list<T: Copy + Default>(
        self,
        field: &'static str,
        values: &[T],
    ) -> Result<ActuatorVector<T>, InvalidField> {
        if values.len() != self.0 {
            return Err((field, format!("{} numbers", values.len()), format!("{} numbers", self.0)));
        }
        Ok(values.iter().copied().collect())
    }
}
