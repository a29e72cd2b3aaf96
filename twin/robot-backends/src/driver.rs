//! A robot behind a driver of its owner: a Python class in a process of its own.
//!
//! [`description`] compares the robot that the class describes with the robot model. [`link`] joins the process to the
//! servo cycle of the hardware bridge, so that the safety supervisor is between controller and driver. A simulated robot
//! may also lay out, detect and judge the objects of a trial: [`scene`]. The package's module `ftac.robot_host` is the
//! other side.

pub mod description;
pub mod link;
pub mod scene;

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hand_model::RobotModel;
use hardware_bridge::config::{ConfigError, LimitConfig};
use hardware_bridge::delivered_images::DeliveredImages;
use hardware_bridge::hardware_robot::{ConnectError, HardwareRobot, LinkSettings, LinkTiming};
use python_process::{ClassError, HostedProcess, ProcessError, PythonClass, Role, StartError};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::description::{DescriptionError, DriverDescription};
use self::link::DriverLink;
use self::scene::DriverScene;

/// Time limit of an answer of a driver on the wall clock, s.
const WALL_TIMEOUT: u32 = 1;
/// Time limit of an answer of a driver in lock-step, s.
const LOCKSTEP_TIMEOUT: u32 = 60;
/// Longest wait until a driver on the wall clock has switched the torque on.
const ENGAGE_TIMEOUT: Duration = Duration::from_secs(10);

/// Driver of a robot, as a run and its sessions name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RobotDriver {
    #[serde(flatten)]
    pub class: PythonClass,
    /// True if time passes with the controller's ticks only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lockstep: bool,
    /// Time limit of an answer, s.
    pub timeout: u32,
}

/// A driver that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    #[error(transparent)]
    Class(#[from] ClassError),
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("--robot {asked}: its introduction: {source}")]
    Introduction { asked: String, source: serde_json::Error },
    #[error("--robot {asked}: describe: {source}")]
    Description { asked: String, source: DescriptionError },
    #[error("--config: {0}")]
    Limits(#[from] ConfigError),
    #[error(transparent)]
    Connect(#[from] ConnectError),
}

/// A driver whose description fits the robot model, with the limits of its robot. It makes a process for each trial.
#[derive(Clone)]
pub struct DrivenRobot {
    pub driver: RobotDriver,
    pub description: DriverDescription,
    pub limits: LimitConfig,
    model: RobotModel,
    /// The process that introduced the driver, until a trial uses it.
    first: Arc<Mutex<Option<HostedProcess>>>,
}

impl DrivenRobot {
    /// Starts the driver's process and compares its description with the robot `model`. The limits are those of the
    /// file `limits`, if there is one; `timeout` is the time limit of an answer, s.
    ///
    /// # Errors
    /// The first thing by which class, description or limits cannot be used.
    pub fn introduce(
        class: PythonClass,
        timeout: Option<u32>,
        model: &RobotModel,
        limits: Option<&Path>,
    ) -> Result<Self, DriverError> {
        let started = HostedProcess::start(Role::Robot, &class, seconds(timeout.unwrap_or(LOCKSTEP_TIMEOUT)))?;
        Self::from_process(class, started, timeout, model, limits)
    }

    /// As [`DrivenRobot::introduce`], with a process that has introduced itself.
    fn from_process(
        class: PythonClass,
        (mut process, introduction): (HostedProcess, Value),
        timeout: Option<u32>,
        model: &RobotModel,
        limits: Option<&Path>,
    ) -> Result<Self, DriverError> {
        let asked = class.name();
        let introduced: Result<DriverDescription, _> = serde_json::from_value(introduction);
        let description = introduced.map_err(|source| DriverError::Introduction { asked: asked.clone(), source })?;
        description.check(model).map_err(|source| DriverError::Description { asked, source })?;
        let limits = match limits {
            Some(path) => LimitConfig::read(path, model, description.rate)?,
            None => LimitConfig::for_robot(model),
        };
        let usual = if description.lockstep { LOCKSTEP_TIMEOUT } else { WALL_TIMEOUT };
        let driver = RobotDriver { class, lockstep: description.lockstep, timeout: timeout.unwrap_or(usual) };
        process.set_timeout(seconds(driver.timeout));
        let first = Arc::new(Mutex::new(Some(process)));
        Ok(Self { driver, description, limits, model: model.clone(), first })
    }

    /// Returns a process of the driver that no other trial uses.
    pub(crate) fn start_process(&self) -> Result<SharedProcess, DriverError> {
        let first = self.first.lock().unwrap_or_else(PoisonError::into_inner).take();
        let process = match first {
            Some(process) => process,
            None => {
                self.driver.class.check(Role::Robot)?;
                HostedProcess::start(Role::Robot, &self.driver.class, seconds(self.driver.timeout))?.0
            }
        };
        Ok(SharedProcess(Arc::new(Mutex::new(process))))
    }

    /// Returns the scene of a driver that lays out, detects and judges the objects itself.
    pub(crate) fn scene(&self, process: &SharedProcess) -> Option<DriverScene> {
        self.description.owns_scene.then(|| DriverScene::new(process.clone()))
    }

    /// Connects the robot behind `process`, under the supervisor. Nothing moves.
    pub(crate) fn connect(&self, process: SharedProcess) -> Result<HardwareRobot, DriverError> {
        let travel = self.description.travel(&self.model.hand);
        let images = (!self.description.cameras.is_empty()).then(DeliveredImages::default);
        let timing = match self.driver.lockstep {
            true => LinkTiming::Lockstep,
            false => LinkTiming::Wall { rate: self.description.rate },
        };
        let settings = LinkSettings {
            limits: self.limits.limits(&travel, &self.model.arm),
            timing,
            images: images.clone(),
            file: &self.driver.class.file,
            order_timeout: ENGAGE_TIMEOUT.max(seconds(self.driver.timeout)),
        };
        let link = DriverLink::new(process, &self.description, images.unwrap_or_default());
        Ok(HardwareRobot::start(link, &self.model, settings)?)
    }
}

fn seconds(timeout: u32) -> Duration {
    Duration::from_secs(timeout.into())
}

/// A driver's process, asked by the servo cycle and, for its scene, by the trial.
#[derive(Clone)]
pub(crate) struct SharedProcess(Arc<Mutex<HostedProcess>>);

impl SharedProcess {
    pub fn lock(&self) -> MutexGuard<'_, HostedProcess> {
        // A panic of another holder has been reported already.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Describes the failure of a driver to answer.
fn describe_failure(error: &ProcessError) -> String {
    match error {
        ProcessError::TimedOut(limit) => {
            format!("it has not answered within {} s (--robot-timeout): its process was ended", limit.as_secs_f64())
        }
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests;
