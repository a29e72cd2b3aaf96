//! Robot backends on which a trial can be run.
//!
//! The simulated robot can be cloned: trials branch on it, and each branch goes its own way. No other backend can be
//! cloned ([`SingleUseBackend`]): the emulated devices with a plant behind them ([`wire_emulation`]), the real robot
//! ([`hardware`]), also behind a driver of its owner ([`driver`]) and on ROS 2 topics ([`ros2`]), a recorded session ([`replay`]), and the simulated
//! robot if its session is recorded. On those, every condition begins a separate trial, and a clone is the same backend.
//!
//! [`Backend`] is the handle of the trial loop. The controller gets only the [`RobotBackend`] of it. The other needs of
//! a trial (ground truth for the referee, prior perception, the operator) are in [`TrialBackend`], for the program
//! alone. [`registration_plan`] hides the base of an emulated robot.

// Printed text may come from third parties: this `eprintln!` makes it printable.
#[macro_use]
extern crate progress;

pub mod arm_link;
pub mod direct_emulation;
pub mod disk;
pub mod driver;
pub mod hardware;
pub mod operator;
pub mod registration_plan;
pub mod replay;
pub mod ros2;
mod task;
pub mod validation;
pub mod wire_emulation;

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

use anyhow::{Result, anyhow};
use control::detection::PoseDetection;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, Tick};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use robot_session_log::{SessionHeader, SessionRecorder, SessionWriter};
use scenarios::noise::ObjectNoise;
use scenarios::record::TrialRecord;
use scenarios::referee::Verdict;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

pub use self::task::{DRIVER_BACKEND, HARDWARE_BACKEND, PoseSources, ROS2_BACKEND, TrialTask, keeps_wall_time};

/// Reason for which a trial ended early. The hand keeps its grip.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub struct TrialStopped(pub String);

/// Reason for which a recorded detection failed.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{0}")]
pub struct DetectionFailed(pub String);

/// A detection by prior perception.
#[derive(Debug, Clone, Copy)]
pub struct Detection {
    /// Number of the object.
    pub object: usize,
    /// Error of the detection.
    pub noise: ObjectNoise,
    /// Pose of the object when the frame was taken; `None` for its present pose.
    pub pose_at_capture: Option<Isometry3<f64>>,
    /// Position of the camera, world, m; `None` if nothing is hidden.
    pub camera_position: Option<Point3<f64>>,
}

/// A robot backend with everything that a trial needs in addition to the controller's interface.
pub trait TrialBackend {
    /// Returns the controller's interface.
    fn robot(&self) -> &dyn RobotBackend;
    /// Returns the controller's interface, to drive it.
    fn robot_mut(&mut self) -> &mut dyn RobotBackend;
    /// Returns the ground truth, if it is known: for referee and recording only.
    fn truth(&self) -> Option<GroundTruth>;
    /// Returns the detected pose of an object now, or `None` if it is hidden.
    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>>;
    /// Returns the reason for which the robot no longer follows commands, with advice.
    fn stop_reason(&self) -> Option<String> {
        None
    }
    /// Stops the robot where it is; the hand keeps its grip.
    fn hold(&mut self) {}
    /// Announces that the controller computes: no command comes until it has done so.
    fn pause(&mut self) {}
    /// Handles the content of the hand after the trial, or after a stop for the reason `why`.
    fn end_trial(&mut self, _why: Option<&str>) -> Result<()> {
        Ok(())
    }
    /// Returns statistics of the backend's operation, for the record.
    fn statistics(&self) -> Option<serde_json::Value> {
        None
    }
    /// Returns the verdict, if someone other than the referee judges.
    fn judge(&mut self) -> Result<Option<Verdict>> {
        Ok(None)
    }
}

/// The only place where the robot of a backend is driven through the backend.
impl RobotBackend for dyn TrialBackend + '_ {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        self.robot_mut().observe()
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.robot_mut().send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot_mut().wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot().tick_length()
    }
}

impl TrialBackend for SimulatedRobot {
    fn robot(&self) -> &dyn RobotBackend {
        self
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        self
    }

