//! What a camera over the table can see of the objects, and how large the tactile cameras' images are.

use std::sync::Arc;

use nalgebra::Point3;
use optics::OpticsError;
use rapier3d_f64::parry::query::Ray;
use world::objects::ObjectModel;

use super::SimulatedRobot;
use crate::convert;

impl SimulatedRobot {
    /// Whether a camera at `camera` sees object `index` with its centre at `center` (both m, world): over the table's top, and with
    /// neither hand, wrist nor another object in between.
    pub fn sees(&self, camera: &Point3<f64>, index: usize, center: &Point3<f64>) -> bool {
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

    /// The objects as they are, in order: for the recording, like the truth.
    pub fn models(&self) -> impl Iterator<Item = &Arc<ObjectModel>> {
        self.objects.iter().map(|(model, ..)| model)
    }

    /// From now on frames are of `side` x `side` pixels; those on their way are lost. See [`TactileBoard::reduced`].
    pub fn reduce_images(&mut self, side: usize) -> Result<(), OpticsError> {
        self.tactile = self.tactile.clone().reduced(side)?;
        self.on_their_way.clear();
        self.frames.clear();
        Ok(())
    }
}
