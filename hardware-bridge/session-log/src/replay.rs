//! A robot that replays a recorded session.
//!
//! The control stack is a function of its observations. Driven by a replay, it must send the recorded commands in the
//! recorded order, bit by bit; the replay keeps the first difference. After a difference, or after the end of the
//! recording, it repeats the last observation while time advances, so that a waiting controller gives up by its own
//! rules.

use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, Tick};

use crate::error::SessionLogError;
use crate::message::{DetectedPose, command_bits};
use crate::reader::{SessionEvent, SessionReader};

/// The first difference between controller and recording.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReplayDifference {
    /// The controller called another function.
    #[error("tick {tick}: the recording goes on with {recorded}, the controller with {found}")]
    Order {
        /// Ticks replayed so far.
        tick: u64,
        /// Recorded call.
        recorded: &'static str,
        /// Call that the controller made.
        found: &'static str,
    },
    /// The controller sent another command, or asked for the pose of another object.
    #[error("tick {tick}: {field} is {found}, recorded as {recorded}")]
    Command {
        /// Ticks replayed so far.
        tick: u64,
        /// First field that differs.
        field: String,
        /// Recorded value.
        recorded: String,
        /// The controller's value.
        found: String,
    },
}

/// Part of a recording that the controller has repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReplayProgress {
    /// Ticks replayed.
    pub ticks: u64,
    /// Commands found identical.
    pub commands: u64,
}

/// A recorded session as a robot.
///
/// The crate's first example replays a session.
pub struct Replay {
    reader: SessionReader,
    next: Option<SessionEvent>,
    readings: Readings,
    tick: Tick,
    progress: ReplayProgress,
    difference: Option<ReplayDifference>,
    /// True if the controller went on after a difference or after the end of the recording.
    ran_past_end: bool,
    error: Option<SessionLogError>,
}

impl Replay {
    /// Starts at the beginning of a session.
    ///
    /// # Errors
    /// [`SessionLogError`].
    pub fn new(reader: SessionReader) -> Result<Self, SessionLogError> {
        let mut replay = Self {
            reader,
            next: None,
            readings: Readings::default(),
            tick: Tick::default(),
            progress: ReplayProgress::default(),
            difference: None,
            ran_past_end: false,
            error: None,
        };
        replay.read_next();
        match replay.error.take() {
            Some(error) => Err(error),
            None => Ok(replay),
        }
    }

    /// Returns the reader of the recorded session.
    pub fn reader(&self) -> &SessionReader {
        &self.reader
    }

    /// Returns the progress so far.
    pub fn progress(&self) -> ReplayProgress {
        self.progress
    }

    /// True if the recording has ended or the controller has diverged from it.
    pub fn has_ended(&self) -> bool {
        self.next.is_none() || self.difference.is_some()
    }

    /// True if the controller has diverged from the recording, or went on after its end.
    pub fn has_left_recording(&self) -> bool {
        self.difference.is_some() || self.ran_past_end
    }

    /// Returns the first difference, if any.
    pub fn difference(&self) -> Option<&ReplayDifference> {
        self.difference.as_ref()
    }

    /// Returns the final progress, and the first difference, if any.
    ///
    /// # Errors
    /// The file could not be read to its end. (A file that was cut short is not an error: see
    /// [`SessionReader::is_finished`].)
    pub fn finish(self) -> Result<(ReplayProgress, Option<ReplayDifference>), SessionLogError> {
        match self.error {
            Some(error) => Err(error),
            None => Ok((self.progress, self.difference)),
        }
    }

    /// Fetches the next event other than raw bytes and the outcome.
    fn read_next(&mut self) {
        self.next = loop {
            match self.reader.next_event() {
                Ok(Some((_, SessionEvent::Raw { .. } | SessionEvent::Outcome(_)))) => {}
                Ok(event) => break event.map(|(_, event)| event),
                Err(error) => {
                    self.error = Some(error);
                    break None;
                }
            }
        };
    }

