//! A robot on ROS 2 topics, without a ROS installation.
//!
//! [`config`] reads the file that names domain, topics and joints. [`link`] joins the topics to the servo cycle of the
//! hardware bridge, so that the safety supervisor is between controller and robot: `sensor_msgs/msg/JointState` comes in,
//! `std_msgs/msg/Float64MultiArray` goes out, as the forward command controllers of `ros2_control` take it. [`cameras`]
//! receives the tactile images. Measurements have the times of their headers, converted to the bridge's clock by
//! [`stamps`].

pub mod cameras;
pub mod config;
pub mod joints;
pub mod link;
pub mod stamps;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use hand_model::RobotModel;
use hardware_bridge::config::{ConfigError, LimitConfig};
use hardware_bridge::delivered_images::DeliveredImages;
use hardware_bridge::hardware_robot::{ConnectError, HardwareRobot, LinkSettings, LinkTiming};
use robot_ros2::messages::{Float64Array, JointState};
use robot_ros2::{QosProfile, Ros2Error, Ros2Node, Subscription};

use self::cameras::Ros2Cameras;
use self::config::Ros2Config;
use self::joints::{JointError, JointTable};
use self::link::{CommandTopics, Ros2Link};

/// Longest wait until the robot is checked or engaged.
const ORDER_TIMEOUT: Duration = Duration::from_secs(3);
/// Pause between two looks for messages while the first ones are awaited.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// A robot that cannot be driven over ROS 2.
#[derive(Debug, thiserror::Error)]
pub enum Ros2RobotError {
    /// The configuration or its limits.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The node or a topic.
    #[error(transparent)]
    Ros2(#[from] Ros2Error),
    /// The joint states lack a joint of the robot.
    #[error("{topic} on domain {domain}: found no joint `{joint}` within {seconds} s, only {found}, expected it")]
    MissingJoint {
        /// Name of the topic.
        topic: String,
        /// Number of the domain.
        domain: u16,
        /// Name of the first joint that is missing.
        joint: String,
        /// Time limit, s.
        seconds: f64,
        /// Names that arrived.
        found: String,
    },
    /// The joint states lack a value.
    #[error("{topic} on domain {domain}: {source}")]
    Joint {
        /// Name of the topic.
        topic: String,
        /// Number of the domain.
        domain: u16,
        /// Joint and value at fault.
        source: JointError,
    },
    /// The servo cycle does not start.
    #[error(transparent)]
    Connect(#[from] ConnectError),
}

/// A robot on ROS 2 topics, as a configuration describes it.
#[derive(Debug, Clone)]
pub struct Ros2Robot {
    /// Domain, topics and joints.
    pub config: Ros2Config,
    /// Limits that the supervisor enforces.
    pub limits: LimitConfig,
    /// File of the configuration.
    pub file: PathBuf,
    model: RobotModel,
}

impl Ros2Robot {
    /// Reads the configuration at `file` of a robot of this model, and its limits.
    ///
    /// # Errors
    /// [`ConfigError`] with file and field at fault.
    pub fn read(file: &std::path::Path, model: &RobotModel) -> Result<Self, ConfigError> {
        let config = Ros2Config::read(file)?;
        config.check(model, file)?;
        let limits = match &config.limits {
            Some(limits) => LimitConfig::read(limits, model, config.rate)?,
            None => LimitConfig::for_robot(model),
        };
        Ok(Self { config, limits, file: file.to_owned(), model: model.clone() })
    }

    /// Connects the robot under the supervisor, once each of its joints and cameras has been heard. Nothing moves.
    ///
    /// # Errors
    /// [`Ros2RobotError`] with the topic and the domain on which nothing arrived in time.
    pub fn connect(&self) -> Result<HardwareRobot, Ros2RobotError> {
        let Self { config, model, .. } = self;
        let node = Ros2Node::new(config.domain, config.interface)?;
        let commands = CommandTopics {
            arm: node.publish::<Float64Array>(&config.arm.command, QosProfile::Reliable)?,
            servo_positions: node.publish::<Float64Array>(&config.hand.position_command, QosProfile::Reliable)?,
            servo_efforts: node.publish::<Float64Array>(&config.hand.effort_command, QosProfile::Reliable)?,
        };
        let states = node.subscribe::<JointState>(&config.joint_states, QosProfile::BestEffort)?;
        let timeout = Duration::from_secs_f64(config.timeout);
        let mut joints = JointTable::new(config, model);
        self.wait_for_joints(&states, &mut joints, timeout)?;
        let images = config.cameras.as_ref().map(|_| DeliveredImages::default());
        let cameras = match (&config.cameras, &images) {
            (Some(topics), Some(images)) => {
                Some(Ros2Cameras::subscribe(&node, topics, &model.hand, images.clone(), timeout)?)
            }
            _ => None,
        };
        let travel = config.travel(&model.hand);
        let settings = LinkSettings {
            limits: self.limits.limits(&travel, &model.arm),
            timing: LinkTiming::Wall { rate: config.rate },
            images,
            file: &self.file,
            order_timeout: ORDER_TIMEOUT,
        };
        let link = Ros2Link::new(node, commands, states, joints, cameras, (config, &self.limits, &model.hand));
        Ok(HardwareRobot::start(link, model, settings)?)
    }

    /// Waits until every joint has been heard.
    fn wait_for_joints(
        &self,
        states: &Subscription<JointState>,
        joints: &mut JointTable,
        timeout: Duration,
    ) -> Result<(), Ros2RobotError> {
        let (topic, domain) = (states.topic().to_owned(), self.config.domain);
        let begun = Instant::now();
        let mut names = std::collections::BTreeSet::new();
        loop {
            while let Some(message) = states.take()? {
                names.extend(message.name.iter().cloned());
                joints.update(&message, 0.0).map_err(|source| Ros2RobotError::Joint {
                    topic: topic.clone(),
                    domain,
                    source,
                })?;
            }
            let Some(joint) = joints.first_unread() else { return Ok(()) };
            if begun.elapsed() > timeout {
                if names.is_empty() {
                    return Err(states.silent(timeout).into());
                }
                let found = names.into_iter().collect::<Vec<_>>().join(", ");
                let seconds = timeout.as_secs_f64();
                return Err(Ros2RobotError::MissingJoint { topic, domain, joint: joint.to_owned(), seconds, found });
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}
