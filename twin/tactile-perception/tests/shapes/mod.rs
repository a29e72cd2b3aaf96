//! Objects of known shape.

use nalgebra::{Point3, Vector3};
use tactile_perception::KnownShape;

/// Ball of this radius, m.
pub struct Ball(pub f64);
impl KnownShape for Ball {
    fn signed_distance(&self, p: &Point3<f64>) -> (f64, Vector3<f64>) {
        (p.coords.norm() - self.0, p.coords.normalize())
    }
}

/// Box of these half extents, m.
pub struct Block(pub Vector3<f64>);
impl KnownShape for Block {
    fn signed_distance(&self, p: &Point3<f64>) -> (f64, Vector3<f64>) {
        let d = p.coords.abs() - self.0;
        let sign = p.coords.map(|c| if c < 0.0 { -1.0 } else { 1.0 });
        let outside = d.map(|d| d.max(0.0));
        if outside.norm() > 0.0 {
            (outside.norm(), outside.component_mul(&sign).normalize())
        } else {
            let axis = d.imax();
            (d[axis], Vector3::ith(axis, sign[axis]))
        }
    }
}

/// Ellipsoid of these half axes, m; distance to second order, gradient normalised.
pub struct Ellipsoid(pub Vector3<f64>);
impl KnownShape for Ellipsoid {
    fn signed_distance(&self, p: &Point3<f64>) -> (f64, Vector3<f64>) {
        let scaled = p.coords.component_div(&self.0);
        let gradient = scaled.component_div(&self.0);
        let (k0, k1) = (scaled.norm(), gradient.norm());
        (k0 * (k0 - 1.0) / k1, gradient / k1)
    }
}
