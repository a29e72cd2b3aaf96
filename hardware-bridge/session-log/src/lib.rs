//! The record of a session: an MCAP file with everything that went in and out of a robot, and the replay of it.
//!
//! One kind of file for every body, simulated, emulated or real:
//!
//! | topic | content |
//! |---|---|
//! | `observation` | what [`Robot::observe`](hand_model::robot::Robot::observe) gave, images included |
//! | `command/asked`, `command/sent` | what the controller wanted, and what was sent after limits |
//! | `seen` | what prior perception says of an object: an input of the controller beside the robot's own |
//! | `tick` | the end of a control tick |
//! | `outcome` | what came of it |
//! | `raw/<link>/sent`, `raw/<link>/received` | bytes of a link as they were on the wire |
//! | metadata `session` | robot, program, seed, tick length, SHA-256 of configuration and calibration |
//! | `configuration`, `calibration`, `task` | both files, as they were, and what was to be done |
//!
//! Every message has two times: MCAP's *log time* is the host's monotonic clock since the session began, its *publish
//! time* the clock of the device or body it is about. All but the raw bytes are protobuf, described in the file
//! ([`schema`]), so that other people's tools can read it.
//!
//! Numbers keep all their bits. Messages are not gathered into chunks and not compressed, and the file is handed to the
//! operating system at every tick: a program that is killed leaves everything up to its last whole tick ([`reader`]
//! reads such a file).
//!
//! [`tap::Tap`] copies the bytes of a link. [`recorder::Recorder`] writes a session while it passes on to any robot;
//! [`replay::Replay`] is a robot that gives a session back and holds every command to the recorded one, bit by bit; [`comparison`] lays two sessions
//! side by side.

pub mod comparison;
pub mod error;
pub mod message;
pub mod reader;
pub mod recorder;
pub mod replay;
pub mod schema;
pub mod tap;
pub mod writer;

pub use error::SessionLogError;
pub use reader::{Event, Reader};
pub use recorder::Recorder;
pub use replay::Replay;
pub use tap::{Direction, Packet, Tap};
pub use writer::{Session, Writer};
