//! Outlines and points of the irregular objects, m.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use crate::geometry::Profile;

const RINGS: usize = 28;

/// `width` (radius over largest radius) as a function of u, -1 at the bottom to 1 at the top, scaled to diameter and length in
/// mm. Rings are spaced as on a ball.
fn round(diameter: f64, length: f64, width: impl Fn(f64) -> f64) -> Profile {
    let us: Vec<f64> = (0..=RINGS).map(|n| -(PI * n as f64 / RINGS as f64).cos()).collect();
    let widest = us.iter().map(|&u| width(u)).fold(0.0, f64::max);
    us.iter()
        .enumerate()
        .map(|(n, &u)| {
            let radius = if n == 0 || n == RINGS { 0.0 } else { 0.5e-3 * diameter * width(u) / widest };
            [radius, 0.5e-3 * length * u]
        })
        .collect()
}

/// A smooth curve (Catmull-Rom) through points (radius, z) in mm, closed by flat or pointed ends on the axis.
fn smooth(points: &[[f64; 2]], steps: usize) -> Profile {
    let at = |n: isize| points[n.clamp(0, points.len() as isize - 1) as usize];
    let mut profile: Profile = vec![[0.0, points[0][1] * 1e-3]];
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
            profile.push([blend(0) * 1e-3, blend(1) * 1e-3]);
        }
    }
    let last = at(points.len() as isize - 1);
    if last[0] > 0.0 {
        profile.push([last[0] * 1e-3, last[1] * 1e-3]);
    }
    profile.push([0.0, last[1] * 1e-3]);
    profile
}

/// A hen's egg, 44 x 58 mm, the blunt end down.
pub fn egg() -> Profile {
    round(44.0, 58.0, |u| (1.0 - u * u).sqrt() * (1.0 - 0.14 * u))
}

/// A lemon: an arc turned about its chord, 46 x 60 mm, pointed at both ends.
pub fn lemon() -> Profile {
    let arc = (30.0_f64.powi(2) + 23.0_f64.powi(2)) / (2.0 * 23.0);
    round(46.0, 60.0, |u| (arc * arc - (30.0 * u).powi(2)).sqrt() - (arc - 23.0))
}

/// Two lobes with a waist, 44 x 64 mm.
pub fn peanut() -> Profile {
    round(44.0, 64.0, |u| (1.0 - u * u).sqrt() * (1.0 - 0.32 * (-(u / 0.3).powi(2)).exp()))
}

/// A pear with a flat bottom, 50 x 62 mm.
pub fn pear() -> Profile {
    let outline = [
        [14.0, 0.0],
        [20.5, 4.0],
        [24.2, 11.0],
        [25.0, 19.0],
        [23.0, 28.0],
        [17.5, 37.0],
        [13.0, 45.0],
        [11.0, 52.0],
        [8.0, 58.5],
        [3.0, 62.0],
    ];
    smooth(&outline, 3)
}

/// A chess pawn, base 44 mm, 58 mm high.
pub fn pawn() -> Profile {
    let mut profile: Profile =
        smooth(&[[21.0, 0.0], [22.0, 1.5], [22.0, 6.0], [18.0, 9.0], [13.5, 15.0], [10.5, 24.0], [9.5, 33.0]], 3);
    profile.pop();
    // collar, then a ball of radius 11 around z = 47
    profile.extend([[13.0e-3, 34.5e-3], [13.0e-3, 37.0e-3], [8.0e-3, 39.45e-3]]);
    let from = 8.0_f64.atan2(7.55);
    let steps = 12;
    for n in 1..=steps {
        let angle = from + (PI - from) * f64::from(n) / f64::from(steps);
        let radius = if n == steps { 0.0 } else { 11.0e-3 * angle.sin() };
        profile.push([radius, 47.0e-3 - 11.0e-3 * angle.cos()]);
    }
    profile
}

/// Corners of an irregular convex body about 50 mm across with a flat bottom: evenly spread directions, uneven lengths.
pub fn polyhedron() -> Vec<Point3<f64>> {
    let count = 26;
    (0..count)
        .map(|n| {
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / f64::from(count);
            let angle = 2.399_963_229_728_653 * f64::from(n);
            let across = (1.0 - z * z).sqrt();
            let length = 22.5e-3 + 5e-3 * (0.618_033_988_749_895 * f64::from(n * n + 1)).fract();
            let corner = Vector3::new(across * angle.cos(), across * angle.sin(), z) * length;
            Point3::new(corner.x, corner.y, corner.z.max(-18e-3))
        })
        .collect()
}

/// Corners of a cut stone: three rings of eight, girdle 48 mm, 42 mm high.
pub fn gem() -> Vec<Point3<f64>> {
    [(15.0e-3, 0.0, 0.0), (24.0e-3, 17.0e-3, 0.5), (13.0e-3, 42.0e-3, 0.0)]
        .into_iter()
        .flat_map(|(radius, z, turn)| {
            (0..8).map(move |n| {
                let angle = TAU * (f64::from(n) + turn) / 8.0;
                Point3::new(radius * angle.cos(), radius * angle.sin(), z)
            })
        })
        .collect()
}

/// A bulging vase with a narrow neck and a lip, 64 mm wide, 105 mm high.
pub fn vase() -> Profile {
    let outline = [
        [18.0, 0.0],
        [22.0, 6.0],
        [29.0, 22.0],
        [32.0, 40.0],
        [28.0, 58.0],
        [19.0, 74.0],
        [15.0, 86.0],
        [17.0, 98.0],
        [21.0, 105.0],
    ];
    smooth(&outline, 3)
}

/// A small drinks bottle with a cap, 58 mm wide, 135 mm high. Points are close where the outline turns, so that the curve through
/// them never runs back down.
pub fn bottle() -> Profile {
    let outline = [
        [26.0, 0.0],
        [28.0, 2.0],
        [29.0, 6.0],
        [29.0, 14.0],
        [29.0, 30.0],
        [29.0, 54.0],
        [29.0, 76.0],
        [26.0, 92.0],
        [18.0, 104.0],
        [14.5, 114.0],
        [14.5, 124.0],
        [14.5, 135.0],
    ];
    smooth(&outline, 3)
}