    /// Takes the next event if `pick` accepts it. Otherwise the controller, whose call is `found`, has diverged.
    fn take_event<T>(&mut self, found: &'static str, pick: fn(&SessionEvent) -> Option<T>) -> Option<T> {
        if self.has_ended() {
            self.ran_past_end = true;
            return None;
        }
        let event = self.next.as_ref()?;
        let taken = pick(event);
        if taken.is_some() {
            self.read_next();
        } else {
            let recorded = match event {
                SessionEvent::Observation(_) | SessionEvent::ObservationFailed(_) => "an observation",
                SessionEvent::RequestedCommand(_) | SessionEvent::SentCommand(_) | SessionEvent::SendFailed(_) => {
                    "a command"
                }
                SessionEvent::Tick(_) => "a tick",
                SessionEvent::Detection(..) | SessionEvent::DetectionFailed(_) => "a detection of an object",
                SessionEvent::Raw { .. } => "bytes",
                SessionEvent::Outcome(_) => "the outcome",
            };
            self.difference = Some(ReplayDifference::Order { tick: self.progress.ticks, recorded, found });
        }
        taken
    }

    /// Returns the recorded result of prior perception for `object`: its pose, `None` if the object was not visible, or
    /// the reason why prior perception failed. The outer `None` means that the controller has diverged or the recording
    /// has ended.
    pub fn detection(&mut self, object: usize) -> Option<Result<Option<DetectedPose>, String>> {
        let taken = self.take_event("a detection of an object", |event| match event {
            SessionEvent::Detection(object, pose) => Some(Ok((*object, *pose))),
            SessionEvent::DetectionFailed(why) => Some(Err(why.clone())),
            _ => None,
        })?;
        let (recorded, pose) = match taken {
            Ok(seen) => seen,
            Err(why) => return Some(Err(why)),
        };
        if recorded != object {
            self.difference = Some(ReplayDifference::Command {
                tick: self.progress.ticks,
                field: "object of the detection".to_owned(),
                recorded: recorded.to_string(),
                found: object.to_string(),
            });
            return None;
        }
        Some(Ok(pose))
    }

    fn compare(&mut self, recorded: &RobotCommand, found: &RobotCommand) {
        let (recorded, found) = (command_bits(recorded), command_bits(found));
        let show = |field: &str, bits: u64| match field {
            "capture" => (bits != 0).to_string(),
            _ => format!("{:?} ({bits:016x})", f64::from_bits(bits)),
        };
        let tick = self.progress.ticks;
        let differs = recorded.iter().zip(&found).find(|(a, b)| a != b);
        self.difference = match differs {
            None => {
                self.progress.commands += 1;
                return;
            }
            Some(((field, a), (same, b))) if field == same => Some(ReplayDifference::Command {
                tick,
                field: field.clone(),
                recorded: show(field, *a),
                found: show(field, *b),
            }),
            // Another mode of a servo has other fields.
            Some(((recorded, _), (found, _))) => Some(ReplayDifference::Command {
                tick,
                field: "kind of goal".to_owned(),
                recorded: recorded.clone(),
                found: found.clone(),
            }),
        };
    }
}

impl RobotBackend for Replay {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let recorded = self.take_event("an observation", |event| match event {
            SessionEvent::Observation(readings) => Some(Ok((**readings).clone())),
            SessionEvent::ObservationFailed(why) => Some(Err(RobotError::ConnectionLost(why.clone()))),
            _ => None,
        });
        match recorded {
            Some(readings) => self.readings = readings?,
            None => {
                self.readings.time = self.tick.time;
                self.readings.tactile.clear();
            }
        }
        Ok(self.readings.clone())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        let asked = self.take_event("a command", |event| match event {
            SessionEvent::RequestedCommand(asked) => Some(*asked),
            _ => None,
        });
        let Some(asked) = asked else { return Ok(*command) };
        self.compare(&asked, command);
        // A recording may end between the requested command and the one sent.
        let sent = match &self.next {
            Some(SessionEvent::SentCommand(sent)) => Ok(*sent),
            Some(SessionEvent::SendFailed(why)) => Err(RobotError::ConnectionLost(why.clone())),
            _ => return Ok(*command),
        };
        self.read_next();
        sent
    }

    fn wait_for_tick(&mut self) -> Tick {
        let recorded = self.take_event("a tick", |event| match event {
            SessionEvent::Tick(tick) => Some(*tick),
            _ => None,
        });
        self.tick = match recorded {
            Some(tick) => {
                self.progress.ticks += 1;
                tick
            }
            None => Tick { time: self.tick.time + self.tick_length(), lateness: 0.0 },
        };
        self.tick
    }

    fn tick_length(&self) -> f64 {
        self.reader.session().tick_length
    }
}
