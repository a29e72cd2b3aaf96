//! Logging of fault detection: the reference model as a ghost of the robot, the residuals between the two, and the
//! estimated object in the hand.

use hand_model::DigitVector;
use nalgebra::{Isometry3, Matrix3};
use rerun::Clear;

use super::{REFERENCE_KEY, REFERENCE_OBJECT_KEY, Recorder};
use crate::error::TelemetryError;
use crate::{entities, pose_estimate, scene, signals};

/// State of the reference model, and the robot's residuals against it.
#[derive(Debug, Clone)]
pub struct ReferenceFrame<'a> {
    /// `world_from_link` of the arm's links.
    pub arm: &'a [Isometry3<f64>],
    /// `world_from_palm`.
    pub palm: Isometry3<f64>,
    /// `world_from_link` of the hand's links.
    pub hand: &'a [Isometry3<f64>],
    /// Residual load of each cable, robot minus reference model, N.
    pub loads: DigitVector,
    /// Residual force on the hand, robot minus reference model, N, world axes.
    pub force: [f64; 3],
    /// Object in the hand: name, `world_from_object`, and the covariance of its position (m2) along its own axes.
    pub object: Option<(&'a str, Isometry3<f64>, Matrix3<f64>)>,
}

impl Recorder {
    /// Logs the reference model at this moment.
    pub fn log_reference_model(&mut self, frame: &ReferenceFrame) -> Result<(), TelemetryError> {
        if !self.reference_model {
            self.reference_model = true;
            scene::log_reference_model(&self.rec, &self.robot)?;
        }
        if !self.poses.due(REFERENCE_KEY, self.time) {
            return Ok(());
        }
        signals::log_residuals(&self.rec, &frame.loads, &frame.force)?;
        for (k, pose) in frame.arm.iter().enumerate().take(self.arm_links) {
            self.log_pose_if_moved(&entities::reference_arm_link(k), pose)?;
        }
        self.log_pose_if_moved(entities::REFERENCE_HAND, &frame.palm)?;
        let inverse = frame.palm.inverse();
        let paths: Vec<_> =
            self.robot.hand.tree.joints.iter().map(|joint| entities::reference_hand_link(&joint.name)).collect();
        for (path, link) in paths.iter().zip(frame.hand) {
            self.log_pose_if_moved(path, &(inverse * link))?;
        }
        self.log_reference_object(frame)
    }

    fn log_reference_object(&mut self, frame: &ReferenceFrame) -> Result<(), TelemetryError> {
        let index = frame.object.as_ref().map(|(name, ..)| self.object_index(name)).transpose()?;
        if let Some(gone) = self.reference_object.filter(|_| self.reference_object != index) {
            let path = entities::reference_object(&self.objects[gone].name);
            self.last_poses.forget(&path);
            self.rec.log(path, &Clear::recursive())?;
        }
        if let (Some(index), Some((name, pose, covariance))) = (index, &frame.object) {
            let path = entities::reference_object(name);
            if self.reference_object != Some(index) {
                self.rec.log(path.as_str(), &pose_estimate::ghost(&self.objects[index], 0))?;
            }
            self.log_pose_if_moved(&path, pose)?;
            if self.scalars.due(REFERENCE_OBJECT_KEY, self.time) {
                let felt = pose_estimate::LastContact::new(self.time, covariance);
                let ellipsoid = pose_estimate::ellipsoid(&self.objects[index], &felt, self.time);
                self.rec.log(format!("{path}/covariance"), &ellipsoid)?;
            }
        }
        self.reference_object = index;
        Ok(())
    }
}
