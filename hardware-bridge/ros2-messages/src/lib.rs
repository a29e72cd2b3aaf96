//! Standard ROS 2 messages as CDR, without a ROS installation and without generated code.
//!
//! The types are those that a robot with an arm, a hand and cameras exchanges: joint states, images, camera parameters,
//! transforms, text, and commands to forward command controllers. Each [`Message`] has its ROS 2 name and its definition,
//! so that a bag describes itself, [`names`] maps topic and type to those of DDS, and [`robot`] converts readings and commands
//! of any [`RobotBackend`](hand_model::robot::RobotBackend). Bags (MCAP) and DDS carry the same
//! bytes; this crate does neither files nor network.
//!
//! ```
//! use std::time::Duration;
//!
//! use robot_ros2_messages::{Header, JointState, Message};
//!
//! let state = JointState {
//!     header: Header::new(Duration::from_millis(1_500), ""),
//!     name: vec!["left_finger".to_owned()],
//!     position: vec![0.25],
//!     ..JointState::default()
//! };
//! let bytes = state.to_cdr();
//! assert_eq!(JointState::from_cdr(&bytes)?, state);
//! # Ok::<(), robot_ros2_messages::CdrError>(())
//! ```
//!
//! # Limitations
//! XCDR1 only, in which ROS 2 exchanges all of its messages; read in either byte order, written little-endian. Strings are
//! UTF-8 without wide characters. Times before 1970 are refused.

#![deny(missing_docs, unreachable_pub)]

pub mod cdr;
pub mod geometry;
mod message;
pub mod names;
pub mod robot;
pub mod sensor;
pub mod standard;

pub use cdr::{CdrError, CdrReader, CdrWriter};
pub use geometry::{StampedTransform, Transforms};
pub use message::{Header, Message};
pub use sensor::{CameraInfo, Image, JointState};
pub use standard::{Float64Array, Text};

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
