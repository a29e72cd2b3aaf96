//! ROS 2 topics without a ROS installation: a [`Ros2Node`] takes part in a ROS 2 domain over the pure-Rust DDS library
//! `rustdds`, and a [`RobotPublisher`] publishes what a robot measures so that RViz shows it.
//!
//! ```no_run
//! use std::time::Duration;
//!
//! use robot_ros2::messages::{Header, JointState};
//! use robot_ros2::{QosProfile, Ros2Node};
//!
//! let node = Ros2Node::new(0, Some([127, 0, 0, 1].into()))?;
//! let states = node.publish("/joint_states", QosProfile::Reliable)?;
//! states.wait_for_subscriber(Duration::from_secs(5));
//! states.send(&JointState { header: Header::default(), name: vec!["joint_1".into()], position: vec![0.5], ..Default::default() })?;
//! # Ok::<(), robot_ros2::Ros2Error>(())
//! ```
//!
//! # Topics
//! | topic | type | content |
//! |---|---|---|
//! | `/joint_states` | `sensor_msgs/msg/JointState` | all joints of the description: the arm as measured, the hand as estimated |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | frames of the links of arm and hand |
//! | `/tf_static` | the same, latched | fixed frames: base, tool, palm, `pad_<name>`, `camera_<name>` |
//! | `/robot_description` | `std_msgs/msg/String`, latched | URDF of arm and hand |
//! | `/hand/servo_states` | `sensor_msgs/msg/JointState` | angles and speeds of the servo horns, torques from their currents |
//! | `/arm/joint_commands`, `/hand/servo_commands` | the same | set-points and goals as they were sent |
//! | `/tactile/<camera>/image_raw` | `sensor_msgs/msg/Image` | `rgb8`, 240 x 240 pixels, whenever a new image arrived |
//! | `/tactile/<camera>/camera_info` | `sensor_msgs/msg/CameraInfo` | pinhole camera in front of the pad that sees its undeformed surface as in the image |
//!
//! Latched topics are transient local with a depth of 1, all others reliable with a depth of 10, so that subscribers of
//! either reliability receive them. A publisher never waits: a message for which a slow subscriber has no room is left out
//! and counted.
//!
//! # Limitations
//! Topics only: no services, actions, parameters or node graph, so controllers are activated by ROS's own tools. No DDS
//! security, no shared memory. Peers are found by multicast, and on one computer over the loopback address; a list of
//! peers in other networks cannot be given. Only Unix systems.

#![deny(missing_docs, unreachable_pub)]

pub mod error;
pub mod frames;
pub mod node;
pub mod robot_publisher;

pub use error::Ros2Error;
pub use node::{Publisher, QosProfile, Ros2Node, Subscription};
pub use robot_publisher::RobotPublisher;
/// Messages and their encoding.
pub use robot_ros2_messages as messages;

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
