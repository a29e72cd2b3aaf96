//! What is known of the object's shape.

use nalgebra::{Point3, Vector3};

/// A shape known in advance, in its own frame.
pub trait KnownShape: Sync {
    /// Signed distance (m, negative inside) of `point` (object frame) and its gradient, the outward unit normal.
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>);

    /// A point near the middle of the shape (object frame): starts are turned about it.
    fn center(&self) -> Point3<f64> {
        Point3::origin()
    }
}
