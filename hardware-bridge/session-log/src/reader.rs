//! Sequential reader of a session file, finished or cut short.

use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crc::{CRC_32_ISO_HDLC, Crc};
use ftac_platform::digest::sha256;
use ftac_platform::file::open_regular;
use hand_model::robot;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, McapResult};
use prost::Message;

use crate::error::SessionLogError;
use crate::message::{Command, DetectedObject, DetectedPose, Observation, RobotSizes, Tick};
use crate::sizes::InvalidField;
use crate::tactile_frame::LastImages;
use crate::tap::Direction;
use crate::writer::{
    CALIBRATION_TOPIC, COMMAND_FAILED_TOPIC, CONFIGURATION_TOPIC, DETECTION_FAILED_TOPIC, DETECTION_TOPIC,
    FORMAT_VERSION, FORMER_VERSION, METADATA_NAME, OBSERVATION_FAILED_TOPIC, OBSERVATION_TOPIC, OUTCOME_TOPIC,
    REQUESTED_COMMAND_TOPIC, SENT_COMMAND_TOPIC, SessionHeader, TASK_TOPIC, TICK_TOPIC,
};

/// Longest record accepted, bytes. An observation with an image of every camera has 3.2 MB; the limit guards against a
/// damaged length.
const MAX_RECORD_LENGTH: usize = 1 << 28;

/// Longest tick accepted, s.
const MAX_TICK_LENGTH: f64 = 1.0;

/// Largest number of bytes read at once.
const READ_SIZE: usize = 1 << 16;

/// Types of records that are read.
const RECORD_TYPES: [u8; 3] = [op::METADATA, op::CHUNK, op::DATA_END];
/// Types of records that are read within a chunk.
const CHUNK_RECORD_TYPES: [u8; 2] = [op::CHANNEL, op::MESSAGE];

/// An event in a session.
#[derive(Debug, Clone)]
pub enum SessionEvent {
    /// An observation.
    Observation(Box<robot::Readings>),
    /// The reason why an observation failed.
    ObservationFailed(String),
    /// A command as the controller requested it.
    RequestedCommand(robot::RobotCommand),
    /// A command as it was sent, after limits.
    SentCommand(robot::RobotCommand),
    /// The reason why a command was not sent.
    SendFailed(String),
    /// The end of a tick.
    Tick(robot::Tick),
    /// The result of prior perception: index of the object, and its pose if it was visible.
    Detection(usize, Option<DetectedPose>),
    /// The reason why prior perception failed.
    DetectionFailed(String),
    /// The outcome, in the controller's own format.
    Outcome(Vec<u8>),
    /// Bytes on a link.
    Raw {
        /// Name of the link.
        link: String,
        /// Direction of transfer.
        direction: Direction,
        /// The bytes on the wire.
        bytes: Vec<u8>,
    },
}

/// Times of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventTimes {
    /// Time on the host's clock since the session began.
    pub host: Duration,
    /// Time on the clock of the device or robot.
    pub device: Duration,
}

/// Reader of a session file, from its beginning.
///
/// ```
/// use robot_session_log::{RobotSizes, SessionEvent, SessionHeader, SessionReader, SessionWriter};
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("session.mcap");
/// # SessionWriter::create(&path, &SessionHeader::default())?.finish()?;
/// // `RobotSizes::from_robot(&model)` checks the messages against a robot.
/// let mut reader = SessionReader::open(&path, RobotSizes::Any)?;
/// println!("{} of seed {}", reader.session().program, reader.session().seed);
/// while let Some((times, event)) = reader.next_event()? {
///     if let SessionEvent::SentCommand(command) = event {
///         println!("{:?}: {:?}", times.host, command.servos);
///     }
/// }
/// // False for the session of a program that was killed.
/// assert!(reader.is_finished());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SessionReader {
    path: PathBuf,
    file: BufReader<File>,
    mcap: LinearReader,
    /// Remaining records of the last chunk.
    chunk: VecDeque<Record<'static>>,
    topics: BTreeMap<u16, String>,
    sizes: RobotSizes,
    last_images: LastImages,
    session: SessionHeader,
    /// Wall-clock time at which the session began, since 1970.
    start_time: Duration,
    finished: bool,
    ended: bool,
}

