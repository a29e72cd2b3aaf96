//! A recorded session as a body, on which the control stack runs again.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::{Result, anyhow};
use control::percept::Sighted;
use ftac_platform::data::DataError;
use hand_model::robot::RobotBackend;
use robot_session_log::replay::{Divergence, Progress};
use robot_session_log::{Event, Reader, Replay, Session, Sizes};
use sim::SimulatedRobot;
use sim::robot::Truth;

use super::{BodySource, Glance, LookFailed, Stopped, Task, TrialBody, TrialSetup, pose};

/// Progress of a replay, and its divergence from the recording if there was one.
pub type Report = Rc<Cell<Option<(Progress, Option<Divergence>)>>>;

/// Shortest tick of a robot, s.
const LEAST_TICK: f64 = 1e-4;

/// Reads the session at `path`, of `robot`, to its end. Returns its outcome, if it has one, and true if it was
/// finished.
///
/// # Errors
/// Fails for a session that cannot be read or replayed: one without ticks, or with poses and times that are not finite.
pub fn check(path: &Path, robot: &hand_model::RobotModel) -> Result<(Option<Vec<u8>>, bool)> {
    let mut reader = Reader::open(path, Sizes::of(robot))?;
    let tick = reader.session().tick_length;
    if tick < LEAST_TICK {
        return Err(DataError::field(path, "tick_length_s", tick, format!("at least {LEAST_TICK}")).into());
    }
    let mut outcome = None;
    while let Some((_, event)) = reader.next_event()? {
        let numbers: Vec<f64> = match event {
            Event::Observation(readings) => std::iter::once(readings.time)
                .chain(readings.servos.iter().flatten().map(|servo| servo.value.position))
                .chain(readings.arm.iter().flat_map(|arm| arm.value.position))
                .collect(),
            Event::Tick(tick) => vec![tick.time],
            Event::Seen(_, Some((pose, _))) => pose.to_vec(),
            Event::Outcome(text) => {
                outcome = Some(text);
                continue;
            }
            _ => continue,
        };
        if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(DataError::field(path, "what was measured", number, "finite times, angles and poses").into());
        }
    }
    Ok((outcome, reader.is_whole()))
}

/// A recording in place of a robot. It reports when dropped.
pub struct Replayed {
    replay: Replay,
    report: Report,
}

impl TrialBody for Replayed {
    fn robot(&self) -> &dyn RobotBackend {
        &self.replay
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.replay
    }

    fn truth(&self) -> Option<Truth> {
        None
    }

    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        match self.replay.seen(glance.object) {
            Some(Ok(seen)) => Ok(seen.map(|(numbers, sigma)| Sighted { pose: pose(&numbers), sigma })),
            Some(Err(why)) => Err(anyhow!(LookFailed(why))),
            None => Err(anyhow!(Stopped("the recording says nothing of it".into()))),
        }
    }

    fn stopped(&self) -> Option<String> {
        self.replay.is_left().then(|| "the recording ends here".to_owned())
    }
}

impl Drop for Replayed {
    fn drop(&mut self) {
        self.report.set(Some((self.replay.progress(), self.replay.divergence().cloned())));
    }
}

/// Source of one replay.
pub struct ReplaySource {
    replay: Option<Replay>,
    report: Report,
    real: bool,
}

impl ReplaySource {
    /// Creates the source for `replay`; `real` is true for a real robot. The report is filled in once the trial is
    /// over.
    pub fn new(replay: Replay, real: bool) -> (Self, Report) {
        let report = Report::default();
        (Self { replay: Some(replay), report: report.clone(), real }, report)
    }
}

impl BodySource for ReplaySource {
    fn open(&mut self, _: &TrialSetup, _: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        let replay = self.replay.take().ok_or_else(|| anyhow!("a recording is one trial"))?;
        Ok(Box::new(Replayed { replay, report: self.report.clone() }))
    }

    fn session(&self, _: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(None)
    }

    fn is_real(&self) -> bool {
        self.real
    }
}
