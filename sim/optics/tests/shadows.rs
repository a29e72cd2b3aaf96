//! Cast shadows against the paper's reference, hidden-point removal (Katz, Tal and Basri 2007), and against rays.
//!
//! Hidden-point removal: points are flipped about a large sphere around the lamp, `p -> p + 2 (R - |p|) p / |p|`; those
//! on the convex hull of the flipped points and the lamp are visible from it, the others are hidden.

#![allow(clippy::unwrap_used)]

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};
use tactile_optics::lamps::Lamp;
use tactile_optics::shadows::{HeightField, Shadow};

/// Side of the square field, m.
const FIELD_SIDE: f64 = 12e-3;
/// Number of pixels along a side: coarse enough for hidden-point removal's hull, and as fine as a pad's images.
const COARSE_PIXELS: usize = 48;
const FINE_PIXELS: usize = 120;

/// Samples the depth of the gel as a function of position (m).
fn field(side: usize, depth: &dyn Fn(f64, f64) -> f64) -> Vec<f32> {
    (0..side * side).map(|at| place(side, at)).map(|(x, y)| depth(x, y) as f32).collect()
}

fn place(side: usize, at: usize) -> (f64, f64) {
    let (middle, pixel) = (0.5 * (side - 1) as f64, FIELD_SIDE / side as f64);
    (((at % side) as f64 - middle) * pixel, (middle - (at / side) as f64) * pixel)
}

/// Returns the pixels that see less than half of the lamp, by the renderer's own shadows.
fn fast(side: usize, depth: &[f32], lamp: &Lamp) -> Vec<bool> {
    let pixel = FIELD_SIDE / side as f64;
    let field = HeightField { width: side, height: side, first: place(side, 0), pixel: (pixel, pixel), depth };
    let shadow: Option<Shadow> = field.shadow(lamp);
    let seen = |at: usize| {
        shadow.as_ref().map_or(1.0, |shadow| shadow.visible_share_at((at % side) as f64, (at / side) as f64))
    };
    (0..side * side).map(|at| seen(at) < 0.5).collect()
}

/// Returns the pixels that hidden-point removal finds hidden from the lamp.
fn hidden_points(side: usize, depth: &[f32], lamp: &Lamp) -> Vec<bool> {
    let from_lamp: Vec<Vector3<f64>> = (0..depth.len())
        .map(|at| (place(side, at), f64::from(depth[at])))
        .map(|((x, y), depth)| Point3::new(x, y, -depth) - lamp.position)
        .enumerate()
        // A row of the grid and the lamp lie in one plane; a hull needs points in general position.
        .map(|(n, p)| p + 1e-10 * Vector3::new(jitter(3 * n), jitter(3 * n + 1), jitter(3 * n + 2)))
        .collect();
    let farthest = from_lamp.iter().map(Vector3::norm).fold(0.0, f64::max);
    let radius = FLIP_RADIUS * farthest;
    let mut points: Vec<Vector3<f64>> =
        from_lamp.iter().map(|p| p + p.normalize() * (2.0 * (radius - p.norm()))).collect();
    points.push(Vector3::zeros());
    let on_hull = hull_vertices(&points);
    on_hull[..depth.len()].iter().map(|seen| !seen).collect()
}

/// Returns a pseudo-random number from -1 to 1.
fn jitter(n: usize) -> f64 {
    (n as f64 * 12.9898 + 4.1414).sin() * 43_758.545_3 % 1.0
}

/// Radius of the flipping sphere, relative to the distance of the farthest point.
const FLIP_RADIUS: f64 = 100.0;

