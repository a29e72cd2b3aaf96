//! The file that describes a robot on ROS 2 topics.
//!
//! ```toml
//! version = 1
//! domain = 0                            # ROS_DOMAIN_ID of the robot
//! interface = "192.168.1.2"             # optional: address of this computer whose network alone is used
//! joint_states = "/joint_states"        # sensor_msgs/msg/JointState: position, velocity and effort of every joint
//! rate = 200.0                          # of commands, Hz
//! timeout = 5.0                         # longest wait for the first message of each topic, s
//! limits = "limits.toml"                # optional: limits that the supervisor enforces, beside this file
//!
//! [arm]
//! joints = ["joint_1", "joint_2"]       # all of them, in the order of the model; default: the names in the model
//! command = "/arm_position_controller/commands"             # std_msgs/msg/Float64MultiArray: positions, rad
//! senses_torque = true                  # false: efforts are not read, and the torque limits not enforced
//!
//! [hand]
//! joints = ["thumb", "index"]           # the servos, as for the arm; angles of the horns, 0 at the open mark
//! position_command = "/hand_position_controller/commands"   # std_msgs/msg/Float64MultiArray: goals, rad
//! effort_command = "/hand_effort_controller/commands"       # the same: torque limits, N m
//! travel = [6.1, 6.1]                   # of the servos, rad; default: that of the model
//!
//! [cameras]                             # optional: a robot without it has no tactile cameras
//! images = "/tactile/{camera}/image_raw"                    # sensor_msgs/msg/Image: rgb8 or bgr8, 240 x 240 pixels
//! ```
//! Every field but `version` has the default that is shown, where no other one is named.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use hand_model::{ActuatorVector, Hand, RobotModel};
use hardware_bridge::config::{ConfigError, RATES};
use robot_ros2::messages::names::dds_topic;
use robot_ros2::node::MAX_DOMAIN;
use serde::{Deserialize, Serialize};

use crate::wire_emulation::servo_travel;

/// Place of a camera's name in the topic of its images.
const CAMERA_PLACE: &str = "{camera}";
/// Range of the longest wait, s.
const TIMEOUTS: (f64, f64) = (0.1, 60.0);
/// Greatest travel of a servo, rad.
const MAX_TRAVEL: f64 = 100.0;

/// Domain, topics and joints of a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros2Config {
    /// Version of this format: 1.
    pub version: u32,
    /// Number of the domain.
    #[serde(default)]
    pub domain: u16,
    /// Address of this computer whose network alone is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interface: Option<IpAddr>,
    /// Topic of the joint states.
    #[serde(default = "default_joint_states")]
    pub joint_states: String,
    /// Rate of the commands, Hz.
    #[serde(default = "default_rate")]
    pub rate: f64,
    /// Longest wait for the first message of each topic, s.
    #[serde(default = "default_timeout")]
    pub timeout: f64,
    /// File of the limits, relative to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<PathBuf>,
    #[serde(default)]
    pub arm: ArmTopics,
    #[serde(default)]
    pub hand: HandTopics,
    /// The tactile cameras, if the robot has some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cameras: Option<CameraTopics>,
}

/// Joints and topics of the arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmTopics {
    /// Names of the joints in the joint states; none for those in the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// Topic of the position commands.
    pub command: String,
    /// True if the efforts are measured torques.
    pub senses_torque: bool,
}

/// Joints and topics of the hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandTopics {
    /// Names of the servos in the joint states; none for those of the model's actuators.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// Topic of the position commands.
    pub position_command: String,
    /// Topic of the torque limits.
    pub effort_command: String,
    /// Travel of the servos, rad; none for that of the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel: Option<Vec<f64>>,
}

/// Topics of the tactile cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraTopics {
    /// Topic of a camera's images, with `{camera}` in place of its name.
    pub images: String,
}

fn default_joint_states() -> String {
    "/joint_states".to_owned()
}

fn default_rate() -> f64 {
    200.0
}

fn default_timeout() -> f64 {
    5.0
}

impl Default for ArmTopics {
    fn default() -> Self {
        Self { joints: None, command: "/arm_position_controller/commands".to_owned(), senses_torque: true }
    }
}

impl Default for HandTopics {
    fn default() -> Self {
        Self {
            joints: None,
            position_command: "/hand_position_controller/commands".to_owned(),
            effort_command: "/hand_effort_controller/commands".to_owned(),
            travel: None,
        }
    }
}

impl Default for CameraTopics {
    fn default() -> Self {
        Self { images: "/tactile/{camera}/image_raw".to_owned() }
    }
}

impl CameraTopics {
    /// Returns the topic of a camera's images.
    pub fn topic(&self, camera: &str) -> String {
        self.images.replace(CAMERA_PLACE, camera)
    }
}

