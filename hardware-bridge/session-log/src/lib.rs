//! Record and replay of any [`RobotBackend`](hand_model::robot::RobotBackend): a session is one MCAP file with everything that went in and out of the robot.
//!
//! The format is the same for simulated, emulated and real robots:
//!
//! | topic | content |
//! |---|---|
//! | `observation` | what [`RobotBackend::observe`](hand_model::robot::RobotBackend::observe) gave, each reading with its time, images included |
//! | `command/asked`, `command/sent` | the command requested by the controller, and the one sent after limits |
//! | `observation/failed`, `command/failed` | why nothing was observed, or nothing sent |
//! | `seen` | an object's pose from prior perception, an input to the controller besides the robot's |
//! | `unseen` | why prior perception failed, where a look ended the trial |
//! | `tick` | the end of a control tick |
//! | `outcome` | the result, in the controller's format |
//! | `statistics` | JSON: what the body says of its own running |
//! | `raw/<link>/sent`, `raw/<link>/received` | bytes of a link as they were on the wire |
//! | metadata `session` | robot, program, seed, tick length, SHA-256 of configuration and calibration |
//! | `configuration`, `calibration`, `task` | copies of both files, and the description of the task |
//!
//! Every message has two times: MCAP's *log time* is the wall clock at the session's beginning plus the host's monotonic clock since then, its
//! *publish time* the clock of the device or body it is about. All but the raw bytes are protobuf, described in the file
//! ([`schema`]), so that other people's tools can read it.
//!
//! Numbers keep all their bits. Each tick is a chunk, not compressed, with an index of its messages, and goes to the operating system at once: a
//! killed program leaves everything up to its last whole tick, and [`reader`] reads such a file. Viewers find their way by the chunks' indices.
//!
//! [`recorder::Recorder`] wraps a robot and writes its session; [`tap::Tap`] adds the bytes of a link. [`replay::Replay`] is a robot that plays a
//! session back and compares every command with the recorded one, bit by bit. [`comparison`] compares two sessions, [`frames`] thins one out for learners, and [`ros2`] writes one as a
//! ROS 2 bag.

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
pub use message::Sizes;
pub use reader::{Event, Reader};
pub use recorder::Recorder;
pub use replay::Replay;
pub use tap::{Direction, Packet, Tap};
pub use writer::{Session, Writer};