/// Finds the points that are vertices of the convex hull: points are added one by one in a shuffled order, and each
/// replaces the faces it sees.
fn hull_vertices(points: &[Vector3<f64>]) -> Vec<bool> {
    let farthest = |value: &dyn Fn(&Vector3<f64>) -> f64| {
        (0..points.len()).max_by(|a, b| value(&points[*a]).total_cmp(&value(&points[*b]))).unwrap()
    };
    let a = points.len() - 1;
    let b = farthest(&|p| (p - points[a]).norm());
    let along = (points[b] - points[a]).normalize();
    let c = farthest(&|p| (p - points[a]).cross(&along).norm());
    let across = along.cross(&(points[c] - points[a]));
    let d = farthest(&|p| (p - points[a]).dot(&across).abs());
    let inside = (points[a] + points[b] + points[c] + points[d]) / 4.0;
    let face = |corners: [usize; 3]| {
        let [p, q, r] = corners.map(|corner| points[corner]);
        let normal = (q - p).cross(&(r - p)).normalize();
        (corners, normal, normal.dot(&p))
    };
    let outward = |corners: [usize; 3]| {
        let (_, normal, offset) = face(corners);
        if normal.dot(&inside) > offset { face([corners[0], corners[2], corners[1]]) } else { face(corners) }
    };
    let mut faces = vec![outward([a, b, c]), outward([a, b, d]), outward([a, c, d]), outward([b, c, d])];
    let mut order: Vec<usize> = (0..points.len()).filter(|p| ![a, b, c, d].contains(p)).collect();
    order.sort_by_key(|p| p.wrapping_mul(2_654_435_761) % 1_000_003);
    let slack = 1e-13 * points.iter().map(Vector3::norm).fold(0.0, f64::max);
    for p in order {
        let sees = |face: &([usize; 3], Vector3<f64>, f64)| face.1.dot(&points[p]) > face.2 + slack;
        let mut edges = HashSet::new();
        for (corners, ..) in faces.iter().filter(|face| sees(face)) {
            edges.extend((0..3).map(|i| (corners[i], corners[(i + 1) % 3])));
        }
        if edges.is_empty() {
            continue;
        }
        // Euler: a closed surface of triangles has fewer than two faces per vertex.
        assert!(faces.len() < 2 * points.len(), "the hull has come apart");
        faces.retain(|face| !sees(face));
        faces.extend(edges.iter().filter(|(q, r)| !edges.contains(&(*r, *q))).map(|&(q, r)| face([q, r, p])));
    }
    let mut corner = vec![false; points.len()];
    faces.iter().flat_map(|(corners, ..)| corners).for_each(|&at| corner[at] = true);
    corner
}

#[test]
fn the_hull_of_a_cube_is_its_corners() {
    let mut points: Vec<Vector3<f64>> = (0..27)
        .map(|i| Vector3::new(f64::from(i % 3) - 1.0, f64::from(i / 3 % 3) - 1.0, f64::from(i / 9) - 1.0) * 0.999)
        .map(|p| if p.norm() > 1.7 { p / 0.999 } else { 0.9 * p })
        .collect();
    points.push(Vector3::new(0.0, 0.0, 3.0));
    let corner = hull_vertices(&points);
    for (p, corner) in points.iter().zip(corner) {
        assert_eq!(corner, p.norm() > 1.7, "{p}");
    }
}

/// Returns the pixels from which a straight line to the lamp intersects the gel.
fn blocked_rays(side: usize, depth: &[f32], lamp: &Lamp) -> Vec<bool> {
    let (middle, pixel) = (0.5 * (side - 1) as f64, FIELD_SIDE / side as f64);
    let height = |x: f64, y: f64| {
        let (column, row) = (x / pixel + middle, middle - y / pixel);
        if !(0.0..(side - 1) as f64).contains(&column) || !(0.0..(side - 1) as f64).contains(&row) {
            return 0.0;
        }
        let (c, r) = (column as usize, row as usize);
        let (u, v) = (column - c as f64, row - r as f64);
        let at = |r: usize, c: usize| f64::from(depth[r * side + c]);
        (1.0 - v) * ((1.0 - u) * at(r, c) + u * at(r, c + 1)) + v * ((1.0 - u) * at(r + 1, c) + u * at(r + 1, c + 1))
    };
    (0..depth.len())
        .map(|at| {
            let (x, y) = place(side, at);
            let start = Point3::new(x, y, -f64::from(depth[at]));
            let way = lamp.position - start;
            (1..600).map(|i| f64::from(i) / 600.0).any(|t| {
                let p = start + way * t;
                height(p.x, p.y) > -p.z + 2e-6
            })
        })
        .collect()
}

/// Depth of the gel (m) as a function of position (m).
type Shape = Box<dyn Fn(f64, f64) -> f64>;

