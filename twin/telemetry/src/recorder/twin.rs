//! Logging of the digital twin in mirror mode: a ghost of the robot, the residuals between the two, and the object
//! believed to be in the hand.

use hand_model::DigitVector;
use nalgebra::{Isometry3, Matrix3};
use rerun::Clear;

use super::{Recorder, TWIN, TWIN_OBJECT};
use crate::error::StreamError;
use crate::{belief, entities, scene, signals};

/// State of the twin, and its residuals against the robot.
#[derive(Debug, Clone)]
pub struct TwinFrame<'a> {
    /// `world_from_link` of the arm's links.
    pub arm: &'a [Isometry3<f64>],
    /// `world_from_palm`.
    pub palm: Isometry3<f64>,
    /// `world_from_link` of the hand's links.
    pub hand: &'a [Isometry3<f64>],
    /// Residual load of each cable, robot minus twin, N.
    pub loads: DigitVector,
    /// Residual force on the hand, robot minus twin, N, world axes.
    pub force: [f64; 3],
    /// Object believed to be in the hand: name, `world_from_object`, and the covariance of its position (m2) along its
    /// own axes.
    pub object: Option<(&'a str, Isometry3<f64>, Matrix3<f64>)>,
}

impl Recorder {
    /// Logs the twin at this moment.
    pub fn log_twin(&mut self, frame: &TwinFrame) -> Result<(), StreamError> {
        if !self.twin {
            self.twin = true;
            scene::log_twin(&self.rec, &self.robot)?;
        }
        if !self.poses.due(TWIN, self.time) {
            return Ok(());
        }
        signals::log_residuals(&self.rec, &frame.loads, &frame.force)?;
        for (k, pose) in frame.arm.iter().enumerate().take(self.arm_links) {
            self.pose(&entities::twin_arm_link(k), pose)?;
        }
        self.pose(entities::TWIN_HAND, &frame.palm)?;
        let inverse = frame.palm.inverse();
        let paths: Vec<_> =
            self.robot.hand.tree.joints.iter().map(|joint| entities::twin_hand_link(&joint.name)).collect();
        for (path, link) in paths.iter().zip(frame.hand) {
            self.pose(path, &(inverse * link))?;
        }
        self.log_twin_object(frame)
    }

    fn log_twin_object(&mut self, frame: &TwinFrame) -> Result<(), StreamError> {
        let index = frame.object.as_ref().map(|(name, ..)| self.object(name)).transpose()?;
        if let Some(gone) = self.twin_object.filter(|_| self.twin_object != index) {
            let path = entities::twin_object(&self.objects[gone].name);
            self.moved.forget(&path);
            self.rec.log(path, &Clear::recursive())?;
        }
        if let (Some(index), Some((name, pose, covariance))) = (index, &frame.object) {
            let path = entities::twin_object(name);
            if self.twin_object != Some(index) {
                self.rec.log(path.as_str(), &belief::ghost(&self.objects[index], 0))?;
            }
            self.pose(&path, pose)?;
            if self.scalars.due(TWIN_OBJECT, self.time) {
                let felt = belief::Felt::new(self.time, covariance);
                let ellipsoid = belief::ellipsoid(&self.objects[index], &felt, self.time);
                self.rec.log(format!("{path}/covariance"), &ellipsoid)?;
            }
        }
        self.twin_object = index;
        Ok(())
    }
}
