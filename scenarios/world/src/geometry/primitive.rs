//! Closed-form queries of spheres, cylinders and rounded boxes.

use std::f64::consts::PI;

use nalgebra::{Point3, Unit, Vector3};

/// Distance below which a direction is not normalised, m.
const MIN_NORM: f64 = 1e-14;

pub fn sphere_distance(radius: f64, point: &Point3<f64>) -> (f64, Vector3<f64>) {
    let distance = point.coords.norm();
    let outward = if distance > MIN_NORM { point.coords / distance } else { Vector3::z() };
    (distance - radius, outward)
}

pub fn sphere_ray(radius: f64, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<f64> {
    let along = origin.coords.dot(direction);
    let outside = origin.coords.norm_squared() - radius * radius;
    if outside <= 0.0 {
        return Some(0.0);
    }
    // The distance of closest approach is computed across the ray, so that far origins lose no digits.
    let across = (origin.coords - direction.into_inner() * along).norm_squared();
    let half_chord = radius * radius - across;
    (along < 0.0 && half_chord >= 0.0).then(|| (-along - half_chord.sqrt()).max(0.0))
}

pub fn cylinder_distance(radius: f64, half_height: f64, point: &Point3<f64>) -> (f64, Vector3<f64>) {
    let across = point.x.hypot(point.y);
    let radial = if across > MIN_NORM { Vector3::new(point.x / across, point.y / across, 0.0) } else { Vector3::x() };
    let axial = Vector3::new(0.0, 0.0, 1.0_f64.copysign(point.z));
    let (side, end) = (across - radius, point.z.abs() - half_height);
    if side > 0.0 && end > 0.0 {
        let distance = side.hypot(end);
        (distance, (radial * side + axial * end) / distance)
    } else if side > end {
        (side, radial)
    } else {
        (end, axial)
    }
}

pub fn cylinder_ray(
    radius: f64,
    half_height: f64,
    origin: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
) -> Option<f64> {
    // The solid is the intersection of a slab and an infinite cylinder, and so are the spans of the ray inside them.
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    if direction.z.abs() > MIN_NORM {
        let ends = [(-half_height - origin.z) / direction.z, (half_height - origin.z) / direction.z];
        enter = enter.max(ends[0].min(ends[1]));
        leave = leave.min(ends[0].max(ends[1]));
    } else if origin.z.abs() > half_height {
        return None;
    }
    let a = direction.x * direction.x + direction.y * direction.y;
    let c = origin.x * origin.x + origin.y * origin.y - radius * radius;
    if a > MIN_NORM {
        let b = origin.x * direction.x + origin.y * direction.y;
        let discriminant = b * b - a * c;
        if discriminant < 0.0 {
            return None;
        }
        let root = discriminant.sqrt();
        enter = enter.max((-b - root) / a);
        leave = leave.min((-b + root) / a);
    } else if c > 0.0 {
        return None;
    }
    (enter <= leave).then_some(enter)
}

pub fn cuboid_distance(half: &Vector3<f64>, radius: f64, point: &Point3<f64>) -> (f64, Vector3<f64>) {
    let q = point.coords.abs() - half.add_scalar(-radius);
    let sign = point.coords.map(|x| 1.0_f64.copysign(x));
    let outside = q.map(|x| x.max(0.0));
    let distance = outside.norm();
    if distance > MIN_NORM {
        (distance - radius, outside.component_mul(&sign) / distance)
    } else {
        let axis = q.imax();
        let mut outward = Vector3::zeros();
        outward[axis] = sign[axis];
        (q[axis] - radius, outward)
    }
}

/// Finds the hit by Newton's method on the signed distance along the ray. The distance to a convex body is a convex
/// function of the position along a line. No step therefore overshoots, and a tangent that does not fall means a miss.
pub fn cuboid_ray(
    half: &Vector3<f64>,
    radius: f64,
    origin: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
) -> Option<f64> {
    let mut along = 0.0;
    for _ in 0..64 {
        let (distance, outward) = cuboid_distance(half, radius, &(origin + direction.into_inner() * along));
        if distance <= 1e-12 {
            return Some(along);
        }
        let slope = outward.dot(direction);
        if slope >= -1e-12 {
            return None;
        }
        along -= distance / slope;
    }
    None
}

pub fn cuboid_volume(half: &Vector3<f64>, radius: f64) -> f64 {
    let side = half.add_scalar(-radius) * 2.0;
    side.product()
        + 2.0 * radius * (side.x * side.y + side.y * side.z + side.z * side.x)
        + PI * radius * radius * side.sum()
        + 4.0 / 3.0 * PI * radius.powi(3)
}

/// Returns the integral of x2 over a rounded box whose inner half extents are `a` (along x), `b` and `c`.
fn second_moment(a: f64, b: f64, c: f64, r: f64) -> f64 {
    let line = 2.0 * a.powi(3) / 3.0;
    let core = line * 4.0 * b * c;
    let end_slabs = 4.0 * b * c * 2.0 * ((a + r).powi(3) - a.powi(3)) / 3.0;
    let side_slabs = line * 2.0 * r * 2.0 * (b + c);
    let edges_along = line * PI * r * r;
    let edges_across = 2.0 * (b + c) * (PI * r * r * a * a + 2.0 * a * 4.0 / 3.0 * r.powi(3) + PI * r.powi(4) / 4.0);
    let corners = 4.0 / 3.0 * PI * r.powi(3) * a * a + 2.0 * a * PI * r.powi(4) / 2.0 + 4.0 / 15.0 * PI * r.powi(5);
    core + end_slabs + side_slabs + edges_along + edges_across + corners
}

/// Returns the diagonal of the inertia of a rounded box of 1 kg, m2.
pub fn cuboid_unit_inertia(half: &Vector3<f64>, radius: f64) -> Vector3<f64> {
    let inner = half.add_scalar(-radius);
    let moment = |i: usize, j: usize, k: usize| second_moment(inner[i], inner[j], inner[k], radius);
    let square = Vector3::new(moment(0, 1, 2), moment(1, 2, 0), moment(2, 0, 1));
    Vector3::new(square.y + square.z, square.z + square.x, square.x + square.y) / cuboid_volume(half, radius)
}
