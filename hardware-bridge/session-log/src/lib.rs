//! Record and replay of any [`RobotBackend`](hand_model::robot::RobotBackend): a session is one MCAP file with all inputs and outputs of the robot.
//!
//! The format is the same for simulated, emulated and real robots:
//!
//! | topic | content |
//! |---|---|
//! | `observation` | readings from [`RobotBackend::observe`](hand_model::robot::RobotBackend::observe), each with its time, images included |
//! | `command/asked`, `command/sent` | the command requested by the controller, and the one sent after limits |
//! | `observation/failed`, `command/failed` | the reason why an observation or a command failed |
//! | `detection` | the pose of an object from prior perception, an input of the controller besides the robot's measurements |
//! | `detection_failed` | the reason why prior perception failed, if that ended the trial |
//! | `tick` | the end of a control tick |
//! | `outcome` | the result, in the controller's format |
//! | `statistics` | the robot's own statistics, as JSON |
//! | `raw/<link>/sent`, `raw/<link>/received` | bytes of a link as they were on the wire |
//! | metadata `session` | robot, program, seed, tick length, SHA-256 of configuration and calibration |
//! | `configuration`, `calibration`, `task` | copies of both files, and the description of the task |
//!
//! Every message has two times. MCAP's *log time* is the wall clock at the beginning of the session plus the host's
//! monotonic clock since then. The *publish time* is the clock of the device or robot that the message is about.
//! Observations, commands, perceived poses and ticks are protobuf, described in the file ([`schema`]), so that other
//! tools can read them; the other topics are plain bytes.
//!
//! Numbers keep all their bits. Each tick is an uncompressed chunk with an index of its messages, for viewers, and is
//! handed to the operating system at once. A killed program therefore leaves everything up to its last whole tick, and
//! [`reader`] reads such a file.
//!
//! [`recorder::SessionRecorder`] wraps a robot and writes its session; [`tap::LinkTap`] adds the bytes of a link.
//! [`replay::Replay`] is a robot that plays a session back and compares every command with the recorded one, bit by
//! bit. [`comparison`] compares two sessions, [`read_frames`] resamples one for learning, and [`ros2`] exports one as a ROS
//! 2 bag.

pub mod comparison;
pub mod error;
pub mod frames;
pub mod message;
pub mod reader;
pub mod recorder;
pub mod replay;
pub mod ros2;
pub mod schema;
mod sizes;
pub mod tap;
pub mod writer;

pub use error::SessionLogError;
pub use message::RobotSizes;
pub use reader::{SessionEvent, SessionReader};
pub use recorder::SessionRecorder;
pub use replay::Replay;
pub use tap::{Direction, LinkPacket, LinkTap};
pub use writer::{SessionHeader, SessionWriter};
