//! The bodies on which a trial can be played.
//!
//! The simulated robot can be cloned: trials branch on it, and each branch goes its own way. No other body can be cloned ([`SingleBody`]): the
//! emulated devices with a plant behind them ([`emulated`]), the real robot ([`hardware`]), a recorded session ([`replayed`]), and the simulated robot
//! when its session is recorded. For those every condition begins a trial of its own, and a clone is the same body.
//!
//! [`Body`] is what the trial loop holds. The controller gets no more of it than [`RobotBackend`]; what a trial needs beside (the referee's truth, prior
//! perception, the operator) is in [`TrialBody`], for the program alone.

pub mod arm_link;
pub mod disk;
pub mod emulated;
pub mod hardware;
pub mod operator;
pub mod replayed;
pub mod rounded;
mod task;

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

use anyhow::{Result, anyhow};
use control::percept::Sighted;
use hand_model::robot::{Command, Readings, RobotBackend, RobotError, Tick};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use scenarios::noise::ObjectNoise;
use scenarios::record::TrialRecord;
use scenarios::referee::Verdict;
use session_log::{Recorder, Session, Writer};
use sim::SimulatedRobot;
use sim::robot::Truth;

pub use self::task::{Places, Task};

/// Why a trial ended before its end; the body holds what it holds.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// A recorded look that failed, and why.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub struct LookFailed(pub String);

/// A look of prior perception.
#[derive(Debug, Clone, Copy)]
pub struct Glance {
    /// Number of the object.
    pub object: usize,
    /// Its error.
    pub noise: ObjectNoise,
    /// Where the object was when the frame was taken; `None` is where it is.
    pub then: Option<Isometry3<f64>>,
    /// Where the camera is, m, world; `None` sees everything.
    pub camera: Option<Point3<f64>>,
}

/// What a trial needs of a body beside what a controller may know.
pub trait TrialBody {
    /// What a controller may know of it.
    fn robot(&self) -> &dyn RobotBackend;
    /// The same, to be driven.
    fn robot_mut(&mut self) -> &mut dyn RobotBackend;
    /// The truth, where somebody knows it: for referee and recording only.
    fn truth(&self) -> Option<Truth>;
    /// What prior perception says of an object now, or nothing if it is hidden.
    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>>;
    /// Why it no longer follows commands, and what to do about it.
    fn stopped(&self) -> Option<String> {
        None
    }
    /// Stops it where it is; it holds what it holds.
    fn hold(&mut self) {}
    /// The controller is about to think: no command comes until it has done so.
    fn pause(&mut self) {}
    /// The trial is over, or was stopped for this reason: whatever is to be done with what the hand holds.
    fn leave(&mut self, _why: Option<&str>) -> Result<()> {
        Ok(())
    }
    /// What it says of its own running, for the record.
    fn statistics(&self) -> Option<serde_json::Value> {
        None
    }
    /// The verdict, where not the referee judges.
    fn judge(&mut self) -> Result<Option<Verdict>> {
        Ok(None)
    }
}

/// The one place where a body's robot is driven through the body.
impl RobotBackend for dyn TrialBody + '_ {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        self.robot_mut().observe()
    }

    fn send(&mut self, command: &Command) -> Result<Command, RobotError> {
        self.robot_mut().send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot_mut().wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot().tick_length()
    }
}

impl TrialBody for SimulatedRobot {
    fn robot(&self) -> &dyn RobotBackend {
        self
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        self
    }

    fn truth(&self) -> Option<Truth> {
        Some(self.truth())
    }

    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        let Glance { object, noise, then, camera } = glance;
        let pose = then.unwrap_or_else(|| self.truth().objects[*object]);
        let center = Point3::from(pose.translation.vector);
        let seen = camera.is_none_or(|camera| self.sees(&camera, *object, &center));
        Ok(seen.then(|| noise.perceived(&pose).into()))
    }
}

/// A trial about to begin.
pub struct TrialSetup<'a> {
    /// What it is.
    pub task: &'a Task,
    /// The objects' names and where they belong: `world_from_object`.
    pub objects: Vec<(&'a str, Isometry3<f64>)>,
}

