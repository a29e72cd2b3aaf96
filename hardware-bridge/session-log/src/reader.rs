//! Reading a session, from its beginning, finished or cut short.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crc::{CRC_32_ISO_HDLC, Crc};
use hand_model::robot;
use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, McapResult};
use platform::digest::sha256;
use platform::file::open_regular;
use prost::Message;

use crate::error::SessionLogError;
use crate::message::{Command, LastImages, Observation, Seen, SeenPose, Sizes, Tick, Wrong};
use crate::tap::Direction;
use crate::writer::{
    ASKED, CALIBRATION, CONFIGURATION, FORMAT, METADATA, OBSERVATION, OUTCOME, SEEN, SENT, Session, TASK, TICK,
    UNOBSERVED, UNSEEN, UNSENT,
};

/// The longest record taken, bytes: an observation with an image of every camera has 3.2 MB. A damaged length must not
/// be believed.
const LONGEST: usize = 1 << 28;

/// The longest tick taken, s.
const LONGEST_TICK: f64 = 1.0;

/// Bytes read at once, at most.
const PIECE: usize = 1 << 16;

/// Kinds of records that are read.
const KNOWN: [u8; 3] = [op::METADATA, op::CHUNK, op::DATA_END];
/// Kinds of records that are read within a chunk.
const IN_CHUNK: [u8; 2] = [op::CHANNEL, op::MESSAGE];

/// Something in a session.
#[derive(Debug, Clone)]
pub enum Event {
    /// What was observed.
    Observation(Box<robot::Readings>),
    /// Why nothing was.
    Unobserved(String),
    /// What the controller wanted.
    Asked(robot::Command),
    /// What was sent.
    Sent(robot::Command),
    /// Why nothing was.
    Unsent(String),
    /// The end of a tick.
    Tick(robot::Tick),
    /// What prior perception says: which object, and its pose if it was to be seen ([`Seen`]).
    Seen(usize, Option<SeenPose>),
    /// Why a look failed.
    Unseen(String),
    /// What came of it, in the controller's words.
    Outcome(Vec<u8>),
    /// Bytes on a link.
    Raw {
        /// Name of the link.
        link: String,
        direction: Direction,
        bytes: Vec<u8>,
    },
}

/// When it happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Times {
    /// On the host's clock, since the session began.
    pub host: Duration,
    /// On the clock of the device or body.
    pub device: Duration,
}

/// A session's file, read from its beginning.
pub struct Reader {
    path: PathBuf,
    file: BufReader<File>,
    mcap: LinearReader,
    /// What the last chunk holds.
    chunk: VecDeque<Record<'static>>,
    topics: BTreeMap<u16, String>,
    sizes: Sizes,
    last_images: LastImages,
    session: Session,
    /// When it began, since 1970.
    begun: Duration,
    whole: bool,
    over: bool,
}

impl Reader {
    /// Opens a file and reads what session it is of; messages that are not of these `sizes` are errors once they are read.
    ///
    /// # Errors
    /// [`SessionLogError`]: no such file or no regular one, not MCAP, no session of ours, another format, a configuration or calibration
    /// that does not have its hash.
    pub fn open(path: &Path, sizes: Sizes) -> Result<Self, SessionLogError> {
        let file = BufReader::new(open_regular(path, u64::MAX).map_err(SessionLogError::io(path))?);
        // The checksum stands at the end of the data: a damaged file is noticed there, one cut short has none.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(LONGEST);
        let mut reader = Self {
            path: path.to_owned(),
            file,
            mcap: LinearReader::new_with_options(options),
            chunk: VecDeque::new(),
            topics: BTreeMap::new(),
            sizes,
            last_images: LastImages::new(),
            session: Session::default(),
            begun: Duration::ZERO,
            whole: false,
            over: false,
        };
        reader.read_head()?;
        Ok(reader)
    }

    /// The same with messages that are to be of these `sizes`.
    #[must_use]
    pub fn of(self, sizes: Sizes) -> Self {
        Self { sizes, ..self }
    }