    fn truth(&self) -> Option<GroundTruth> {
        Some(self.truth())
    }

    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        let Detection { object, noise, pose_at_capture: then, camera_position: camera } = glance;
        let pose = then.unwrap_or_else(|| self.truth().objects[*object]);
        let center = Point3::from(pose.translation.vector);
        let seen = camera.is_none_or(|camera| self.is_visible(&camera, *object, &center));
        Ok(seen.then(|| noise.perceived_pose(&pose).into()))
    }
}

/// A trial about to begin.
pub struct TrialSetup<'a> {
    /// Task of the trial.
    pub task: &'a TrialTask,
    /// Names of the objects with their nominal poses, `world_from_object`.
    pub objects: Vec<(&'a str, Isometry3<f64>)>,
}

/// Source of backends that cannot be cloned.
pub trait BackendFactory {
    /// Opens a backend for a trial. `scene` is the simulated robot in the trial's scene, for the backends that use it.
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBackend>>;
    /// Returns the file of the trial's session, if it is recorded, with configuration and calibration as far as known.
    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>>;
    /// Returns the packets of tapped links, if there are any. Called once after each [`BackendFactory::open`].
    fn packets(&mut self) -> Option<std::sync::mpsc::Receiver<robot_session_log::LinkPacket>> {
        None
    }
    /// True if an operator places the objects at their nominal poses, so that the trial's draw of poses does not apply.
    fn is_real(&self) -> bool {
        false
    }
}

enum TrialRobot {
    Unrecorded(Box<dyn TrialBackend>),
    Recorded(Box<SessionRecorder<Box<dyn TrialBackend>>>),
}

/// A backend that cannot be cloned.
pub struct SingleUseBackend {
    robot: Option<TrialRobot>,
    time: f64,
}

/// Backend of a trial.
#[derive(Clone)]
pub enum Backend {
    /// Simulated: a clone is another backend in the same state.
    Simulated(Box<SimulatedRobot>),
    /// Any other: a clone is the same backend.
    Single(Rc<RefCell<SingleUseBackend>>),
}

impl Backend {
    /// Opens a backend that cannot be cloned from `source`. Its session is recorded if the source names a file.
    pub fn open(
        source: &mut dyn BackendFactory,
        setup: &TrialSetup,
        scene: SimulatedRobot,
        version: &str,
    ) -> Result<Self> {
        let mut body = source.open(setup, scene)?;
        let opened = source.session(setup.task).and_then(|session| {
            session
                .map(|(path, session)| {
                    let session = SessionHeader {
                        robot: setup.task.robot.clone(),
                        program: format!("ftac {version}"),
                        seed: setup.task.seed,
                        tick_length: body.tick_length(),
                        task: serde_json::to_vec(setup.task)?,
                        ..session
                    };
                    Ok(SessionWriter::create(&path, &session)?)
                })
                .transpose()
        });
        let line = match opened {
            Err(error) => {
                // The robot is armed and must not be left silently.
                body.end_trial(Some(&format!("{error:#}")))?;
                return Err(error);
            }
            Ok(None) => TrialRobot::Unrecorded(body),
            Ok(Some(writer)) => {
                let recorder = SessionRecorder::new(body, writer);
                TrialRobot::Recorded(Box::new(match source.packets() {
                    Some(packets) => recorder.with_packets(packets),
                    None => recorder,
                }))
            }
        };
        Ok(Self::Single(Rc::new(RefCell::new(SingleUseBackend { robot: Some(line), time: 0.0 }))))
    }

    /// True if a clone is a separate backend.
    pub fn is_cloneable(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }

    /// Returns the time of the newest tick, s.
    pub fn time(&self) -> f64 {
        match self {
            Self::Simulated(robot) => robot.time(),
            Self::Single(single) => single.borrow().time,
        }
    }

    /// See [`TrialBackend::truth`].
    pub fn truth(&self) -> Option<GroundTruth> {
        match self {
            Self::Simulated(robot) => Some(robot.truth()),
            Self::Single(single) => single.borrow_mut().backend().and_then(|body| body.truth()),
        }
    }