/// Where bodies come from that cannot be cloned.
pub trait BodySource {
    /// A body for a trial; `scene` is the simulated robot in the trial's scene, for those that make use of it.
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBody>>;
    /// The session's file for the trial, if it is recorded, with configuration and calibration as far as known.
    fn session(&self, task: &Task) -> Result<Option<(PathBuf, Session)>>;
    /// Packets of tapped links, if there are any: asked once after each [`BodySource::open`].
    fn packets(&mut self) -> Option<std::sync::mpsc::Receiver<session_log::Packet>> {
        None
    }
    /// Whether objects are where noise-free layout says, because somebody puts them there, rather than where the trial's draw says.
    fn is_real(&self) -> bool {
        false
    }
}

enum Wrapped {
    Plain(Box<dyn TrialBody>),
    Recorded(Box<Recorder<Box<dyn TrialBody>>>),
}

/// A body that cannot be cloned.
pub struct SingleBody {
    line: Option<Wrapped>,
    time: f64,
}

/// The body of a trial.
#[derive(Clone)]
pub enum Body {
    /// In simulation: a clone is another body in the same state.
    Simulated(Box<SimulatedRobot>),
    /// Any other: a clone is the same body.
    Single(Rc<RefCell<SingleBody>>),
}

impl Body {
    /// A body that cannot be cloned. from `source`; its session is recorded if the source says where.
    pub fn open(source: &mut dyn BodySource, setup: &TrialSetup, scene: SimulatedRobot, version: &str) -> Result<Self> {
        let mut body = source.open(setup, scene)?;
        let opened = source.session(setup.task).and_then(|session| {
            session
                .map(|(path, session)| {
                    let session = Session {
                        robot: setup.task.robot.clone(),
                        program: format!("ftac {version}"),
                        seed: setup.task.seed,
                        tick_length: body.tick_length(),
                        task: serde_json::to_vec(setup.task)?,
                        ..session
                    };
                    Ok(Writer::create(&path, &session)?)
                })
                .transpose()
        });
        let line = match opened {
            Err(error) => {
                // It is armed: nobody leaves it so without a word.
                body.leave(Some(&format!("{error:#}")))?;
                return Err(error);
            }
            Ok(None) => Wrapped::Plain(body),
            Ok(Some(writer)) => {
                let recorder = Recorder::new(body, writer);
                Wrapped::Recorded(Box::new(match source.packets() {
                    Some(packets) => recorder.with_packets(packets),
                    None => recorder,
                }))
            }
        };
        Ok(Self::Single(Rc::new(RefCell::new(SingleBody { line: Some(line), time: 0.0 }))))
    }

    /// Whether a clone is a body of its own.
    pub fn branches(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }

    /// Time of the newest tick, s.
    pub fn time(&self) -> f64 {
        match self {
            Self::Simulated(robot) => robot.time(),
            Self::Single(single) => single.borrow().time,
        }
    }

    /// See [`TrialBody::truth`].
    pub fn truth(&self) -> Option<Truth> {
        match self {
            Self::Simulated(robot) => Some(robot.truth()),
            Self::Single(single) => single.borrow_mut().body().and_then(|body| body.truth()),
        }
    }

