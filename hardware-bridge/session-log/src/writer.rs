//! Writer of a session file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use ftac_platform::digest::sha256;
use hand_model::robot;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};
use prost::Message;

use crate::error::SessionLogError;
use crate::message::{Command, DetectedObject, DetectedPose, Observation, Tick};
use crate::schema;
use crate::tactile_frame::LastImages;
use crate::tap::{Direction, LinkPacket};

/// Version of the layout described in the [crate's documentation](crate).
pub const FORMAT_VERSION: &str = "4";
/// Earlier version that can be read too: its chunks are not compressed, and its images are whole.
pub(crate) const FORMER_VERSION: &str = "3";
/// Level of the compression, 1 to 22. Higher ones gain little on the noise of cameras.
const COMPRESSION_LEVEL: u32 = 1;
/// Topic of observations.
pub const OBSERVATION_TOPIC: &str = "observation";
/// Topic of commands as the controller requested them.
pub const REQUESTED_COMMAND_TOPIC: &str = "command/requested";
/// Topic of commands as they were sent.
pub const SENT_COMMAND_TOPIC: &str = "command/sent";
/// Topic of ticks.
pub const TICK_TOPIC: &str = "tick";
/// Name of the metadata record.
pub const METADATA_NAME: &str = "session";
/// Topic of the configuration file.
pub const CONFIGURATION_TOPIC: &str = "configuration";
/// Topic of the calibration file.
pub const CALIBRATION_TOPIC: &str = "calibration";
/// Topic of the task.
pub const TASK_TOPIC: &str = "task";
/// Topic of poses from prior perception.
pub const DETECTION_TOPIC: &str = "detection";
/// Topic of failures of prior perception.
pub const DETECTION_FAILED_TOPIC: &str = "detection/failed";
/// Topic of observations that failed.
pub const OBSERVATION_FAILED_TOPIC: &str = "observation/failed";
/// Topic of commands that could not be sent.
pub const COMMAND_FAILED_TOPIC: &str = "command/failed";
/// Topic of the robot's own statistics.
pub const STATISTICS_TOPIC: &str = "statistics";
/// Topic of the outcome.
pub const OUTCOME_TOPIC: &str = "outcome";

/// Description of a session, written at its beginning.
///
/// ```
/// use robot_session_log::SessionHeader;
///
/// let header = SessionHeader {
///     robot: "hardware".to_owned(),
///     program: "my-controller 1.2".to_owned(),
///     seed: 7,
///     tick_length: 0.01,
///     configuration: b"[limits]\ncurrent = 0.5\n".to_vec(),
///     ..SessionHeader::default()
/// };
/// # assert!(header.task.is_empty());
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SessionHeader {
    /// Kind of robot, such as `sim`, `emulated` or `hardware`.
    pub robot: String,
    /// Program and version that wrote the session.
    pub program: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Length of a control tick, s; at most 1.
    pub tick_length: f64,
    /// Content of the configuration file; empty if there was none.
    pub configuration: Vec<u8>,
    /// Content of the calibration file; empty if there was none.
    pub calibration: Vec<u8>,
    /// Task in the controller's own format, with all that a replay needs to set it up again; may be empty.
    pub task: Vec<u8>,
}