impl Ros2Config {
    /// Reads the file, without comparing it with a robot.
    ///
    /// # Errors
    /// [`ConfigError`] for a file that cannot be read or has unknown fields.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let mut config: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax { path: path.to_owned(), message: error.to_string() })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        config.limits = config.limits.map(|limits| folder.join(limits));
        Ok(config)
    }

    /// Checks every value for a robot of this model; `path` is used in errors.
    ///
    /// # Errors
    /// [`ConfigError::Field`] with the first field at fault.
    pub fn check(&self, model: &RobotModel, path: &Path) -> Result<(), ConfigError> {
        let fault = |(field, found, expected): (&str, String, String)| ConfigError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found,
            expected,
        };
        self.first_error(model).map_or(Ok(()), |error| Err(fault(error)))
    }

    /// Returns the names of the arm's joints.
    pub fn arm_joints(&self, model: &RobotModel) -> Vec<String> {
        let names = || model.arm.tree.joints.iter().map(|joint| joint.name.clone()).collect();
        self.arm.joints.clone().unwrap_or_else(names)
    }

    /// Returns the names of the servos.
    pub fn servo_joints(&self, model: &RobotModel) -> Vec<String> {
        let names = || model.hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect();
        self.hand.joints.clone().unwrap_or_else(names)
    }

    /// Returns the travel of the servos, rad.
    pub fn travel(&self, hand: &Hand) -> ActuatorVector {
        self.hand.travel.as_ref().map_or_else(|| servo_travel(hand), |travel| travel.iter().copied().collect())
    }

    /// Returns the first field at fault: (field, found, expected).
    fn first_error(&self, model: &RobotModel) -> Option<(&'static str, String, String)> {
        if self.version != 1 {
            return Some(("version", self.version.to_string(), "1".to_owned()));
        }
        if self.domain > MAX_DOMAIN {
            return Some(("domain", self.domain.to_string(), format!("0 to {MAX_DOMAIN}")));
        }
        for (field, value, (low, high)) in [("rate", self.rate, RATES), ("timeout", self.timeout, TIMEOUTS)] {
            if !(low..=high).contains(&value) {
                return Some((field, value.to_string(), format!("{low} to {high}")));
            }
        }
        let (joints, servos) = (model.arm.joints(), model.hand.servos.len());
        let names = [("arm.joints", self.arm_joints(model), joints), ("hand.joints", self.servo_joints(model), servos)];
        for (field, names, count) in &names {
            if names.len() != *count {
                return Some((field, format!("{} names", names.len()), format!("{count}, those of the robot")));
            }
        }
        let [(_, arm, _), (_, hand, _)] = &names;
        let all: Vec<&String> = arm.iter().chain(hand).collect();
        if let Some(n) = (0..all.len()).find(|&n| all[..n].contains(&all[n])) {
            return Some(("hand.joints", format!("`{}` twice", all[n]), "each name once".to_owned()));
        }
        if let Some(travel) = &self.hand.travel {
            let usable = |angle: &f64| *angle > 0.0 && *angle <= MAX_TRAVEL;
            if travel.len() != servos || !travel.iter().all(usable) {
                let expected = format!("{servos} angles above 0, up to {MAX_TRAVEL} rad");
                return Some(("hand.travel", format!("{travel:?}"), expected));
            }
        }
        let images = self.cameras.as_ref().map(|cameras| &cameras.images);
        if let Some(images) = images.filter(|images| !images.contains(CAMERA_PLACE)) {
            let expected = format!("a topic with {CAMERA_PLACE} in place of a camera's name");
            return Some(("cameras.images", format!("`{images}`"), expected));
        }
        let images = self.cameras.as_ref().map_or_else(default_joint_states, |cameras| cameras.topic("name"));
        let topics = [
            ("joint_states", &self.joint_states),
            ("arm.command", &self.arm.command),
            ("hand.position_command", &self.hand.position_command),
            ("hand.effort_command", &self.hand.effort_command),
            ("cameras.images", &images),
        ];
        topics.into_iter().find_map(|(field, topic)| {
            let error = dds_topic(topic).err()?;
            Some((field, format!("`{}`", error.found), error.expected.to_owned()))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Ros2Config, String> {
        let (path, model) = (Path::new("robots/ros2.toml"), RobotModel::ftac_gen3());
        let config = Ros2Config::parse(text, path).map_err(|error| error.to_string())?;
        config.check(&model, path).map(|()| config).map_err(|error| error.to_string())
    }

    /// A robot with the usual names needs nothing but a version.
    #[test]
    fn defaults_are_the_models() {
        let (config, model) =
            (parse("version = 1\nlimits = \"limits.toml\"\n").expect("good"), RobotModel::ftac_gen3());
        assert_eq!((config.domain, config.joint_states.as_str(), config.rate), (0, "/joint_states", 200.0));
        assert_eq!(config.limits.as_deref(), Some(Path::new("robots/limits.toml")));
        assert_eq!((config.arm_joints(&model).len(), config.servo_joints(&model)[5].as_str()), (7, "opposition"));
        let config = Ros2Config { limits: None, ..config };
        assert_eq!(parse(&toml::to_string(&config).expect("TOML")), Ok(config));
    }

    #[test]
    fn errors_name_file_field_found_and_expected() {
        let error = |text: &str| parse(&format!("version = 1\n{text}")).expect_err("refused");
        assert_eq!(parse("version = 2\n").expect_err("refused"), "robots/ros2.toml: version: found 2, expected 1");
        assert_eq!(error("domain = 233\n"), "robots/ros2.toml: domain: found 233, expected 0 to 232");
        assert_eq!(error("rate = 5.0\n"), "robots/ros2.toml: rate: found 5, expected 20 to 500");
        assert!(
            error("joint_states = \"joint_states\"\n")
                .contains("joint_states: found `joint_states`, expected an absolute name")
        );
        assert!(
            error("[arm]\njoints = [\"a\"]\n").contains("arm.joints: found 1 names, expected 7, those of the robot")
        );
        let twice = "[hand]\njoints = [\"a\", \"b\", \"c\", \"d\", \"e\", \"joint_1\"]\n";
        assert!(error(twice).contains("hand.joints: found `joint_1` twice, expected each name once"));
        assert!(error("[hand]\ntravel = [1.0]\n").contains("hand.travel: found [1.0], expected 6 angles above 0"));
        assert!(
            error("[cameras]\nimages = \"/image\"\n")
                .contains("cameras.images: found `/image`, expected a topic with {camera}")
        );
        assert!(error("[arm]\ncomand = \"/a\"\n").contains("comand"));
    }
}