impl SessionReader {
    /// Opens a file and reads the description of its session. Messages that do not have these `sizes` are errors when
    /// they are read.
    ///
    /// # Errors
    /// [`SessionLogError`] if the file is not an existing regular file, not MCAP, not a session, or of another format
    /// version, or if its configuration, calibration or task does not match the recorded hash.
    pub fn open(path: &Path, sizes: RobotSizes) -> Result<Self, SessionLogError> {
        let file = BufReader::new(open_regular(path, u64::MAX).map_err(SessionLogError::io(path))?);
        // The checksum follows the data: a damaged file is detected there; one cut short has none.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(MAX_RECORD_LENGTH);
        let mut reader = Self {
            path: path.to_owned(),
            file,
            mcap: LinearReader::new_with_options(options),
            chunk: VecDeque::new(),
            topics: BTreeMap::new(),
            sizes,
            last_images: LastImages::new(),
            session: SessionHeader::default(),
            start_time: Duration::ZERO,
            finished: false,
            ended: false,
        };
        reader.read_head()?;
        Ok(reader)
    }

    /// Replaces the `sizes` that messages must have.
    #[must_use]
    pub fn with_sizes(self, sizes: RobotSizes) -> Self {
        Self { sizes, ..self }
    }

    /// Returns the description of the session.
    pub fn session(&self) -> &SessionHeader {
        &self.session
    }

    /// Returns the host's wall-clock time at which the session began, since 1970.
    pub fn start_time(&self) -> Duration {
        self.start_time
    }

    /// True if the file was finished; known only once it has been read to its end.
    pub fn is_finished(&self) -> bool {
        self.finished
    }

    fn field(&self, field: &str, found: &str, expected: &str) -> SessionLogError {
        SessionLogError::field(&self.path, field, found, expected)
    }

    /// Reads the beginning of the file: metadata, configuration, calibration and task.
    fn read_head(&mut self) -> Result<(), SessionLogError> {
        let mut hashes: Option<[String; 3]> = None;
        let mut files: [Option<Vec<u8>>; 3] = [None, None, None];
        while files.iter().any(Option::is_none) {
            match self.next_record()? {
                Some(Record::Metadata(metadata)) if metadata.name == METADATA_NAME => {
                    let get = |name: &str| metadata.metadata.get(name).cloned().unwrap_or_default();
                    let format = get("format");
                    if ![FORMAT_VERSION, FORMER_VERSION].contains(&format.as_str()) {
                        let found = format!("{format} (written by {})", get("program"));
                        return Err(self.field("format", &found, &format!("{FORMER_VERSION} or {FORMAT_VERSION}")));
                    }
                    let begun = get("begun_unix_ns");
                    let unix = begun.parse().map_err(|_| self.field("begun_unix_ns", &begun, "a whole number"))?;
                    self.start_time = Duration::from_nanos(unix);
                    let (seed, tick) = (get("seed"), get("tick_length_s"));
                    self.session = SessionHeader {
                        robot: get("robot"),
                        program: get("program"),
                        seed: seed.parse().map_err(|_| self.field("seed", &seed, "a whole number"))?,
                        tick_length: (tick.parse().ok())
                            .filter(|tick| (0.0..=MAX_TICK_LENGTH).contains(tick))
                            .ok_or_else(|| self.field("tick_length_s", &tick, "a number from 0 to 1"))?,
                        ..SessionHeader::default()
                    };
                    hashes = Some([get("configuration_sha256"), get("calibration_sha256"), get("task_sha256")]);
                }
                Some(Record::Channel(channel)) => self.add_channel(channel),
                Some(Record::Message { header, data }) => match self.topics.get(&header.channel_id).map(String::as_str)
                {
                    Some(CONFIGURATION_TOPIC) => files[0] = Some(data.into_owned()),
                    Some(CALIBRATION_TOPIC) => files[1] = Some(data.into_owned()),
                    Some(TASK_TOPIC) => files[2] = Some(data.into_owned()),
                    _ => return Err(self.field("beginning", "something else", "configuration, calibration and task")),
                },
                Some(_) => {}
                None => return Err(self.field("beginning", "cut short", "configuration, calibration and task")),
            }
        }
        let Some(hashes) = hashes else {
            return Err(self.field("metadata `session`", "missing", "that of a session"));
        };
        let [configuration, calibration, task] = files.map(Option::unwrap_or_default);
        for (name, data, expected) in [
            (CONFIGURATION_TOPIC, &configuration, &hashes[0]),
            (CALIBRATION_TOPIC, &calibration, &hashes[1]),
            (TASK_TOPIC, &task, &hashes[2]),
        ] {
            let found = sha256(data);
            if found != *expected {
                return Err(self.field(&format!("SHA-256 of the {name}"), &found, expected));
            }
        }
        (self.session.configuration, self.session.calibration, self.session.task) = (configuration, calibration, task);
        Ok(())
    }

