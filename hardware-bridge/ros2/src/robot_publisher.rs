//! The topics on which a robot publishes its measurements and commands.

use std::collections::BTreeMap;
use std::time::Duration;

use hand_model::RobotModel;
use hand_model::nalgebra::Isometry3;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{ArmState, Readings, RobotCommand, TactileFrame};
use hand_model::urdf::{CAMERA_DISTANCE, robot_urdf};
use robot_ros2_messages::robot::{RobotNames, tactile_image};
use robot_ros2_messages::{CameraInfo, Header, Image, JointState, Text, Transforms};

use crate::error::Ros2Error;
use crate::frames::{arm_frames, camera_frame, fixed_frames, hand_frames, hand_joint};
use crate::node::{Publisher, QosProfile, Ros2Node};

/// Topics of a robot in a domain: see the [page of the crate](crate#topics).
pub struct RobotPublisher {
    robot: RobotModel,
    names: RobotNames,
    joint_states: Publisher<JointState>,
    transforms: Publisher<Transforms>,
    fixed_transforms: Publisher<Transforms>,
    description: Publisher<Text>,
    servo_states: Publisher<JointState>,
    arm_commands: Publisher<JointState>,
    servo_commands: Publisher<JointState>,
    cameras: Vec<CameraTopics>,
    /// Sequence number of the image of each camera that was published last.
    published_images: BTreeMap<usize, u64>,
}

struct CameraTopics {
    frame: String,
    images: Publisher<Image>,
    info: Publisher<CameraInfo>,
}

impl RobotPublisher {
    /// Announces all topics, and publishes the robot's description and its fixed frames with the stamp `at` (since 1970).
    ///
    /// # Errors
    /// [`Ros2Error`] if the DDS library refuses, and for a camera whose name cannot be part of a topic.
    pub fn new(
        node: &Ros2Node,
        robot: &RobotModel,
        world_from_base: &Isometry3<f64>,
        at: Duration,
    ) -> Result<Self, Ros2Error> {
        let camera = |camera: &hand_model::pads::PadCamera| {
            let topic = |topic: &str| format!("/tactile/{}/{topic}", camera.name);
            Ok(CameraTopics {
                frame: camera_frame(&camera.name),
                images: node.publish(&topic("image_raw"), QosProfile::Reliable)?,
                info: node.publish(&topic("camera_info"), QosProfile::Reliable)?,
            })
        };
        let publisher = Self {
            names: RobotNames::from_model(robot),
            joint_states: node.publish("/joint_states", QosProfile::Reliable)?,
            transforms: node.publish("/tf", QosProfile::Reliable)?,
            fixed_transforms: node.publish("/tf_static", QosProfile::Latched)?,
            description: node.publish("/robot_description", QosProfile::Latched)?,
            servo_states: node.publish("/hand/servo_states", QosProfile::Reliable)?,
            arm_commands: node.publish("/arm/joint_commands", QosProfile::Reliable)?,
            servo_commands: node.publish("/hand/servo_commands", QosProfile::Reliable)?,
            cameras: robot.hand.cameras.iter().map(camera).collect::<Result<_, Ros2Error>>()?,
            published_images: BTreeMap::new(),
            robot: robot.clone(),
        };
        publisher.description.send(&Text { data: robot_urdf(robot, world_from_base) })?;
        publisher.fixed_transforms.send(&Transforms { transforms: fixed_frames(robot, world_from_base, at) })?;
        Ok(publisher)
    }

    /// Waits until a subscriber of the joint states has been found. Returns true if there is one within `timeout`.
    pub fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        self.joint_states.wait_for_subscriber(timeout)
    }

    /// Publishes the readings of a moment, with the stamp `at` (since 1970). The hand's joints are not measured:
    /// `hand_angles` (rad) are their estimates, and without them only the arm moves.
    ///
    /// # Errors
    /// [`Ros2Error`] if the DDS library fails, and for an image of the wrong size.
    pub fn send_readings(
        &mut self,
        at: Duration,
        readings: &Readings,
        hand_angles: Option<&[f64]>,
    ) -> Result<(), Ros2Error> {
        let arm = readings.arm.map(|arm| arm.value);
        self.joint_states.send(&self.joint_state(at, arm.as_ref(), hand_angles))?;
        let mut transforms = arm.map_or_else(Vec::new, |arm| arm_frames(&self.robot, &arm.position, at));
        transforms.extend(hand_angles.map_or_else(Vec::new, |angles| hand_frames(&self.robot, angles, at)));
        self.transforms.send(&Transforms { transforms })?;
        self.servo_states.send(&self.names.servo_states(at, &readings.servos))?;
        readings.tactile.iter().try_for_each(|frame| self.send_image(at, frame))
    }

    /// Publishes the command of a moment, as it was sent after limits.
    ///
    /// # Errors
    /// [`Ros2Error`] if the DDS library fails.
    pub fn send_command(&self, at: Duration, command: &RobotCommand) -> Result<(), Ros2Error> {
        self.arm_commands.send(&self.names.arm_command(at, command))?;
        self.servo_commands.send(&self.names.servo_command(at, command))
    }

    /// Returns the number of messages left out because a subscriber was too slow.
    pub fn unsent(&self) -> u64 {
        let images: u64 = self.cameras.iter().map(|camera| camera.images.unsent() + camera.info.unsent()).sum();
        images + self.joint_states.unsent() + self.transforms.unsent() + self.servo_states.unsent()
    }

    /// Waits until reliable subscribers have acknowledged everything, for `timeout` at most.
    pub fn flush(&self, timeout: Duration) {
        // Without an acknowledgment nothing more can be done.
        let _ = self.joint_states.wait_for_acknowledgment(timeout);
        for camera in &self.cameras {
            let _ = camera.images.wait_for_acknowledgment(timeout);
        }
    }

    /// Returns the state of all joints of the description that are known.
    fn joint_state(&self, at: Duration, arm: Option<&ArmState>, hand_angles: Option<&[f64]>) -> JointState {
        let mut state = arm.map_or_else(JointState::default, |arm| self.names.arm_state(at, arm));
        state.header = Header::new(at, "");
        if let Some(angles) = hand_angles {
            let joints = self.robot.hand.tree.joints.iter();
            state.name.extend(joints.map(|joint| hand_joint(&joint.name)));
            state.position.extend(angles);
            // Estimates have neither speed nor torque: NaN, which stands for an unknown value in ROS.
            state.velocity.extend(angles.iter().map(|_| f64::NAN));
            state.effort.extend(angles.iter().map(|_| f64::NAN));
        }
        state
    }

    fn send_image(&mut self, at: Duration, frame: &TactileFrame) -> Result<(), Ros2Error> {
        let Some(topics) = self.cameras.get(frame.camera) else { return Ok(()) };
        if self.published_images.insert(frame.camera, frame.sequence) == Some(frame.sequence) {
            return Ok(());
        }
        let fault = |source| topics.images.message_error(source);
        let image = tactile_image(at, &topics.frame, frame).map_err(fault)?;
        let (dx, dy) = self.robot.hand.cameras[frame.camera].pixel_size();
        let focal = [CAMERA_DISTANCE / dx, CAMERA_DISTANCE / dy];
        topics.info.send(&CameraInfo::pinhole(image.header.clone(), IMAGE_SIZE as u32, focal))?;
        topics.images.send(&image)
    }
}
