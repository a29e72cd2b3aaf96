//! Trace of an excitation, read from a session: measured and sent values, tick by tick.

use std::path::Path;

use ftac_platform::digest::sha256;
use hand_model::robot::{Command, Observation, Readings, RobotBackend, RobotError, ServoGoal, Tick};
use hand_model::{ArmVector, RobotModel};
use plant::identified::Source;
use robot_session_log::reader::Event;
use robot_session_log::{Reader, Sizes};

use crate::ball::Ball;
use crate::error::IdentificationError;
use crate::row::{Row, Weighed};
use crate::script::Script;
use crate::task::{NAME, Task};
use crate::touches::{Look, PressImage, PressImages};
use crate::weighing::begin;

/// Data of a robot in a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// All ticks but those of weighing.
    pub rows: Vec<Row>,
    /// Images of pressed pads.
    pub pressed: Vec<PressImage>,
    /// Looks: times at which images of the pads were taken.
    pub looks: Vec<Look>,
    /// Ball on which pads were pressed, if any.
    pub ball: Option<Ball>,
    /// Weighed object, if any.
    pub weighed: Option<Weighed>,
    /// Length of a tick, s.
    pub tick: f64,
    /// Source of the data.
    pub source: Source,
    /// True if the file was finished. A file that was cut short has everything up to its last whole tick.
    pub whole: bool,
}

impl Trace {
    /// Reads a session of `robot`.
    pub fn read(path: &Path, robot: &RobotModel) -> Result<Self, IdentificationError> {
        let mut reader = Reader::open(path, Sizes::of(robot))?;
        let session = reader.session().clone();
        let task = check_task(path, &session.task, robot)?;
        let mut ticks = Ticks::default();
        while let Some((_, event)) = reader.next_event()? {
            match event {
                Event::Observation(readings) => {
                    if let Ok(observation) = readings.complete() {
                        ticks.observed(&observation);
                    }
                }
                Event::Sent(sent) => ticks.sent(&sent),
                _ => {}
            }
        }
        let digest = std::fs::read(path).map(|bytes| sha256(&bytes));
        let source = Source {
            file: path.display().to_string(),
            sha256: digest.map_err(|source| IdentificationError::Io { path: path.into(), source })?,
            robot: session.robot,
            seconds: seconds(&ticks.rows),
        };
        let (pressed, looks) = ticks.images.into_all();
        let (rows, weighed) = split(ticks.rows, &task.script, robot.arm.home, session.tick_length);
        Ok(Self {
            rows,
            pressed,
            looks,
            ball: task.script.ball,
            weighed,
            tick: session.tick_length,
            source,
            whole: reader.is_whole(),
        })
    }
}

/// Ticks of a session that are kept.
#[derive(Default)]
struct Ticks {
    observed: Option<Row>,
    rows: Vec<Row>,
    images: PressImages,
}

impl Ticks {
    fn observed(&mut self, observation: &Observation) {
        self.images.see(observation);
        let goals = observation.servos.iter().map(|_| ServoGoal::default()).collect();
        self.observed = Some(Row { time: observation.time, servos: observation.servos, arm: observation.arm, goals });
    }

    fn sent(&mut self, sent: &Command) {
        self.rows.extend(self.observed.take().map(|row| Row { goals: sent.servos, ..row }));
    }
}

/// A robot wrapper that keeps its ticks in memory instead of in a file.
pub struct Kept<R> {
    robot: R,
    ticks: Ticks,
}

impl<R: RobotBackend> Kept<R> {
    /// Wraps `robot`.
    pub fn new(robot: R) -> Self {
        Self { robot, ticks: Ticks::default() }
    }

    /// Returns the trace of everything that passed through the wrapper under `script`, for a robot of this `kind`.
    pub fn trace(self, robot: &RobotModel, kind: &str, script: &Script) -> Trace {
        let Ticks { rows, images, .. } = self.ticks;
        let (pressed, looks) = images.into_all();
        let file = "kept in memory".to_owned();
        let source = Source { file, sha256: String::new(), robot: kind.to_owned(), seconds: seconds(&rows) };
        let (ball, tick) = (script.ball.clone(), self.robot.tick_length());
        let (rows, weighed) = split(rows, script, robot.arm.home, tick);
        Trace { rows, pressed, looks, ball, weighed, tick, source, whole: true }
    }
}

/// Splits the ticks into those before weighing and those of weighing. The postures of weighing are relative to the
/// posture `ready` (rad).
fn split(mut rows: Vec<Row>, script: &Script, ready: ArmVector, tick: f64) -> (Vec<Row>, Option<Weighed>) {
    let Some(weight) = &script.weight else { return (rows, None) };
    let Some(begin) = begin(&rows, weight, &ready, tick) else { return (rows, None) };
    let weighed = rows.split_off(begin);
    (rows, Some(Weighed { weight: weight.clone(), ready, rows: weighed }))
}

/// Returns the time from the first tick to the last, s.
fn seconds(rows: &[Row]) -> f64 {
    rows.last().zip(rows.first()).map_or(0.0, |(last, first)| last.time - first.time)
}

impl<R: RobotBackend> RobotBackend for Kept<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let readings = self.robot.observe()?;
        if let Ok(observation) = readings.clone().complete() {
            self.ticks.observed(&observation);
        }
        Ok(readings)
    }

    fn send(&mut self, command: &Command) -> Result<Command, RobotError> {
        let sent = self.robot.send(command)?;
        self.ticks.sent(&sent);
        Ok(sent)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}

fn check_task(path: &Path, task: &[u8], robot: &RobotModel) -> Result<Task, IdentificationError> {
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
    if task.hand != robot.hand.parameters.name {
        return fault("task.hand", format!("`{}`", task.hand), format!("`{}`", robot.hand.parameters.name));
    }
    Ok(task)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_of_something_else_is_refused() {
        let robot = RobotModel::ftac_gen3();
        let refused = |task: &[u8]| {
            check_task(Path::new("a.mcap"), task, &robot).map_or_else(|error| error.to_string(), |_| String::new())
        };
        let mut task = Task::new(&robot.hand, &Script::standard(&RobotModel::ftac_gen3()).expect("valid"), 0);
        assert_eq!(refused(&serde_json::to_vec(&task).unwrap()), "");
        assert_eq!(refused(b""), "a.mcap: task: found none, expected a session of `ftac twin excite`");
        assert!(refused(b"{\"combination\": 3}").starts_with("a.mcap: task: found that of another session"));
        task.hand = "other".into();
        let words = refused(&serde_json::to_vec(&task).unwrap());
        assert_eq!(words, "a.mcap: task.hand: found `other`, expected `ftac`");
    }
}