fn nanoseconds(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

/// Converts a robot's time (s) to the file's nanoseconds, which are not negative.
fn robot_time(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

/// Writer of a session. Dropping it finishes the file too, but an error is then lost.
///
/// [`SessionRecorder`](crate::SessionRecorder) calls it for a robot behind the interface. Call it yourself for a robot
/// that is not:
/// ```
/// use hand_model::robot::{Observation, RobotCommand, Tick};
/// use robot_session_log::{SessionHeader, SessionWriter};
///
/// let folder = tempfile::tempdir()?;
/// let header = SessionHeader { tick_length: 0.01, ..SessionHeader::default() };
/// let mut writer = SessionWriter::create(&folder.path().join("session.mcap"), &header)?;
/// for n in 0..10 {
///     writer.observation(&Observation { time: 0.01 * f64::from(n), ..Observation::default() }.into())?;
///     writer.requested_command(&RobotCommand::default())?;
///     writer.sent_command(&RobotCommand::default())?;
///     writer.tick(Tick { time: 0.01 * f64::from(n + 1), lateness: 0.0 })?;
/// }
/// writer.finish()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SessionWriter {
    mcap: mcap::Writer<BufWriter<File>>,
    path: PathBuf,
    start: Instant,
    /// Wall-clock time of `start`, since 1970.
    start_time: Duration,
    channels: BTreeMap<String, (u16, u32)>,
    schemas: BTreeMap<&'static str, u16>,
    last_images: LastImages,
    /// Robot's time of the newest observation or tick, s; it stamps the commands that follow.
    time: f64,
}

impl SessionWriter {
    /// Creates the file at `path`, which must not exist.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn create(path: &Path, session: &SessionHeader) -> Result<Self, SessionLogError> {
        let file = File::create_new(path).map_err(SessionLogError::io(path))?;
        // Only a complete chunk is readable, so each tick is one, compressed in memory and written at once. Viewers need
        // chunks.
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .compression_level(COMPRESSION_LEVEL)
            // A tick is too small for threads of its own.
            .compression_threads(0)
            .disable_seeking(true)
            .library("robot-session-log");
        let mcap = options.create(BufWriter::new(file)).map_err(SessionLogError::mcap(path))?;
        let mut writer = Self {
            mcap,
            path: path.to_owned(),
            start: Instant::now(),
            start_time: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default(),
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            last_images: LastImages::new(),
            time: 0.0,
        };
        writer.write_header(session).map_err(SessionLogError::mcap(path))?;
        writer.flush()?;
        Ok(writer)
    }

    fn write_header(&mut self, session: &SessionHeader) -> mcap::McapResult<()> {
        let entries = [
            ("format", FORMAT_VERSION.to_owned()),
            ("robot", session.robot.clone()),
            ("program", session.program.clone()),
            ("seed", session.seed.to_string()),
            // `{:?}` writes as many digits as are needed to restore the same bits.
            ("tick_length_s", format!("{:?}", session.tick_length)),
            ("configuration_sha256", sha256(&session.configuration)),
            ("calibration_sha256", sha256(&session.calibration)),
            ("task_sha256", sha256(&session.task)),
            ("begun_unix_ns", nanoseconds(self.start_time).to_string()),
        ];
        let metadata = entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        self.mcap.write_metadata(&Metadata { name: METADATA_NAME.to_owned(), metadata })?;
        self.append(CONFIGURATION_TOPIC, None, Duration::ZERO, 0, &session.configuration)?;
        self.append(CALIBRATION_TOPIC, None, Duration::ZERO, 0, &session.calibration)?;
        self.append(TASK_TOPIC, None, Duration::ZERO, 0, &session.task)
    }

    /// Returns the time since the session began on the host's clock, as written to the file.
    pub fn host_time(&self) -> Duration {
        self.start.elapsed()
    }

    /// Writes bytes that crossed `link` at `host` time (see [`SessionWriter::host_time`]). `device` is the time on the
    /// device's own clock, or `host` again if it has none.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn raw(
        &mut self,
        link: &str,
        direction: Direction,
        host: Duration,
        device: Duration,
        bytes: &[u8],
    ) -> Result<(), SessionLogError> {
        let way = match direction {
            Direction::Sent => "sent",
            Direction::Received => "received",
        };
        self.write(&format!("raw/{link}/{way}"), None, host, nanoseconds(device), bytes)
    }

    /// Writes a packet copied by a tap, from a device without a clock of its own.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn packet(&mut self, packet: &LinkPacket) -> Result<(), SessionLogError> {
        let host = packet.time.saturating_duration_since(self.start);
        self.raw(packet.link, packet.direction, host, host, &packet.bytes)
    }

    /// Writes an observation; call it as soon as the observation has been made.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn observation(&mut self, readings: &robot::Readings) -> Result<(), SessionLogError> {
        self.time = readings.time;
        let message = Observation::new(readings, &mut self.last_images);
        self.message(OBSERVATION_TOPIC, "Observation", &message)
    }

    /// Writes the reason why an observation failed.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn observation_failed(&mut self, why: &str) -> Result<(), SessionLogError> {
        self.write_without_schema(OBSERVATION_FAILED_TOPIC, why.as_bytes())
    }

    /// Writes the reason why a command was not sent.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn command_failed(&mut self, why: &str) -> Result<(), SessionLogError> {
        self.write_without_schema(COMMAND_FAILED_TOPIC, why.as_bytes())
    }

    /// Writes a command as requested, before it is passed on.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn requested_command(&mut self, command: &robot::RobotCommand) -> Result<(), SessionLogError> {
        self.message(REQUESTED_COMMAND_TOPIC, "Command", &Command::from(command))
    }

    /// Writes a command as it was sent.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn sent_command(&mut self, command: &robot::RobotCommand) -> Result<(), SessionLogError> {
        self.message(SENT_COMMAND_TOPIC, "Command", &Command::from(command))
    }

    /// Writes the result of prior perception for an object; `None` if it was not visible.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn detection(&mut self, object: usize, seen: Option<&DetectedPose>) -> Result<(), SessionLogError> {
        self.message(DETECTION_TOPIC, "Detection", &DetectedObject::new(object, seen))
    }

    /// Writes the reason why prior perception failed; the trial ends with it.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn detection_failed(&mut self, why: &str) -> Result<(), SessionLogError> {
        self.write_without_schema(DETECTION_FAILED_TOPIC, why.as_bytes())
    }

    /// Writes the outcome, in the controller's own format.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn outcome(&mut self, text: &[u8]) -> Result<(), SessionLogError> {
        self.write_without_schema(OUTCOME_TOPIC, text)
    }

    /// Writes the robot's own statistics, as JSON.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn statistics(&mut self, json: &[u8]) -> Result<(), SessionLogError> {
        self.write_without_schema(STATISTICS_TOPIC, json)
    }

    /// Writes the end of a tick. Everything up to here survives the death of the program, though not a loss of power.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn tick(&mut self, tick: robot::Tick) -> Result<(), SessionLogError> {
        self.time = tick.time;
        self.message(TICK_TOPIC, "Tick", &Tick::from(tick))?;
        self.flush()
    }

    /// Writes the summary and ends the file.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn finish(mut self) -> Result<(), SessionLogError> {
        self.mcap.finish().map_err(SessionLogError::mcap(&self.path))?;
        self.mcap.into_inner().flush().map_err(SessionLogError::io(&self.path))
    }

    /// Ends the chunk and hands everything to the operating system.
    fn flush(&mut self) -> Result<(), SessionLogError> {
        self.mcap.flush().map_err(SessionLogError::mcap(&self.path))
    }

    /// Writes bytes that no schema describes.
    fn write_without_schema(&mut self, topic: &str, bytes: &[u8]) -> Result<(), SessionLogError> {
        let (host, body) = (self.host_time(), robot_time(self.time));
        self.write(topic, None, host, body, bytes)
    }

    fn message(&mut self, topic: &str, name: &'static str, message: &impl Message) -> Result<(), SessionLogError> {
        let (host, body) = (self.host_time(), robot_time(self.time));
        self.write(topic, Some(name), host, body, &message.encode_to_vec())
    }

    fn write(
        &mut self,
        topic: &str,
        schema: Option<&'static str>,
        host: Duration,
        device: u64,
        data: &[u8],
    ) -> Result<(), SessionLogError> {
        self.append(topic, schema, host, device, data).map_err(SessionLogError::mcap(&self.path))
    }

    fn append(
        &mut self,
        topic: &str,
        schema: Option<&'static str>,
        host: Duration,
        device: u64,
        data: &[u8],
    ) -> mcap::McapResult<()> {
        if !self.channels.contains_key(topic) {
            let (schema, encoding) = match schema {
                Some(name) => (self.schema(name)?, "protobuf"),
                None => (0, "application/octet-stream"),
            };
            let channel = self.mcap.add_channel(schema, topic, encoding, &BTreeMap::new())?;
            self.channels.insert(topic.to_owned(), (channel, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else { return Ok(()) };
        *sequence = sequence.wrapping_add(1);
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: nanoseconds(self.start_time + host),
            publish_time: device,
        };
        self.mcap.write_to_known_channel(&header, data)
    }

    fn schema(&mut self, name: &'static str) -> mcap::McapResult<u16> {
        if let Some(id) = self.schemas.get(name) {
            return Ok(*id);
        }
        let id = self.mcap.add_schema(&schema::message_name(name), "protobuf", &schema::descriptor_set())?;
        self.schemas.insert(name, id);
        Ok(id)
    }
}
