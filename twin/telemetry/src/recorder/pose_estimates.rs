//! Logging of pose estimates and of compared trajectories, while they are valid.

use nalgebra::{Isometry3, Matrix3};
use rerun::Clear;

use super::{FIRST_OBJECT_KEY, Recorder};
use crate::error::TelemetryError;
use crate::pose_estimate::ObjectPath;
use crate::{entities, pose_estimate, scene};

impl Recorder {
    /// Logs the pose estimate `world_from_object`; `None` removes it.
    pub fn log_estimate(&mut self, name: &str, pose: Option<&Isometry3<f64>>) -> Result<(), TelemetryError> {
        let index = self.object_index(name)?;
        let path = entities::estimate(name);
        let Some(pose) = pose else {
            self.felt[index] = None;
            if self.last_poses.forget(&path) {
                self.rec.log(path.as_str(), &Clear::recursive())?;
            }
            return Ok(());
        };
        if !self.last_poses.knows(&path) {
            self.rec.log(path.as_str(), &pose_estimate::ghost(&self.objects[index], 0))?;
        } else if !self.poses.due(FIRST_OBJECT_KEY + 2 * index + 1, self.time) {
            return Ok(());
        }
        self.log_pose_if_moved(&path, pose)?;
        let Some(felt) = &mut self.felt[index] else { return Ok(()) };
        if let Some(step) = felt.update_age(self.time) {
            self.rec.log(path.as_str(), &pose_estimate::ghost_color_update(&self.objects[index], step))?;
            self.rec.log(entities::covariance(name), &pose_estimate::ellipsoid_update(felt, step, self.time))?;
        }
        Ok(())
    }

    /// Logs a new touch of an object, with the covariance (m2) of its position along its own axes.
    pub fn log_touch_covariance(&mut self, name: &str, covariance: &Matrix3<f64>) -> Result<(), TelemetryError> {
        let index = self.object_index(name)?;
        let felt = pose_estimate::LastContact::new(self.time, covariance);
        let path = entities::covariance(name);
        self.rec.log(path.as_str(), &pose_estimate::ellipsoid(&self.objects[index], &felt, self.time))?;
        if self.last_poses.knows(&entities::estimate(name)) {
            self.rec.log(entities::estimate(name), &pose_estimate::ghost_color_update(&self.objects[index], 0))?;
        }
        self.felt[index] = Some(felt);
        Ok(())
    }

    /// Logs the compared trajectories of the held object `name`: the rejected one and the chosen one. An empty
    /// trajectory is removed. For the rejected one, the closest approach is drawn as well.
    pub fn log_paths(&mut self, name: &str, rejected: &ObjectPath, chosen: &ObjectPath) -> Result<(), TelemetryError> {
        let index = self.object_index(name)?;
        let ways = [
            (entities::REJECTED_PATH, &rejected.poses, pose_estimate::REJECTED_COLOR),
            (entities::CHOSEN_PATH, &chosen.poses, pose_estimate::CHOSEN_COLOR),
        ];
        // An entity that is logged again is not cleared first: a clear also hides data logged at the same time.
        for (n, (path, way, color)) in ways.into_iter().enumerate() {
            if !way.is_empty() {
                self.rec.log(path, &pose_estimate::path_lines(way, color))?;
            } else if self.shown_paths[n] {
                self.rec.log(path, &Clear::flat())?;
            }
            self.shown_paths[n] = !way.is_empty();
        }
        let path = entities::CLOSEST_APPROACH;
        let label = format!("{path}/label");
        if let Some((pose, distance)) = rejected.nearest {
            self.rec.log(path, &pose_estimate::collision_mesh(&self.objects[index]))?;
            self.rec.log(path, &scene::transform(&pose))?;
            self.rec.log(label, &pose_estimate::distance_label(distance))?;
        } else if self.shown_paths[2] {
            self.rec.log(path, &Clear::flat())?;
            self.rec.log(label, &Clear::flat())?;
        }
        self.shown_paths[2] = rejected.nearest.is_some();
        Ok(())
    }
}
