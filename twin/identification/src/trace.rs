//! Trace of an excitation, read from a session: measured and sent values, tick by tick.

use std::path::Path;

use ftac_platform::digest::sha256;
use hand_model::robot::{Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, Tick};
use hand_model::{ArmVector, RobotModel};
use plant::identified::SessionSource;
use robot_session_log::reader::SessionEvent;
use robot_session_log::{RobotSizes, SessionReader};

use crate::ball::CalibrationBall;
use crate::error::IdentificationError;
use crate::payload_calibration::first_stand_row;
use crate::script::ExcitationScript;
use crate::task::{IdentificationTask, TASK_NAME};
use crate::tick_record::{PayloadRow, TickRecord};
use crate::touches::{PressImage, PressImages, SnapshotTimes};

/// Data of a robot in a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// All ticks but those of payload calibration.
    pub rows: Vec<TickRecord>,
    /// Images of pressed pads.
    pub pressed: Vec<PressImage>,
    /// Snapshots: times at which images of the pads were taken.
    pub snapshots: Vec<SnapshotTimes>,
    /// Ball on which pads were pressed, if any.
    pub ball: Option<CalibrationBall>,
    /// Payload, if any.
    pub payload_rows: Option<PayloadRow>,
    /// Length of a tick, s.
    pub tick: f64,
    /// Source of the data.
    pub source: SessionSource,
    /// True if the file was finished. A file that was cut short has everything up to its last whole tick.
    pub is_complete: bool,
}

impl Trace {
    /// Reads a session of `robot`.
    pub fn read(path: &Path, robot: &RobotModel) -> Result<Self, IdentificationError> {
        let mut reader = SessionReader::open(path, RobotSizes::from_robot(robot))?;
        let session = reader.session().clone();
        let task = check_task(path, &session.task, robot)?;
        let mut ticks = RecordedTicks::default();
        while let Some((_, event)) = reader.next_event()? {
            match event {
                SessionEvent::Observation(readings) => {
                    if let Ok(observation) = readings.into_observation() {
                        ticks.observed(&observation);
                    }
                }
                SessionEvent::SentCommand(sent) => ticks.sent(&sent),
                _ => {}
            }
        }
        let digest = std::fs::read(path).map(|bytes| sha256(&bytes));
        let source = SessionSource {
            file: path.display().to_string(),
            sha256: digest.map_err(|source| IdentificationError::Io { path: path.into(), source })?,
            robot: session.robot,
            seconds: row_duration(&ticks.rows),
        };
        let (pressed, looks) = ticks.images.into_all();
        let (rows, weighed) = split_payload_rows(ticks.rows, &task.script, robot.arm.home, session.tick_length);
        Ok(Self {
            rows,
            pressed,
            snapshots: looks,
            ball: task.script.ball,
            payload_rows: weighed,
            tick: session.tick_length,
            source,
            is_complete: reader.is_finished(),
        })
    }
}

/// Ticks of a session that are kept.
#[derive(Default)]
struct RecordedTicks {
    observed: Option<TickRecord>,
    rows: Vec<TickRecord>,
    images: PressImages,
}

impl RecordedTicks {
    fn observed(&mut self, observation: &Observation) {
        self.images.add_observation(observation);
        let goals = observation.servos.iter().map(|_| ServoGoal::default()).collect();
        self.observed =
            Some(TickRecord { time: observation.time, servos: observation.servos, arm: observation.arm, goals });
    }

    fn sent(&mut self, sent: &RobotCommand) {
        self.rows.extend(self.observed.take().map(|row| TickRecord { goals: sent.servos, ..row }));
    }
}

/// Robot wrapper that keeps its ticks in memory instead of in a file.
pub struct TraceRecorder<R> {
    robot: R,
    ticks: RecordedTicks,
}

impl<R: RobotBackend> TraceRecorder<R> {
    /// Wraps `robot`.
    pub fn new(robot: R) -> Self {
        Self { robot, ticks: RecordedTicks::default() }
    }

    /// Returns the trace of everything that passed through the wrapper under `script`, for a robot of this `kind`.
    pub fn trace(self, robot: &RobotModel, kind: &str, script: &ExcitationScript) -> Trace {
        let RecordedTicks { rows, images, .. } = self.ticks;
        let (pressed, looks) = images.into_all();
        let file = "kept in memory".to_owned();
        let source =
            SessionSource { file, sha256: String::new(), robot: kind.to_owned(), seconds: row_duration(&rows) };
        let (ball, tick) = (script.ball.clone(), self.robot.tick_length());
        let (rows, weighed) = split_payload_rows(rows, script, robot.arm.home, tick);
        Trace { rows, pressed, snapshots: looks, ball, payload_rows: weighed, tick, source, is_complete: true }
    }
}

/// Splits the ticks into those before payload calibration and those of it. Its postures are relative to the posture
/// `ready` (rad).
fn split_payload_rows(
    mut rows: Vec<TickRecord>,
    script: &ExcitationScript,
    ready: ArmVector,
    tick: f64,
) -> (Vec<TickRecord>, Option<PayloadRow>) {
    let Some(weight) = &script.payload else { return (rows, None) };
    let Some(begin) = first_stand_row(&rows, weight, &ready, tick) else { return (rows, None) };
    let weighed = rows.split_off(begin);
    (rows, Some(PayloadRow { payload: weight.clone(), ready, rows: weighed }))
}

/// Returns the time from the first tick to the last, s.
fn row_duration(rows: &[TickRecord]) -> f64 {
    rows.last().zip(rows.first()).map_or(0.0, |(last, first)| last.time - first.time)
}

impl<R: RobotBackend> RobotBackend for TraceRecorder<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let readings = self.robot.observe()?;
        if let Ok(observation) = readings.clone().into_observation() {
            self.ticks.observed(&observation);
        }
        Ok(readings)
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
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

fn check_task(path: &Path, task: &[u8], robot: &RobotModel) -> Result<IdentificationTask, IdentificationError> {
    let fault = |field: &str, found: String, expected: String| {
        Err(IdentificationError::NotAnExcitation { path: path.into(), field: field.into(), found, expected })
    };
    let expected = || "a session of `ftac sysid excite`".to_owned();
    let task: IdentificationTask = match serde_json::from_slice(task) {
        Ok(task) => task,
        Err(_) if task.is_empty() => return fault("task", "none".into(), expected()),
        Err(_) => return fault("task", "that of another session".into(), expected()),
    };
    if task.task != TASK_NAME {
        return fault("task", format!("`{}`", task.task), format!("`{TASK_NAME}`"));
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
        let mut task = IdentificationTask::new(
            &robot.hand,
            &ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid"),
            0,
        );
        assert_eq!(refused(&serde_json::to_vec(&task).unwrap()), "");
        assert_eq!(refused(b""), "a.mcap: task: found none, expected a session of `ftac sysid excite`");
        assert!(refused(b"{\"combination\": 3}").starts_with("a.mcap: task: found that of another session"));
        task.hand = "other".into();
        let words = refused(&serde_json::to_vec(&task).unwrap());
        assert_eq!(words, "a.mcap: task.hand: found `other`, expected `ftac`");
    }
}