    /// See [`TrialBody::look`]. A recorded session keeps it.
    pub fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        match self {
            Self::Simulated(robot) => TrialBody::look(robot.as_mut(), glance),
            Self::Single(single) => {
                let mut single = single.borrow_mut();
                let seen = single.body().ok_or_else(|| anyhow!("the trial is over"))?.look(glance);
                if let Some(Wrapped::Recorded(recorder)) = &mut single.line {
                    match &seen {
                        Ok(seen) => {
                            let seen = seen.as_ref().map(|seen| (numbers(&seen.pose), seen.sigma));
                            recorder.seen(glance.object, seen.as_ref());
                        }
                        // Who stopped it did so whatever would have been seen.
                        Err(error) if error.is::<Stopped>() => {}
                        Err(error) => recorder.unseen(&format!("{error:#}")),
                    }
                }
                seen
            }
        }
    }

    /// Whether its session, if it has one, can still be written.
    pub fn is_written(&self) -> bool {
        match self {
            Self::Simulated(_) => true,
            Self::Single(single) => single.borrow().unwritten().is_none(),
        }
    }

    /// See [`TrialBody::stopped`].
    pub fn stopped(&self) -> Option<String> {
        match self {
            Self::Simulated(_) => None,
            Self::Single(single) => {
                let mut single = single.borrow_mut();
                let unwritten = single.unwritten();
                let body = single.body()?;
                if let Some(error) = unwritten {
                    body.hold();
                    return Some(format!("hold: the session cannot be written any more ({error}); make room"));
                }
                body.stopped()
            }
        }
    }

    /// See [`TrialBody::pause`].
    pub fn pause(&mut self) {
        if let Self::Single(single) = self
            && let Some(body) = single.borrow_mut().body()
        {
            body.pause();
        }
    }

    /// See [`TrialBody::judge`].
    pub fn judge(&mut self) -> Result<Option<Verdict>> {
        match self {
            Self::Simulated(_) => Ok(None),
            Self::Single(single) => single.borrow_mut().body().map_or(Ok(None), |body| body.judge()),
        }
    }

    /// The trial is over: notes what came of it (nothing, if it was stopped for the reason `why`), finishes its recording, and parts from
    /// the body.
    pub fn finish(&mut self, record: Option<&TrialRecord>, why: Option<&str>) -> Result<()> {
        let Self::Single(single) = self else { return Ok(()) };
        let left = single.borrow_mut().body().map_or(Ok(()), |body| body.leave(why));
        if let Some(Wrapped::Recorded(mut recorder)) = single.borrow_mut().line.take() {
            if let Some(statistics) = recorder.robot().statistics() {
                recorder.statistics(&serde_json::to_vec(&statistics)?);
            }
            if let Some(record) = record {
                recorder.outcome(&serde_json::to_vec(record)?);
            }
            let (body, written) = recorder.finish();
            drop(body);
            written?;
        }
        left
    }
}

impl SingleBody {
    /// Why its session cannot be written any more.
    fn unwritten(&self) -> Option<String> {
        match &self.line {
            Some(Wrapped::Recorded(recorder)) => recorder.error().map(ToString::to_string),
            _ => None,
        }
    }

    fn body(&mut self) -> Option<&mut Box<dyn TrialBody>> {
        self.line.as_mut().map(|line| match line {
            Wrapped::Plain(body) => body,
            Wrapped::Recorded(recorder) => recorder.robot(),
        })
    }

    fn robot(&mut self) -> Option<&mut dyn RobotBackend> {
        self.line.as_mut().map(|line| match line {
            Wrapped::Plain(body) => body as &mut dyn RobotBackend,
            Wrapped::Recorded(recorder) => recorder.as_mut() as &mut dyn RobotBackend,
        })
    }
}

impl RobotBackend for Body {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        match self {
            Self::Simulated(robot) => robot.observe(),
            Self::Single(single) => single.borrow_mut().robot().ok_or_else(over)?.observe(),
        }
    }

    fn send(&mut self, command: &Command) -> Result<Command, RobotError> {
        match self {
            Self::Simulated(robot) => robot.send(command),
            Self::Single(single) => single.borrow_mut().robot().ok_or_else(over)?.send(command),
        }
    }

    fn wait_for_tick(&mut self) -> Tick {
        match self {
            Self::Simulated(robot) => robot.wait_for_tick(),
            Self::Single(single) => {
                let mut single = single.borrow_mut();
                let tick = single.robot().map(RobotBackend::wait_for_tick).unwrap_or_default();
                single.time = tick.time;
                tick
            }
        }
    }

    fn tick_length(&self) -> f64 {
        match self {
            Self::Simulated(robot) => robot.tick_length(),
            Self::Single(single) => single.borrow_mut().robot().map_or(0.0, |robot| robot.tick_length()),
        }
    }
}

/// The error of a body that nothing is done with any more.
fn over() -> RobotError {
    RobotError::Lost("the trial is over".to_owned())
}

/// A pose as seven numbers: x, y, z, i, j, k, w.
pub fn numbers(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
}

/// The pose of seven numbers, bit by bit.
fn pose(numbers: &[f64; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = *numbers;
    // As it was written: normalising again would change bits.
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_keeps_its_bits() {
        let original = Isometry3::from_parts(
            Translation3::new(0.1, -0.2, 1e-17),
            UnitQuaternion::from_euler_angles(0.3, -1.1, 2.9),
        );
        assert_eq!(numbers(&pose(&numbers(&original))).map(f64::to_bits), numbers(&original).map(f64::to_bits));
    }
}