    fn add_channel(&mut self, channel: mcap::records::Channel) {
        self.topics.insert(channel.id, current_topic(channel.topic));
    }

    /// Returns the next record; `None` at the end of the file, even of one cut short.
    fn next_record(&mut self) -> Result<Option<Record<'static>>, SessionLogError> {
        loop {
            if let Some(record) = self.chunk.pop_front() {
                return Ok(Some(record));
            }
            if self.ended {
                return Ok(None);
            }
            match self.mcap.next_event() {
                None | Some(Err(McapError::UnexpectedEof)) => self.ended = true,
                Some(Err(error)) => return Err(SessionLogError::mcap(&self.path)(error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    // Read in pieces: a damaged length may ask for more than there is.
                    let piece = self.mcap.insert(wanted.min(READ_SIZE));
                    let read = self.file.read(piece).map_err(SessionLogError::io(&self.path))?;
                    self.mcap.notify_read(read);
                }
                // Other records are skipped. (mcap 0.25 panics on some damaged attachments.)
                Some(Ok(LinearReadEvent::Record { opcode, data })) if RECORD_TYPES.contains(&opcode) => {
                    let record = mcap::parse_record(opcode, data).map_err(SessionLogError::mcap(&self.path))?;
                    match record.into_owned() {
                        Record::Chunk { header, data } => {
                            self.chunk = chunk_records(&header, &data).map_err(SessionLogError::mcap(&self.path))?;
                        }
                        record => return Ok(Some(record)),
                    }
                }
                Some(Ok(LinearReadEvent::Record { .. })) => {}
            }
        }
    }

