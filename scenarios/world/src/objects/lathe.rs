//! Surfaces of revolution from an outline, and the pose of such an object on its side.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{UnitQuaternion, Vector3};

use crate::geometry::{ObjectShape, Profile};

/// Number of segments around a surface of revolution.
pub const SEGMENTS: usize = 48;

/// Returns the outline through the points (radius, z), scaled by `unit` to m and closed on the axis at both ends.
pub fn straight_profile(points: &[[f64; 2]], unit: f64) -> Profile {
    let mut profile: Profile = points.iter().map(|[radius, z]| [radius * unit, z * unit]).collect();
    if let Some(&[radius, z]) = profile.first()
        && radius > 0.0
    {
        profile.insert(0, [0.0, z]);
    }
    if let Some(&[radius, z]) = profile.last()
        && radius > 0.0
    {
        profile.push([0.0, z]);
    }
    profile
}

/// Returns a smooth outline (Catmull-Rom spline) through the points with `steps` steps between two, closed as by
/// [`straight_profile`].
pub fn smooth_profile(points: &[[f64; 2]], steps: usize, unit: f64) -> Profile {
    let at = |n: isize| points[n.clamp(0, points.len() as isize - 1) as usize];
    let mut curve: Profile = Vec::new();
    for n in 0..points.len() as isize - 1 {
        let [a, b, c, d] = [at(n - 1), at(n), at(n + 1), at(n + 2)];
        for step in 0..steps {
            let t = step as f64 / steps as f64;
            let blend = |k: usize| {
                let (m, o) = (0.5 * (c[k] - a[k]), 0.5 * (d[k] - b[k]));
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * b[k]
                    + (t3 - 2.0 * t2 + t) * m
                    + (3.0 * t2 - 2.0 * t3) * c[k]
                    + (t3 - t2) * o
            };
            curve.push([blend(0), blend(1)]);
        }
    }
    curve.extend(points.last());
    straight_profile(&curve, unit)
}

/// Returns the rotation in which a surface of revolution lies on its side: the tilt at which its centre is lowest, on a
/// facet.
pub fn lying_rotation(shape: &ObjectShape) -> UnitQuaternion<f64> {
    let facet_down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI / SEGMENTS as f64);
    let tilted = |tilt: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt) * facet_down;
    let height = |tilt: f64| -shape.lowest_height(&tilted(tilt));
    // Starts with steps of one degree, because two lobes have two valleys with a ridge between, then refines around the
    // best.
    let (mut best, mut step) = (FRAC_PI_2, PI / 180.0);
    for _ in 0..4 {
        let around = best;
        for k in -30..=30 {
            let tilt = around + step * f64::from(k);
            if height(tilt) < height(best) - 1e-12 {
                best = tilt;
            }
        }
        step *= 0.1;
    }
    tilted(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_is_closed_on_the_axis() {
        let profile = straight_profile(&[[20.0, 0.0], [10.0, 30.0], [0.0, 40.0]], 1e-3);
        assert_eq!(profile, [[0.0, 0.0], [0.02, 0.0], [0.01, 0.03], [0.0, 0.04]]);
    }

    #[test]
    fn a_smooth_curve_goes_through_its_points() {
        let points = [[1.0, 0.0], [2.0, 1.0], [1.5, 2.0]];
        let profile = smooth_profile(&points, 4, 1.0);
        for point in points {
            assert!(profile.contains(&point), "{point:?} in {profile:?}");
        }
        assert_eq!((profile[0], profile[profile.len() - 1]), ([0.0, 0.0], [0.0, 2.0]));
    }
}
