//! A session of an excitation, read back: what was measured and what was sent, tick by tick.

use std::path::Path;

use hand_model::digest::sha256;
use hand_model::robot::{Command, Observation, Robot, ServoGoal, ServoState, Tick};
use hand_model::{ACTUATORS, ARM_JOINTS, Hand};
use scenarios::individuals::file::Source;
use session_log::Reader;
use session_log::frames::{Frame, frames};

use crate::error::IdentificationError;
use crate::excitation::{NAME, Task};

/// A tick: what was measured at its beginning, and what was sent then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// s.
    pub time: f64,
    pub servos: [ServoState; ACTUATORS],
    /// rad.
    pub arm: [f64; ARM_JOINTS],
    pub goals: [ServoGoal; ACTUATORS],
}

/// A session's ticks.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    pub rows: Vec<Row>,
    /// Length of a tick, s.
    pub tick: f64,
    /// Where it comes from.
    pub source: Source,
    /// Whether the file was finished; one cut short has everything up to its last whole tick.
    pub whole: bool,
}

impl Trace {
    /// Reads a session of `hand`.
    pub fn read(path: &Path, hand: &Hand) -> Result<Self, IdentificationError> {
        let mut reader = Reader::open(path)?;
        let session = reader.session().clone();
        check_task(path, &session.task, hand)?;
        let (frames, _) = frames(&mut reader, 1)?;
        let row = |frame: &Frame| {
            let Frame { time, servos, arm, sent, .. } = frame;
            Row { time: *time, servos: *servos, arm: arm.position, goals: sent.servos }
        };
        let rows: Vec<Row> = frames.iter().map(row).collect();
        let seconds = seconds(&rows);
        let digest = std::fs::read(path).map(|bytes| sha256(&bytes));
        let source = Source {
            file: path.display().to_string(),
            sha256: digest.map_err(|source| IdentificationError::Io { path: path.into(), source })?,
            robot: session.robot,
            seconds,
        };
        Ok(Self { rows, tick: session.tick_length, source, whole: reader.is_whole() })
    }
}

/// A robot whose ticks are kept in memory instead of in a file.
pub struct Kept<R> {
    robot: R,
    observed: Option<Observation>,
    rows: Vec<Row>,
}

impl<R: Robot> Kept<R> {
    /// Around `robot`.
    pub fn new(robot: R) -> Self {
        Self { robot, observed: None, rows: Vec::new() }
    }

    /// What passed through it; `robot` is the body's kind.
    pub fn trace(self, robot: &str) -> Trace {
        let file = "kept in memory".to_owned();
        let source = Source { file, sha256: String::new(), robot: robot.to_owned(), seconds: seconds(&self.rows) };
        Trace { rows: self.rows, tick: self.robot.tick_length(), source, whole: true }
    }
}

/// From the first tick to the last, s.
fn seconds(rows: &[Row]) -> f64 {
    rows.last().zip(rows.first()).map_or(0.0, |(last, first)| last.time - first.time)
}

/// What is kept of a tick.
fn row(observation: &Observation, sent: &Command) -> Row {
    Row { time: observation.time, servos: observation.servos, arm: observation.arm.position, goals: sent.servos }
}

impl<R: Robot> Robot for Kept<R> {
    fn observe(&mut self) -> Observation {
        let observation = self.robot.observe();
        self.observed = Some(observation.clone());
        observation
    }

    fn send(&mut self, command: &Command) -> Command {
        let sent = self.robot.send(command);
        self.rows.extend(self.observed.take().map(|observation| row(&observation, &sent)));
        sent
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}

fn check_task(path: &Path, task: &[u8], hand: &Hand) -> Result<(), IdentificationError> {
    let fault = |field: &str, found: String, expected: String| {
        Err(IdentificationError::NotAnExcitation { path: path.into(), field: field.into(), found, expected })
    };
    let expected = || "a session of `ftac twin excite`".to_owned();
    let task: Task = match serde_json::from_slice(task) {
        Ok(task) => task,
        Err(_) if task.is_empty() => return fault("task", "none".into(), expected()),
        Err(_) => return fault("task", "that of another session".into(), expected()),
    };
    if task.task != NAME {
        return fault("task", format!("`{}`", task.task), format!("`{NAME}`"));
    }
    if task.hand != hand.parameters.name {
        return fault("task.hand", format!("`{}`", task.hand), format!("`{}`", hand.parameters.name));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::script::Script;

    #[test]
    fn a_session_of_something_else_is_refused() {
        let hand = Hand::ftac();
        let refused = |task: &[u8]| {
            check_task(Path::new("a.mcap"), task, &hand).map_or_else(|error| error.to_string(), |()| String::new())
        };
        let mut task = Task::new(&hand, &Script::standard(), 0);
        assert_eq!(refused(&serde_json::to_vec(&task).unwrap()), "");
        assert_eq!(refused(b""), "a.mcap: task: found none, expected a session of `ftac twin excite`");
        assert!(refused(b"{\"combination\": 3}").starts_with("a.mcap: task: found that of another session"));
        task.hand = "other".into();
        let words = refused(&serde_json::to_vec(&task).unwrap());
        assert_eq!(words, "a.mcap: task.hand: found `other`, expected `ftac`");
    }
}
