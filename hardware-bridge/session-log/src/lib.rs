//! Record and replay of robot sessions: a session is one MCAP file with all inputs and outputs of a robot.
//!
//! The robot is any [`RobotBackend`](hand_model::robot::RobotBackend), simulated, emulated or real: an arm with up to
//! seven joints, up to six servos, and any number of tactile cameras (GelSight, DIGIT and similar); a hand without an
//! arm, or without cameras, leaves them out.
//!
//! # Example
//! A session is recorded, and the same controller is run on the recording:
//! ```
//! use hand_model::robot::{
//!     Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, ServoState, Tick,
//! };
//! use robot_session_log::{Replay, RobotSizes, SessionHeader, SessionReader, SessionRecorder, SessionWriter};
//!
//! /// A gripper with one servo. Your driver or simulator is in this place.
//! #[derive(Default)]
//! struct Gripper(Observation);
//!
//! impl RobotBackend for Gripper {
//!     fn observe(&mut self) -> Result<Readings, RobotError> {
//!         let servo = ServoState { position: self.0.time.sin(), ..ServoState::default() };
//!         Ok(Observation { servos: [servo].into_iter().collect(), ..self.0.clone() }.into())
//!     }
//!     fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
//!         Ok(*command)
//!     }
//!     fn wait_for_tick(&mut self) -> Tick {
//!         self.0.time += 0.01;
//!         Tick { time: self.0.time, lateness: 0.0 }
//!     }
//!     fn tick_length(&self) -> f64 {
//!         0.01
//!     }
//! }
//!
//! /// The controller: a current proportional to the servo's angle.
//! fn control(robot: &mut impl RobotBackend, gain: f64) -> Result<(), RobotError> {
//!     for _ in 0..100 {
//!         let seen = robot.observe()?.into_observation()?;
//!         let servos = seen.servos.iter().map(|servo| ServoGoal::Current(gain * servo.position)).collect();
//!         robot.send(&RobotCommand { servos, ..RobotCommand::default() })?;
//!         robot.wait_for_tick();
//!     }
//!     Ok(())
//! }
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("session.mcap");
//! let header = SessionHeader { tick_length: 0.01, ..SessionHeader::default() };
//! let mut recorder = SessionRecorder::new(Gripper::default(), SessionWriter::create(&path, &header)?);
//! control(&mut recorder, 0.5)?;
//! let (_robot, written) = recorder.finish();
//! written?;
//!
//! // The same controller repeats every command, bit by bit; another one diverges at once.
//! for (gain, identical) in [(0.5, true), (0.6, false)] {
//!     let mut replay = Replay::new(SessionReader::open(&path, RobotSizes::Any)?)?;
//!     control(&mut replay, gain)?;
//!     let (progress, difference) = replay.finish()?;
//!     println!("{} ticks, first difference: {difference:?}", progress.ticks);
//!     assert_eq!(difference.is_none(), identical);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//! [`recorder::SessionRecorder`] wraps a robot and writes its session with a [`writer::SessionWriter`];
//! [`tap::LinkTap`] adds the bytes of a link. [`reader::SessionReader`] reads a session event by event.
//! [`replay::Replay`] is a robot that replays a session and compares every command with the recorded one, bit by
//! bit. [`comparison`] compares two sessions, [`frames`] resamples one for learning, and [`ros2`] exports one as a ROS
//! 2 bag.
//!
//! # Format
//! | topic | content |
//! |---|---|
//! | [`OBSERVATION_TOPIC`](writer::OBSERVATION_TOPIC) | readings from [`RobotBackend::observe`](hand_model::robot::RobotBackend::observe), each with its time, images included |
//! | [`REQUESTED_COMMAND_TOPIC`](writer::REQUESTED_COMMAND_TOPIC), [`SENT_COMMAND_TOPIC`](writer::SENT_COMMAND_TOPIC) | the command requested by the controller, and the one sent after limits |
//! | [`OBSERVATION_FAILED_TOPIC`](writer::OBSERVATION_FAILED_TOPIC), [`COMMAND_FAILED_TOPIC`](writer::COMMAND_FAILED_TOPIC) | the reason why an observation or a command failed |
//! | [`DETECTION_TOPIC`](writer::DETECTION_TOPIC) | the pose of an object from prior perception, an input of the controller besides the robot's measurements |
//! | [`DETECTION_FAILED_TOPIC`](writer::DETECTION_FAILED_TOPIC) | the reason why prior perception failed, if that ended the trial |
//! | [`TICK_TOPIC`](writer::TICK_TOPIC) | the end of a control tick |
//! | [`OUTCOME_TOPIC`](writer::OUTCOME_TOPIC) | the result, in the controller's format |
//! | [`STATISTICS_TOPIC`](writer::STATISTICS_TOPIC) | the robot's own statistics, as JSON |
//! | `raw/<link>/sent`, `raw/<link>/received` | bytes of a link as they were on the wire |
//! | metadata [`METADATA_NAME`](writer::METADATA_NAME) | robot, program, seed, tick length, SHA-256 of configuration, calibration and task |
//! | [`CONFIGURATION_TOPIC`](writer::CONFIGURATION_TOPIC), [`CALIBRATION_TOPIC`](writer::CALIBRATION_TOPIC), [`TASK_TOPIC`](writer::TASK_TOPIC) | copies of both files, and the description of the task |
//!
//! Every message has two times. MCAP's *log time* is the wall clock at the beginning of the session plus the host's
//! monotonic clock since then. The *publish time* is the clock of the device or robot that the message is about.
//! Observations, commands, perceived poses and ticks are protobuf, described in the file ([`schema`]), so that other
//! tools can read them; the other topics are plain bytes.
//!
//! Numbers and images keep all their bits. A camera's first image is whole (`rgb`); a later one is stored as its change
//! since the one before (`rgb_change`, byte by byte modulo 256), and one without a change not at all. Each tick is a chunk,
//! compressed by zstd, with an index of its messages for viewers, and is handed to the operating system at once. A killed
//! program therefore leaves everything up to its last whole tick, and [`reader`] reads such a file.
//!
//! # Limitations
//! A camera's noise cannot be packed: with a standard deviation of one grey level, an image of 240 x 240 pixels takes
//! 51 kB instead of 173, and 18 cameras at 10 Hz write 9 MB/s while all images change. [`ros2`] expects images of 240 x
//! 240 pixels. Log times are of the host's clock alone: device clocks are recorded and not synchronised. Only Unix
//! systems.

#![deny(missing_docs, unreachable_pub)]

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
mod tactile_frame;
pub mod tap;
pub mod writer;

pub use error::SessionLogError;
pub use message::RobotSizes;
pub use reader::{SessionEvent, SessionReader};
pub use recorder::SessionRecorder;
pub use replay::Replay;
pub use tap::{Direction, LinkPacket, LinkTap};
pub use writer::{SessionHeader, SessionWriter};

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
