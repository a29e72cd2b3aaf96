//! Visibility of the objects for a camera over the table, and the resolution of the tactile images.

use std::sync::Arc;

use nalgebra::Point3;
use rapier3d_f64::parry::query::Ray;
use tactile_optics::OpticsError;
use world::objects::ObjectModel;

use super::SimulatedRobot;
use crate::convert;

impl SimulatedRobot {
    /// True if a camera at `camera` sees the centre of object `index` at `center` (both m, world): it is above the
    /// table's top, and neither hand, wrist nor another object occludes it.
    pub fn is_visible(&self, camera: &Point3<f64>, index: usize, center: &Point3<f64>) -> bool {
        if center.z < 0.0 {
            return false;
        }
        let own = self.objects[index].2;
        let ray = Ray::new(convert::point(camera), convert::vector(&(center - camera)));
        let hidden =
            self.engine.colliders.iter().any(|(handle, collider)| {
                handle != own && collider.shape().intersects_ray(collider.position(), &ray, 1.0)
            });
        !hidden
    }

    /// Returns the true object models in order, for the recording, like the ground truth.
    pub fn models(&self) -> impl Iterator<Item = &Arc<ObjectModel>> {
        self.objects.iter().map(|(model, ..)| model)
    }

    /// Reduces frames to `side` x `side` pixels from now on; frames in transit are lost. See [`TactileBoard::reduced`].
    pub fn reduce_images(&mut self, side: usize) -> Result<(), OpticsError> {
        self.tactile = self.tactile.clone().reduced(side)?;
        self.frames_in_transit.clear();
        self.frames.clear();
        Ok(())
    }
}
