//! What a camera over the table can see of the objects.

use nalgebra::Point3;
use rapier3d_f64::parry::query::Ray;

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
}
