//! A recorded session as a robot backend, on which the control stack runs again.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::{Result, anyhow};
use control::detection::PoseDetection;
use ftac_platform::data::DataError;
use hand_model::robot::RobotBackend;
use robot_session_log::replay::{ReplayDifference, ReplayProgress};
use robot_session_log::{Replay, RobotSizes, SessionEvent, SessionHeader, SessionReader};
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

use super::{
    BackendFactory, Detection, DetectionFailed, TrialBackend, TrialSetup, TrialStopped, TrialTask, pose_from_numbers,
};

/// Progress of a replay, and its difference from the recording if there was one.
pub type ReplayReport = Rc<Cell<Option<(ReplayProgress, Option<ReplayDifference>)>>>;

/// Shortest tick of a robot, s.
const MIN_TICK_LENGTH: f64 = 1e-4;

/// Reads the session at `path`, of `robot`, to its end. Returns its outcome, if it has one, and true if it was
/// finished.
///
/// # Errors
/// Fails for a session that cannot be read or replayed: one without ticks, or with poses and times that are not finite.
pub fn check_session(path: &Path, robot: &hand_model::RobotModel) -> Result<(Option<Vec<u8>>, bool)> {
    let mut reader = SessionReader::open(path, RobotSizes::from_robot(robot))?;
    let tick = reader.session().tick_length;
    if tick < MIN_TICK_LENGTH {
        return Err(DataError::field(path, "tick_length_s", tick, format!("at least {MIN_TICK_LENGTH}")).into());
    }
    let mut outcome = None;
    while let Some((_, event)) = reader.next_event()? {
        let numbers: Vec<f64> = match event {
            SessionEvent::Observation(readings) => std::iter::once(readings.time)
                .chain(readings.servos.iter().flatten().map(|servo| servo.value.position))
                .chain(readings.arm.iter().flat_map(|arm| arm.value.position))
                .collect(),
            SessionEvent::Tick(tick) => vec![tick.time],
            SessionEvent::Detection(_, Some((pose, _))) => pose.to_vec(),
            SessionEvent::Outcome(text) => {
                outcome = Some(text);
                continue;
            }
            _ => continue,
        };
        if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(DataError::field(path, "measurements", number, "finite times, angles and poses").into());
        }
    }
    Ok((outcome, reader.is_finished()))
}

/// A recording in place of a robot. It delivers its report when dropped.
pub struct ReplayBackend {
    replay: Replay,
    report: ReplayReport,
}

impl TrialBackend for ReplayBackend {
    fn robot(&self) -> &dyn RobotBackend {
        &self.replay
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.replay
    }

    fn truth(&self) -> Option<GroundTruth> {
        None
    }

    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        match self.replay.detection(glance.object) {
            Some(Ok(seen)) => {
                Ok(seen.map(|(numbers, sigma)| PoseDetection { pose: pose_from_numbers(&numbers), sigma }))
            }
            Some(Err(why)) => Err(anyhow!(DetectionFailed(why))),
            None => Err(anyhow!(TrialStopped("the recording has no such detection".into()))),
        }
    }

    fn stop_reason(&self) -> Option<String> {
        self.replay.has_left_recording().then(|| "the recording ends here".to_owned())
    }
}

impl Drop for ReplayBackend {
    fn drop(&mut self) {
        self.report.set(Some((self.replay.progress(), self.replay.difference().cloned())));
    }
}

/// Source of one replay.
pub struct ReplayFactory {
    replay: Option<Replay>,
    report: ReplayReport,
    real: bool,
}

impl ReplayFactory {
    /// Creates the source for `replay`; `real` is true for a real robot. The report is filled in once the trial is
    /// over.
    pub fn new(replay: Replay, real: bool) -> (Self, ReplayReport) {
        let report = ReplayReport::default();
        (Self { replay: Some(replay), report: report.clone(), real }, report)
    }
}

impl BackendFactory for ReplayFactory {
    fn open(&mut self, _: &TrialSetup, _: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        let replay = self.replay.take().ok_or_else(|| anyhow!("a recording is one trial"))?;
        Ok(Box::new(ReplayBackend { replay, report: self.report.clone() }))
    }

    fn session(&self, _: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(None)
    }

    fn is_real(&self) -> bool {
        self.real
    }
}
