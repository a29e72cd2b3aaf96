//! The known shape of an object.

use nalgebra::{Point3, Vector3};

/// A shape in its own frame.
pub trait KnownShape: Sync {
    /// Signed distance (m, negative inside) of `point` (object frame) and its gradient, the outward unit normal.
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>);

    /// Distance of [`Self::signed_distance`] without the gradient, the same to the bit.
    fn distance(&self, point: &Point3<f64>) -> f64 {
        self.signed_distance(point).0
    }

    /// A point near the centre of the shape (object frame), about which initial poses are rotated.
    fn center(&self) -> Point3<f64> {
        Point3::origin()
    }
}
