//! Objects as prior perception reports them, and the door through which it is asked.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use scenarios::objects::ObjectModel;

/// An object as prior perception (a camera over the table, say) reports it, error included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Percept {
    /// Centre, m, world.
    pub position: Point3<f64>,
    /// Orientation `world_from_object`.
    pub rotation: UnitQuaternion<f64>,
    /// Turn about the vertical from the object's rest pose, rad; 0 where it lies in another way.
    pub yaw: f64,
}

impl Percept {
    /// `object` reported at `world_from_object`.
    pub fn of(object: &ObjectModel, world_from_object: &Isometry3<f64>) -> Self {
        Self {
            position: world_from_object.translation.vector.into(),
            rotation: world_from_object.rotation,
            yaw: object.standing_yaw(&world_from_object.rotation).unwrap_or(0.0),
        }
    }

    /// A ball reported at `world_from_object`: all its turns look the same.
    pub fn of_ball(world_from_object: &Isometry3<f64>) -> Self {
        Self { position: world_from_object.translation.vector.into(), rotation: UnitQuaternion::identity(), yaw: 0.0 }
    }

    /// `world_from_object`.
    pub fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position.coords), self.rotation)
    }
}

/// Why an object could not be looked at.
#[derive(Debug, thiserror::Error)]
#[error("looking at object {object}: {source}")]
pub struct EyesError {
    /// Number of the object.
    pub object: usize,
    /// What failed.
    #[source]
    pub source: Box<dyn std::error::Error + Send + Sync>,
}

/// Prior perception: simulated with errors, a camera, or an operator who puts the object in its place.
pub trait Eyes {
    /// Looks at object number `object` anew: `world_from_object`, with this look's error; none if it is not to be seen.
    fn look(&mut self, object: usize) -> Result<Option<Isometry3<f64>>, EyesError>;
}