/// Returns a ball's cap, a post with a step, and hills: smooth and sharp borders.
fn shapes() -> [(&'static str, Shape); 3] {
    let ball = |x: f64, y: f64| ((2.5e-3f64.powi(2) - x * x - y * y).max(0.0).sqrt() - 1.3e-3).max(0.0);
    let post = |x: f64, y: f64| if x.abs() < 1.2e-3 && (y - 0.3e-3).abs() < 0.9e-3 { 0.9e-3 } else { 0.0 };
    let hills = |x: f64, y: f64| {
        let hill = |a: f64, b: f64, h: f64| h * (-((x - a).powi(2) + (y - b).powi(2)) / 0.8e-6).exp();
        hill(-2e-3, 1e-3, 1.1e-3) + hill(1.5e-3, -1.5e-3, 0.8e-3) + hill(2e-3, 2e-3, 0.6e-3)
    };
    [("ball", Box::new(ball)), ("post", Box::new(post)), ("hills", Box::new(hills))]
}

fn lamps() -> [Lamp; 4] {
    [(12e-3, 1e-3, 3e-3), (-5e-3, 11e-3, 4e-3), (-9e-3, -7e-3, 2.5e-3), (0.7e-3, -0.4e-3, 8e-3)].map(|(x, y, depth)| {
        let position = Point3::new(x, y, -depth);
        // Nearly a point, so that there is a border to compare.
        Lamp { size: 0.05e-3, ..Lamp::aimed(position, Point3::origin(), 1.0, 1.0, [1.0; 3]) }
    })
}

/// Computes the share of pixels on which two masks agree, and the ratio of their intersection to their union.
fn agreement(a: &[bool], b: &[bool]) -> (f64, f64) {
    let count = |test: fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| test(**a, **b)).count() as f64;
    let union = count(|a, b| a || b);
    (count(|a, b| a == b) / a.len() as f64, if union > 0.0 { count(|a, b| a && b) / union } else { 1.0 })
}

#[test]
fn shadows_are_where_hidden_point_removal_and_rays_have_them() {
    println!("scene  lamp  shaded px   fast-rays  hpr-rays  fast-hpr   fast-rays on {FINE_PIXELS} px");
    for (name, shape) in shapes() {
        let (coarse, fine) = (field(COARSE_PIXELS, &*shape), field(FINE_PIXELS, &*shape));
        for (k, lamp) in lamps().iter().enumerate() {
            let ours = fast(COARSE_PIXELS, &coarse, lamp);
            let (hidden, blocked) =
                (hidden_points(COARSE_PIXELS, &coarse, lamp), blocked_rays(COARSE_PIXELS, &coarse, lamp));
            let shaded = blocked.iter().filter(|blocked| **blocked).count();
            let (with_hidden, with_rays) = (agreement(&ours, &hidden), agreement(&ours, &blocked));
            let of_references = agreement(&hidden, &blocked);
            let as_fine = agreement(&fast(FINE_PIXELS, &fine, lamp), &blocked_rays(FINE_PIXELS, &fine, lamp));
            println!(
                "{name:6} {k:4} {shaded:10} {:10.3} {:9.3} {:9.3} {:11.3}",
                with_rays.0, of_references.0, with_hidden.0, as_fine.0
            );
            // Measured: at least 0.949 and 0.65 with rays, 0.842 with hidden-point removal, which itself agrees with rays to
            // 0.875: it hides points at grazing light that a straight line reaches.
            assert!(with_rays.0 > 0.94 && with_rays.1 > 0.6, "{name} lamp {k}, {shaded} px: rays {with_rays:?}");
            assert!(
                with_hidden.0 > 0.83 && with_hidden.0 > of_references.0 - 0.06,
                "{name} lamp {k}, {shaded} px: hidden points {with_hidden:?}, them with rays {of_references:?}"
            );
            assert!(as_fine.0 > 0.96, "{name} lamp {k}: rays, fine {as_fine:?}");
            if shaded > 0 {
                assert!(with_rays.0 >= of_references.0 - 0.01, "{name} lamp {k}: hidden points are nearer to rays");
            }
        }
    }
}
