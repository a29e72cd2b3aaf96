//! Readings and commands of a robot as messages.

use std::time::Duration;

use hand_model::RobotModel;
use hand_model::kinematics::Tree;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{ArmState, Reading, RobotCommand, ServoGoal, ServoState, TactileFrame};

use crate::cdr::CdrError;
use crate::message::Header;
use crate::sensor::{Image, JointState};

/// Bytes of a tactile image.
const IMAGE_BYTES: usize = IMAGE_SIZE * IMAGE_SIZE * 3;

/// Names of joints, actuators and cameras, and the servos' torque constant.
///
/// ```
/// use robot_ros2_messages::robot::RobotNames;
///
/// let names = RobotNames {
///     arm: (1..=6).map(|joint| format!("joint_{joint}")).collect(),
///     servos: vec!["left_finger".to_owned(), "right_finger".to_owned()],
///     cameras: vec!["left_digit".to_owned(), "right_digit".to_owned()],
///     torque_constant: 1.0,
/// };
/// assert_eq!(names.camera(1), "right_digit");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RobotNames {
    /// Names of the arm's joints, from the base outwards.
    pub arm: Vec<String>,
    /// Names of the actuators, in their order.
    pub servos: Vec<String>,
    /// Names of the cameras, by index.
    pub cameras: Vec<String>,
    /// Torque constant of a servo: output torque per input current, N m/A.
    pub torque_constant: f64,
}

impl RobotNames {
    /// Returns the names in a robot's model.
    pub fn from_model(robot: &RobotModel) -> Self {
        let RobotModel { arm, hand, .. } = robot;
        let joints = |tree: &Tree| tree.joints.iter().map(|joint| joint.name.clone()).collect();
        Self {
            arm: joints(&arm.tree),
            servos: hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect(),
            cameras: hand.cameras.iter().map(|camera| camera.name.clone()).collect(),
            torque_constant: hand.parameters.servo.torque_constant,
        }
    }

    /// Returns the name of a camera, `camera_<n>` for one without a name.
    pub fn camera(&self, camera: usize) -> String {
        self.cameras.get(camera).cloned().unwrap_or_else(|| format!("camera_{camera}"))
    }

    /// Returns the measurement of the arm: angles (rad), speeds (rad/s) and torques (N m).
    pub fn arm_state(&self, at: Duration, arm: &ArmState) -> JointState {
        joint_state(at, &self.arm, &arm.position, &arm.velocity, &arm.torque)
    }

    /// Returns the measurements of the servos: angles (rad) and speeds (rad/s) of the horns, and torques (N m) from the
    /// input currents; NaN, which stands for an unknown value in ROS, for a servo that was not read.
    pub fn servo_states(&self, at: Duration, servos: &[Option<Reading<ServoState>>]) -> JointState {
        let of = |value: fn(&ServoState) -> f64| {
            let values = servos.iter().map(|servo| servo.map_or(f64::NAN, |servo| value(&servo.value)));
            values.collect::<Vec<f64>>()
        };
        let torque: Vec<f64> = of(|servo| servo.current).iter().map(|current| current * self.torque_constant).collect();
        joint_state(at, &self.servos, &of(|servo| servo.position), &of(|servo| servo.velocity), &torque)
    }

    /// Returns the set-points of the arm, rad.
    pub fn arm_command(&self, at: Duration, command: &RobotCommand) -> JointState {
        joint_state(at, &self.arm, &command.arm, &[], &[])
    }

    /// Returns the goals of the servos: angles (rad), NaN for a servo in current mode, and torques (N m) from the goal
    /// current or the current limit.
    pub fn servo_command(&self, at: Duration, command: &RobotCommand) -> JointState {
        let angle = |goal: &ServoGoal| match *goal {
            ServoGoal::Position { angle, .. } => angle,
            ServoGoal::Current(_) => f64::NAN,
        };
        let current = |goal: &ServoGoal| match *goal {
            ServoGoal::Position { current_limit, .. } => current_limit,
            ServoGoal::Current(current) => current,
        };
        let torque: Vec<f64> = command.servos.iter().map(|goal| current(goal) * self.torque_constant).collect();
        let angles: Vec<f64> = command.servos.iter().map(angle).collect();
        joint_state(at, &self.servos, &angles, &[], &torque)
    }
}

/// Returns a tactile image, in the frame `frame_id`.
///
/// # Errors
/// [`CdrError::Field`] for an image of another size than [`IMAGE_SIZE`] squared.
pub fn tactile_image(at: Duration, frame_id: &str, frame: &TactileFrame) -> Result<Image, CdrError> {
    let rgb = &frame.image.rgb;
    if rgb.len() != IMAGE_BYTES {
        let (found, expected) = (format!("{} bytes", rgb.len()), format!("{IMAGE_BYTES} bytes"));
        return Err(CdrError::Field { field: "data", found, expected });
    }
    Ok(Image::rgb(Header::new(at, frame_id), IMAGE_SIZE as u32, rgb.clone()))
}

fn joint_state(at: Duration, names: &[String], position: &[f64], velocity: &[f64], effort: &[f64]) -> JointState {
    let (position, velocity, effort) = (position.to_vec(), velocity.to_vec(), effort.to_vec());
    JointState { header: Header::new(at, ""), name: names.to_vec(), position, velocity, effort }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hand_model::robot::TactileImage;

    use super::*;

    /// An unread servo is no servo at 0 rad, and a goal current no goal angle.
    #[test]
    fn unknown_values_are_nan() {
        let names = RobotNames::from_model(&RobotModel::ftac_gen3());
        let servo = ServoState { position: 0.5, current: 2.0, ..ServoState::default() };
        let state = names.servo_states(Duration::ZERO, &[Some(Reading { value: servo, time: 0.0 }), None]);
        assert!(state.position[0] == 0.5 && state.position[1].is_nan() && state.effort[1].is_nan());
        assert_eq!(state.effort[0], 2.0 * names.torque_constant);
        let servos = [ServoGoal::Current(0.1), ServoGoal::Position { angle: 1.0, current_limit: 0.2 }];
        let goals = RobotCommand { servos: servos.into_iter().collect(), ..RobotCommand::default() };
        let command = names.servo_command(Duration::ZERO, &goals);
        assert!(command.position[0].is_nan() && command.position[1] == 1.0);
    }

    #[test]
    fn an_image_of_another_size_is_refused() {
        let image = Arc::new(TactileImage { rgb: vec![0; 12] });
        let frame = TactileFrame { camera: 0, time: 0.0, sequence: 0, image };
        let error = tactile_image(Duration::ZERO, "pad", &frame).expect_err("refused").to_string();
        assert_eq!(error, "data: found 12 bytes, expected 172800 bytes");
    }
}
