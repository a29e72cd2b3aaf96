//! Rounded boxes that represent the links in contact, and their surface.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::kinematics::pose_from_xyz_rpy;
use crate::parameters::Cover;

/// A rounded box that represents a link in contact.
#[derive(Debug, Clone, Copy)]
pub struct CoverShape {
    /// `link_from_cover`.
    pub link_from_cover: Isometry3<f64>,
    /// Half extents including the rounding, m.
    pub half: Vector3<f64>,
    /// Rounding radius, m.
    pub radius: f64,
}

/// A small piece of a cover's surface.
#[derive(Debug, Clone, Copy)]
pub struct SkinElement {
    /// Centre, link frame, m.
    pub point: Point3<f64>,
    /// Unit outward normal, link frame.
    pub normal: Vector3<f64>,
    /// Area, m2.
    pub area: f64,
}

impl CoverShape {
    pub(crate) fn from_parameters(cover: &Cover) -> Self {
        Self {
            link_from_cover: pose_from_xyz_rpy(cover.center, cover.rpy),
            half: Vector3::from(cover.half),
            radius: cover.radius,
        }
    }

    /// Computes the signed distance (m, negative inside) of `point` (link frame) from the surface, and the unit outward
    /// normal there.
    pub fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let local = self.link_from_cover.inverse_transform_point(point).coords;
        let core = self.half.add_scalar(-self.radius);
        let beyond = local.zip_map(&core, |at, half| at.abs() - half);
        let outside = beyond.map(|x| x.max(0.0));
        let distance = outside.norm();
        if distance > 1e-12 {
            let outward = outside.zip_map(&local, f64::copysign) / distance;
            return (distance - self.radius, self.link_from_cover * outward);
        }
        let axis = beyond.imax();
        (beyond[axis] - self.radius, self.link_from_cover * Vector3::ith(axis, 1f64.copysign(local[axis])))
    }

    /// Divides the cover's surface into elements with sides of about `size` (m): each face's grid is wrapped around the
    /// rounding.
    pub fn skin_elements(&self, size: f64) -> Vec<SkinElement> {
        let inner = self.half.add_scalar(-self.radius);
        // Maps a point on the sharp box to the rounded surface below it.
        let wrap = |p: Vector3<f64>| {
            let core = p.zip_map(&inner, |a, b| a.clamp(-b, b));
            let normal = (p - core).normalize();
            (core + normal * self.radius, normal)
        };
        let mut skin = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let count = |half: f64| (2.0 * half / size).ceil().max(1.0) as usize;
            let (nu, nv) = (count(self.half[u]), count(self.half[v]));
            for side in [-1.0, 1.0] {
                let corner = |i: usize, j: usize| {
                    let mut p = Vector3::zeros();
                    p[axis] = side * self.half[axis];
                    p[u] = self.half[u] * (2.0 * i as f64 / nu as f64 - 1.0);
                    p[v] = self.half[v] * (2.0 * j as f64 / nv as f64 - 1.0);
                    p
                };
                for (i, j) in (0..nu).flat_map(|i| (0..nv).map(move |j| (i, j))) {
                    let [a, b, c, d] =
                        [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| wrap(corner(i, j)).0);
                    let (at, normal) = wrap(0.5 * (corner(i, j) + corner(i + 1, j + 1)));
                    skin.push(SkinElement {
                        point: self.link_from_cover * Point3::from(at),
                        normal: self.link_from_cover * normal,
                        // Half the cross product of a quadrilateral's diagonals.
                        area: 0.5 * (c - a).cross(&(d - b)).norm(),
                    });
                }
            }
        }
        skin
    }
}

#[cfg(test)]
mod tests {
    use crate::Hand;

    /// The elements' areas add up to the area of the rounded box: faces, quarter cylinders along the edges, a sphere in
    /// the corners.
    #[test]
    fn skin_has_the_rounded_box_s_area() {
        let cover = Hand::ftac().covers[4];
        let [a, b, c] = [0, 1, 2].map(|axis| 2.0 * (cover.half[axis] - cover.radius));
        let r = cover.radius;
        let pi = std::f64::consts::PI;
        let exact = 2.0 * (a * b + b * c + c * a) + 2.0 * pi * r * (a + b + c) + 4.0 * pi * r * r;
        let found: f64 = cover.skin_elements(0.0005).iter().map(|element| element.area).sum();
        assert!((found / exact - 1.0).abs() < 0.01, "{found} {exact}");
    }
}