    /// Detects an object, see [`TrialBackend::detect`], and records the result in the session.
    pub fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        match self {
            Self::Simulated(robot) => TrialBackend::detect(robot.as_mut(), glance),
            Self::Single(single) => {
                let mut single = single.borrow_mut();
                let seen = single.backend().ok_or_else(|| anyhow!("the trial is over"))?.detect(glance);
                if let Some(TrialRobot::Recorded(recorder)) = &mut single.robot {
                    match &seen {
                        Ok(seen) => {
                            let seen = seen.as_ref().map(|seen| (pose_numbers(&seen.pose), seen.sigma));
                            recorder.detection(glance.object, seen.as_ref());
                        }
                        // A stop does not depend on the detection.
                        Err(error) if error.is::<TrialStopped>() => {}
                        Err(error) => recorder.detection_failed(&format!("{error:#}")),
                    }
                }
                seen
            }
        }
    }

    /// True if the session can still be written, or if there is none.
    pub fn is_session_writable(&self) -> bool {
        match self {
            Self::Simulated(_) => true,
            Self::Single(single) => single.borrow().session_error().is_none(),
        }
    }

    /// See [`TrialBackend::stop_reason`].
    pub fn stop_reason(&self) -> Option<String> {
        match self {
            Self::Simulated(_) => None,
            Self::Single(single) => {
                let mut single = single.borrow_mut();
                let unwritten = single.session_error();
                let body = single.backend()?;
                if let Some(error) = unwritten {
                    body.hold();
                    return Some(format!("hold: the session cannot be written ({error}); free disk space"));
                }
                body.stop_reason()
            }
        }
    }

    /// See [`TrialBackend::pause`].
    pub fn pause(&mut self) {
        if let Self::Single(single) = self
            && let Some(body) = single.borrow_mut().backend()
        {
            body.pause();
        }
    }

    /// See [`TrialBackend::judge`].
    pub fn judge(&mut self) -> Result<Option<Verdict>> {
        match self {
            Self::Simulated(_) => Ok(None),
            Self::Single(single) => single.borrow_mut().backend().map_or(Ok(None), |body| body.judge()),
        }
    }

    /// Ends the trial: notes its `record` (none if it was stopped for the reason `why`), finishes its recording, and
    /// releases the backend.
    pub fn finish(&mut self, record: Option<&TrialRecord>, why: Option<&str>) -> Result<()> {
        let Self::Single(single) = self else { return Ok(()) };
        let left = single.borrow_mut().backend().map_or(Ok(()), |body| body.end_trial(why));
        if let Some(TrialRobot::Recorded(mut recorder)) = single.borrow_mut().robot.take() {
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

impl SingleUseBackend {
    /// Returns the reason for which the session can no longer be written.
    fn session_error(&self) -> Option<String> {
        match &self.robot {
            Some(TrialRobot::Recorded(recorder)) => recorder.error().map(ToString::to_string),
            _ => None,
        }
    }

    fn backend(&mut self) -> Option<&mut Box<dyn TrialBackend>> {
        self.robot.as_mut().map(|line| match line {
            TrialRobot::Unrecorded(body) => body,
            TrialRobot::Recorded(recorder) => recorder.robot(),
        })
    }

    fn robot(&mut self) -> Option<&mut dyn RobotBackend> {
        self.robot.as_mut().map(|line| match line {
            TrialRobot::Unrecorded(body) => body as &mut dyn RobotBackend,
            TrialRobot::Recorded(recorder) => recorder.as_mut() as &mut dyn RobotBackend,
        })
    }
}

impl RobotBackend for Backend {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        match self {
            Self::Simulated(robot) => robot.observe(),
            Self::Single(single) => single.borrow_mut().robot().ok_or_else(trial_over_error)?.observe(),
        }
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        match self {
            Self::Simulated(robot) => robot.send(command),
            Self::Single(single) => single.borrow_mut().robot().ok_or_else(trial_over_error)?.send(command),
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

/// Returns the error of a backend after the end of its trial.
fn trial_over_error() -> RobotError {
    RobotError::ConnectionLost("the trial is over".to_owned())
}

/// Returns a pose as seven numbers: x, y, z, i, j, k, w.
pub fn pose_numbers(pose: &Isometry3<f64>) -> [f64; 7] {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
}

/// Returns the pose of seven numbers, exact to the bit.
fn pose_from_numbers(numbers: &[f64; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = *numbers;
    // Normalising again would change bits.
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
        assert_eq!(
            pose_numbers(&pose_from_numbers(&pose_numbers(&original))).map(f64::to_bits),
            pose_numbers(&original).map(f64::to_bits)
        );
    }
}
