//! The scene of a driver that lays out, detects and judges the objects of a trial itself: a simulated robot.

use control::detection::PoseDetection;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use python_process::ProcessError;
use scenarios::referee::{FailureCause, Verdict};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::link::read;
use super::{SharedProcess, describe_failure};
use crate::{TrialTask, pose_numbers};

/// Tolerance of a quaternion's norm about 1.
const NORM_TOLERANCE: f64 = 1e-3;

/// A scene that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("the robot's driver: {method}: {why}")]
pub struct SceneError {
    /// Method of the driver.
    pub method: &'static str,
    pub why: String,
}

/// Object to lay out.
pub(crate) struct SceneObject<'a> {
    pub name: &'a str,
    /// `world_from_object`.
    pub pose: Isometry3<f64>,
    /// Yaw about the vertical from the object's rest pose, rad.
    pub yaw: f64,
}

/// The scene behind a driver's process.
pub(crate) struct DriverScene {
    process: SharedProcess,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Detected {
    /// x, y, z (m) and the quaternion's x, y, z, w; none for a hidden object.
    pose: Option<[f64; 7]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Judged {
    contact: bool,
    success: bool,
    cause: Option<FailureCause>,
}

impl DriverScene {
    pub fn new(process: SharedProcess) -> Self {
        Self { process }
    }

    /// Lays out the objects of a trial.
    pub fn lay_out(&self, task: &TrialTask, objects: &[SceneObject]) -> Result<(), SceneError> {
        let object = |object: &SceneObject| json!({ "name": object.name, "pose": pose_numbers(&object.pose), "yaw": object.yaw });
        let question = json!({
            "ask": "lay_out",
            "objects": objects.iter().map(object).collect::<Vec<_>>(),
            "trial": { "combination": task.combination, "trial": task.trial, "seed": task.unit_seed() },
        });
        self.ask::<Nothing>("lay_out", &question).map(drop)
    }

    /// Detects the object of this name; none if it is hidden.
    pub fn detect(&self, name: &str) -> Result<Option<PoseDetection>, SceneError> {
        let Detected { pose } = self.ask("detect", &json!({ "ask": "detect", "object": name }))?;
        let Some([x, y, z, i, j, k, w]) = pose else { return Ok(None) };
        let quaternion = Quaternion::new(w, i, j, k);
        if (quaternion.norm() - 1.0).abs() > NORM_TOLERANCE {
            let why = format!("{name}: found a quaternion of norm {}, expected 1", quaternion.norm());
            return Err(SceneError { method: "detect", why });
        }
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        Ok(Some(Isometry3::from_parts(Translation3::new(x, y, z), rotation).into()))
    }

    /// Judges the trial.
    pub fn judge(&self) -> Result<Verdict, SceneError> {
        let Judged { contact, success, cause } = self.ask("judge", &json!({ "ask": "judge" }))?;
        if success == cause.is_some() {
            let found = cause
                .map_or("a failure without a cause".to_owned(), |cause| format!("a success with the cause {cause}"));
            return Err(SceneError {
                method: "judge",
                why: format!("found {found}, expected a cause of a failure only"),
            });
        }
        Ok(Verdict { contact, first_contact: None, success, cause })
    }

    fn ask<T: DeserializeOwned>(&self, method: &'static str, question: &Value) -> Result<T, SceneError> {
        let failed = |error: ProcessError| SceneError { method, why: describe_failure(&error) };
        read(self.process.lock().ask(question, &[]).map_err(failed)?.value).map_err(failed)
    }
}
