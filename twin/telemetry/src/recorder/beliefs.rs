//! Logging of the robot's beliefs and of the trajectories it compares, for as long as they are valid.

use nalgebra::{Isometry3, Matrix3};
use rerun::Clear;

use super::{FIRST_OBJECT, Recorder};
use crate::belief::Way;
use crate::error::StreamError;
use crate::{belief, entities, scene};

impl Recorder {
    /// Logs the pose estimate `world_from_object`; `None` removes it.
    pub fn log_estimate(&mut self, name: &str, pose: Option<&Isometry3<f64>>) -> Result<(), StreamError> {
        let index = self.object(name)?;
        let path = entities::estimate(name);
        let Some(pose) = pose else {
            self.felt[index] = None;
            if self.moved.forget(&path) {
                self.rec.log(path.as_str(), &Clear::recursive())?;
            }
            return Ok(());
        };
        if !self.moved.knows(&path) {
            self.rec.log(path.as_str(), &belief::ghost(&self.objects[index], 0))?;
        } else if !self.poses.due(FIRST_OBJECT + 2 * index + 1, self.time) {
            return Ok(());
        }
        self.pose(&path, pose)?;
        let Some(felt) = &mut self.felt[index] else { return Ok(()) };
        if let Some(step) = felt.ages(self.time) {
            self.rec.log(path.as_str(), &belief::tint(&self.objects[index], step))?;
            self.rec.log(entities::covariance(name), &belief::label(felt, step, self.time))?;
        }
        Ok(())
    }

    /// Logs that an object has just been felt, with the covariance (m2) of its position along its own axes.
    pub fn log_felt(&mut self, name: &str, covariance: &Matrix3<f64>) -> Result<(), StreamError> {
        let index = self.object(name)?;
        let felt = belief::Felt::new(self.time, covariance);
        let path = entities::covariance(name);
        self.rec.log(path.as_str(), &belief::ellipsoid(&self.objects[index], &felt, self.time))?;
        if self.moved.knows(&entities::estimate(name)) {
            self.rec.log(entities::estimate(name), &belief::tint(&self.objects[index], 0))?;
        }
        self.felt[index] = Some(felt);
        Ok(())
    }

    /// Logs the compared trajectories of the held object `name`: the rejected plan and the chosen one. An empty
    /// trajectory is removed. For the rejected one, the closest approach is drawn as well.
    pub fn log_ways(&mut self, name: &str, rejected: &Way, chosen: &Way) -> Result<(), StreamError> {
        let index = self.object(name)?;
        let ways = [
            (entities::REJECTED, &rejected.poses, belief::REJECTED),
            (entities::CHOSEN, &chosen.poses, belief::CHOSEN),
        ];
        // An entity that is logged again is not cleared first: a clear also hides data logged at the same time.
        for (n, (path, way, color)) in ways.into_iter().enumerate() {
            if !way.is_empty() {
                self.rec.log(path, &belief::way(way, color))?;
            } else if self.ways[n] {
                self.rec.log(path, &Clear::flat())?;
            }
            self.ways[n] = !way.is_empty();
        }
        let path = entities::NEAREST;
        let label = format!("{path}/label");
        if let Some((pose, distance)) = rejected.nearest {
            self.rec.log(path, &belief::collision(&self.objects[index]))?;
            self.rec.log(path, &scene::transform(&pose))?;
            self.rec.log(label, &belief::distance(distance))?;
        } else if self.ways[2] {
            self.rec.log(path, &Clear::flat())?;
            self.rec.log(label, &Clear::flat())?;
        }
        self.ways[2] = rejected.nearest.is_some();
        Ok(())
    }
}