    pub fn session(&self) -> &Session {
        &self.session
    }

    /// When it began by the host's wall clock, since 1970.
    pub fn begun(&self) -> Duration {
        self.begun
    }

    /// Whether the file was finished; known once it has been read to its end.
    pub fn is_whole(&self) -> bool {
        self.whole
    }

    fn field(&self, field: &str, found: &str, expected: &str) -> SessionLogError {
        SessionLogError::field(&self.path, field, found, expected)
    }

    /// The file begins with metadata, configuration, calibration and task.
    fn read_head(&mut self) -> Result<(), SessionLogError> {
        let mut hashes: Option<[String; 3]> = None;
        let mut files: [Option<Vec<u8>>; 3] = [None, None, None];
        while files.iter().any(Option::is_none) {
            match self.next_record()? {
                Some(Record::Metadata(metadata)) if metadata.name == METADATA => {
                    let get = |name: &str| metadata.metadata.get(name).cloned().unwrap_or_default();
                    let format = get("format");
                    if format != FORMAT {
                        let found = format!("{format} (written by {})", get("program"));
                        return Err(self.field("format", &found, FORMAT));
                    }
                    let begun = get("begun_unix_ns");
                    let unix = begun.parse().map_err(|_| self.field("begun_unix_ns", &begun, "a whole number"))?;
                    self.begun = Duration::from_nanos(unix);
                    let (seed, tick) = (get("seed"), get("tick_length_s"));
                    self.session = Session {
                        robot: get("robot"),
                        program: get("program"),
                        seed: seed.parse().map_err(|_| self.field("seed", &seed, "a whole number"))?,
                        tick_length: (tick.parse().ok())
                            .filter(|tick| (0.0..=LONGEST_TICK).contains(tick))
                            .ok_or_else(|| self.field("tick_length_s", &tick, "a number from 0 to 1"))?,
                        ..Session::default()
                    };
                    hashes = Some([get("configuration_sha256"), get("calibration_sha256"), get("task_sha256")]);
                }
                Some(Record::Channel(channel)) => self.announce(channel),
                Some(Record::Message { header, data }) => match self.topics.get(&header.channel_id).map(String::as_str)
                {
                    Some(CONFIGURATION) => files[0] = Some(data.into_owned()),
                    Some(CALIBRATION) => files[1] = Some(data.into_owned()),
                    Some(TASK) => files[2] = Some(data.into_owned()),
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
            (CONFIGURATION, &configuration, &hashes[0]),
            (CALIBRATION, &calibration, &hashes[1]),
            (TASK, &task, &hashes[2]),
        ] {
            let found = sha256(data);
            if found != *expected {
                return Err(self.field(&format!("SHA-256 of the {name}"), &found, expected));
            }
        }
        (self.session.configuration, self.session.calibration, self.session.task) = (configuration, calibration, task);
        Ok(())
    }

    fn announce(&mut self, channel: mcap::records::Channel) {
        self.topics.insert(channel.id, channel.topic);
    }

    /// The next record; `None` at the end of the file, wherever that is.
    fn next_record(&mut self) -> Result<Option<Record<'static>>, SessionLogError> {
        loop {
            if let Some(record) = self.chunk.pop_front() {
                return Ok(Some(record));
            }
            if self.over {
                return Ok(None);
            }
            match self.mcap.next_event() {
                None | Some(Err(McapError::UnexpectedEof)) => self.over = true,
                Some(Err(error)) => return Err(SessionLogError::mcap(&self.path)(error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    // In pieces: a damaged length asks for more than there is.
                    let piece = self.mcap.insert(wanted.min(PIECE));
                    let read = self.file.read(piece).map_err(SessionLogError::io(&self.path))?;
                    self.mcap.notify_read(read);
                }
                // Only these are of interest. (mcap 0.25 panics on some damaged attachments.)
                Some(Ok(LinearReadEvent::Record { opcode, data })) if KNOWN.contains(&opcode) => {
                    let record = mcap::parse_record(opcode, data).map_err(SessionLogError::mcap(&self.path))?;
                    match record.into_owned() {
                        Record::Chunk { header, data } => {
                            self.chunk = in_chunk(&header, &data).map_err(SessionLogError::mcap(&self.path))?;
                        }
                        record => return Ok(Some(record)),
                    }
                }
                Some(Ok(LinearReadEvent::Record { .. })) => {}
            }
        }
    }

    /// The next event and its times; `None` at the end.
    ///
    /// # Errors
    /// [`SessionLogError`]. A file that just ends is none; see [`Reader::is_whole`].
    pub fn next_event(&mut self) -> Result<Option<(Times, Event)>, SessionLogError> {
        while let Some(record) = self.next_record()? {
            match record {
                Record::Channel(channel) => self.announce(channel),
                Record::DataEnd(_) => self.whole = true,
                Record::Message { header, data } => {
                    let Some(topic) = self.topics.get(&header.channel_id).cloned() else {
                        let found = header.channel_id.to_string();
                        return Err(self.field("channel of a message", &found, "one announced before"));
                    };
                    let times = Times {
                        host: Duration::from_nanos(header.log_time).saturating_sub(self.begun),
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

    /// What is on `topic`; `None` for a topic of somebody else.
    fn event(&mut self, topic: &str, sequence: u32, data: &[u8]) -> Result<Option<Event>, SessionLogError> {
        let (last, sizes) = (&mut self.last_images, self.sizes);
        let text = || String::from_utf8_lossy(data).into_owned();
        let event = match topic {
            OBSERVATION => decode(data)
                .and_then(|message: Observation| message.read(last, sizes))
                .map(|readings| Event::Observation(Box::new(readings))),
            ASKED => decode(data).and_then(|message: Command| message.read(sizes)).map(Event::Asked),
            SENT => decode(data).and_then(|message: Command| message.read(sizes)).map(Event::Sent),
            SEEN => {
                decode(data).and_then(|message: Seen| message.read()).map(|(object, pose)| Event::Seen(object, pose))
            }
            UNSEEN => Ok(Event::Unseen(text())),
            UNOBSERVED => Ok(Event::Unobserved(text())),
            UNSENT => Ok(Event::Unsent(text())),
            OUTCOME => Ok(Event::Outcome(data.to_owned())),
            TICK => decode(data).and_then(Tick::read).map(Event::Tick),
            _ => match raw_topic(topic) {
                Some((link, direction)) => Ok(Event::Raw { link: link.to_owned(), direction, bytes: data.to_owned() }),
                None => return Ok(None),
            },
        };
        event.map(Some).map_err(|(field, found, expected)| {
            SessionLogError::field(&self.path, &format!("{topic} {sequence}, {field}"), found, expected)
        })
    }
}

/// The records of interest in a chunk, once its checksum has been found right.
fn in_chunk(header: &ChunkHeader, mut data: &[u8]) -> McapResult<VecDeque<Record<'static>>> {
    if !header.compression.is_empty() {
        return Err(McapError::UnsupportedCompression(header.compression.clone()));
    }
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
        if IN_CHUNK.contains(&kind) {
            records.push_back(mcap::parse_record(kind, content)?.into_owned());
        }
        data = rest;
    }
    Ok(records)
}

fn decode<M: Message + Default>(data: &[u8]) -> Result<M, Wrong> {
    M::decode(data).map_err(|error| ("message", format!("{} bytes ({error})", data.len()), "its fields".to_owned()))
}

fn raw_topic(topic: &str) -> Option<(&str, Direction)> {
    let (link, way) = topic.strip_prefix("raw/")?.rsplit_once('/')?;
    match way {
        "sent" => Some((link, Direction::Sent)),
        "received" => Some((link, Direction::Received)),
        _ => None,
    }
}