    /// Returns the next event and its times; `None` at the end.
    ///
    /// # Errors
    /// [`SessionLogError`]. A file that is cut short is not an error; see [`SessionReader::is_finished`].
    pub fn next_event(&mut self) -> Result<Option<(EventTimes, SessionEvent)>, SessionLogError> {
        while let Some(record) = self.next_record()? {
            match record {
                Record::Channel(channel) => self.add_channel(channel),
                Record::DataEnd(_) => self.finished = true,
                Record::Message { header, data } => {
                    let Some(topic) = self.topics.get(&header.channel_id).cloned() else {
                        let found = header.channel_id.to_string();
                        return Err(self.field("channel of a message", &found, "one announced before"));
                    };
                    let times = EventTimes {
                        host: Duration::from_nanos(header.log_time).saturating_sub(self.start_time),
                        device: Duration::from_nanos(header.publish_time),
                    };
                    if let Some(event) = self.event(&topic, header.sequence, &data)? {
                        return Ok(Some((times, event)));
                    }
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// Decodes a message on `topic`; `None` for a foreign topic.
    fn event(&mut self, topic: &str, sequence: u32, data: &[u8]) -> Result<Option<SessionEvent>, SessionLogError> {
        let (last, sizes) = (&mut self.last_images, self.sizes);
        let text = || String::from_utf8_lossy(data).into_owned();
        let event = match topic {
            OBSERVATION_TOPIC => decode(data)
                .and_then(|message: Observation| message.read(last, sizes))
                .map(|readings| SessionEvent::Observation(Box::new(readings))),
            REQUESTED_COMMAND_TOPIC => {
                decode(data).and_then(|message: Command| message.read(sizes)).map(SessionEvent::RequestedCommand)
            }
            SENT_COMMAND_TOPIC => {
                decode(data).and_then(|message: Command| message.read(sizes)).map(SessionEvent::SentCommand)
            }
            DETECTION_TOPIC => decode(data)
                .and_then(|message: DetectedObject| message.read())
                .map(|(object, pose)| SessionEvent::Detection(object, pose)),
            DETECTION_FAILED_TOPIC => Ok(SessionEvent::DetectionFailed(text())),
            OBSERVATION_FAILED_TOPIC => Ok(SessionEvent::ObservationFailed(text())),
            COMMAND_FAILED_TOPIC => Ok(SessionEvent::SendFailed(text())),
            OUTCOME_TOPIC => Ok(SessionEvent::Outcome(data.to_owned())),
            TICK_TOPIC => decode(data).and_then(Tick::read).map(SessionEvent::Tick),
            _ => match raw_topic(topic) {
                Some((link, direction)) => {
                    Ok(SessionEvent::Raw { link: link.to_owned(), direction, bytes: data.to_owned() })
                }
                None => return Ok(None),
            },
        };
        event.map(Some).map_err(|(field, found, expected)| {
            SessionLogError::field(&self.path, &format!("{topic} {sequence}, {field}"), found, expected)
        })
    }
}

/// Decompresses a chunk, verifies its checksum and returns its records of interest.
fn chunk_records(header: &ChunkHeader, data: &[u8]) -> McapResult<VecDeque<Record<'static>>> {
    let size = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX);
    let data = match header.compression.as_str() {
        "" => Cow::Borrowed(data),
        "zstd" if size <= MAX_RECORD_LENGTH => Cow::Owned(zstd::bulk::decompress(data, size)?),
        "zstd" => return Err(McapError::ChunkTooLarge(header.uncompressed_size)),
        other => return Err(McapError::UnsupportedCompression(other.to_owned())),
    };
    let mut data: &[u8] = &data;
    let (saved, calculated) = (header.uncompressed_crc, Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(data));
    if saved != calculated {
        return Err(McapError::BadChunkCrc { saved, calculated });
    }
    let mut records = VecDeque::new();
    // Kind, length, content.
    while let Some(((kind, length), rest)) = data.split_first_chunk().and_then(|([kind], rest)| {
        let (length, rest) = rest.split_first_chunk()?;
        Some(((*kind, u64::from_le_bytes(*length)), rest))
    }) {
        let length = usize::try_from(length).map_err(|_| McapError::UnexpectedEoc)?;
        let (content, rest) = rest.split_at_checked(length).ok_or(McapError::UnexpectedEoc)?;
        if CHUNK_RECORD_TYPES.contains(&kind) {
            records.push_back(mcap::parse_record(kind, content)?.into_owned());
        }
        data = rest;
    }
    Ok(records)
}

fn decode<M: Message + Default>(data: &[u8]) -> Result<M, InvalidField> {
    M::decode(data).map_err(|error| ("message", format!("{} bytes ({error})", data.len()), "its fields".to_owned()))
}

/// Returns the current name of a topic of an earlier version.
fn current_topic(topic: String) -> String {
    match topic.as_str() {
        "command/asked" => REQUESTED_COMMAND_TOPIC.to_owned(),
        "seen" => DETECTION_TOPIC.to_owned(),
        "unseen" => DETECTION_FAILED_TOPIC.to_owned(),
        _ => topic,
    }
}

fn raw_topic(topic: &str) -> Option<(&str, Direction)> {
    let (link, way) = topic.strip_prefix("raw/")?.rsplit_once('/')?;
    match way {
        "sent" => Some((link, Direction::Sent)),
        "received" => Some((link, Direction::Received)),
        _ => None,
    }
}
