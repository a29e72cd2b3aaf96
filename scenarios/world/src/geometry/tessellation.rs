//! Tessellations for display, and points distributed over them.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use nalgebra::{Point3, Vector3};

use super::mesh::Mesh;

/// Points (m), triangles, one unit normal per point.
pub type Tessellation = (Vec<Point3<f64>>, Vec<[u32; 3]>, Vec<Vector3<f64>>);

const SEGMENTS: usize = 48;
/// Cosine of the angle between faces below which their edge is drawn smooth.
const SMOOTH_EDGE_COSINE: f64 = 0.819;

/// Adds a grid of `rows` x `columns` quads whose points (rows + 1) x (columns + 1) come from `point`.
fn grid(
    out: &mut Tessellation,
    rows: usize,
    columns: usize,
    point: impl Fn(usize, usize) -> (Point3<f64>, Vector3<f64>),
) {
    let base = out.0.len() as u32;
    for row in 0..=rows {
        for column in 0..=columns {
            let (at, normal) = point(row, column);
            out.0.push(at);
            out.2.push(normal);
        }
    }
    let at = |row: usize, column: usize| base + (row * (columns + 1) + column) as u32;
    for row in 0..rows {
        for column in 0..columns {
            let (a, b, c, d) = (at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column));
            for triangle in [[a, b, c], [a, c, d]] {
                let [p, q, r] = triangle.map(|index| out.0[index as usize]);
                if (q - p).cross(&(r - p)).norm() > 1e-14 {
                    out.1.push(triangle);
                }
            }
        }
    }
}

fn around(step: usize) -> Vector3<f64> {
    let angle = TAU * (step % SEGMENTS) as f64 / SEGMENTS as f64;
    Vector3::new(angle.cos(), angle.sin(), 0.0)
}

pub fn sphere(radius: f64) -> Tessellation {
    let mut out = Tessellation::default();
    let rows = SEGMENTS / 2;
    grid(&mut out, rows, SEGMENTS, |row, column| {
        let tilt = PI * row as f64 / rows as f64;
        let normal = around(column) * tilt.sin() - Vector3::z() * tilt.cos();
        (Point3::from(normal * radius), normal)
    });
    out
}

pub fn cylinder(radius: f64, half_height: f64) -> Tessellation {
    let mut out = Tessellation::default();
    let at = |radius: f64, z: f64, column: usize| Point3::from(around(column) * radius + Vector3::z() * z);
    grid(&mut out, 1, SEGMENTS, |row, column| (at(radius * row as f64, -half_height, column), -Vector3::z()));
    grid(&mut out, 4, SEGMENTS, |row, column| {
        (at(radius, half_height * (0.5 * row as f64 - 1.0), column), around(column))
    });
    grid(&mut out, 1, SEGMENTS, |row, column| (at(radius * (1 - row) as f64, half_height, column), Vector3::z()));
    out
}

/// Tessellates a rounded box: each face of a cube of directions is cut in its middle, where the flat face is inserted.
pub fn cuboid(half: &Vector3<f64>, radius: f64) -> Tessellation {
    let mut out = Tessellation::default();
    let inner = half.add_scalar(-radius);
    let steps = if radius > 0.0 { 4 } else { 0 };
    // (tangent of the angle from the face's axis, side)
    let lines: Vec<(f64, f64)> = (0..=steps)
        .map(|n| ((FRAC_PI_4 * (n as f64 - steps as f64) / steps.max(1) as f64).tan(), -1.0))
        .chain((0..=steps).map(|n| ((FRAC_PI_4 * n as f64 / steps.max(1) as f64).tan(), 1.0)))
        .collect();
    for axis in 0..3 {
        for side in [1.0, -1.0] {
            let unit = |n: usize| Vector3::ith(n % 3, 1.0);
            let (w, u) = (unit(axis) * side, unit(axis + 1));
            let v = w.cross(&u);
            let inner_along = |direction: Vector3<f64>| direction.component_mul(&inner);
            grid(&mut out, lines.len() - 1, lines.len() - 1, |row, column| {
                let normal = (w + u * lines[column].0 + v * lines[row].0).normalize();
                let corner = inner_along(w) + inner_along(u) * lines[column].1 + inner_along(v) * lines[row].1;
                (Point3::from(corner + normal * radius), normal)
            });
        }
    }
    out
}

/// Tessellates a mesh: every corner gets the mean normal of the faces around it that meet at a shallow angle.
pub fn mesh(mesh: &Mesh) -> Tessellation {
    let corners: Vec<[Point3<f64>; 3]> =
        mesh.triangles().iter().map(|triangle| triangle.map(|index| mesh.vertices()[index as usize])).collect();
    let scaled: Vec<Vector3<f64>> = corners.iter().map(|[a, b, c]| (b - a).cross(&(c - a))).collect();
    let mut around: Vec<Vec<usize>> = vec![Vec::new(); mesh.vertices().len()];
    for (face, triangle) in mesh.triangles().iter().enumerate() {
        triangle.iter().for_each(|&index| around[index as usize].push(face));
    }
    let mut out = Tessellation::default();
    for (face, triangle) in mesh.triangles().iter().enumerate() {
        let own = scaled[face].normalize();
        let base = out.0.len() as u32;
        for (corner, &index) in triangle.iter().enumerate() {
            let smooth: Vector3<f64> = around[index as usize]
                .iter()
                .map(|&other| scaled[other])
                .filter(|other| other.normalize().dot(&own) > SMOOTH_EDGE_COSINE)
                .sum();
            out.0.push(corners[face][corner]);
            out.2.push(smooth.normalize());
        }
        out.1.push([base, base + 1, base + 2]);
    }
    out
}

/// Distributes points by area: equal steps along the triangles' cumulative area, golden-ratio steps within them.
pub fn sample(points: &[Point3<f64>], triangles: &[[u32; 3]], n: usize) -> Vec<Point3<f64>> {
    let mut cumulated = Vec::with_capacity(triangles.len());
    let mut total = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|index| points[index as usize]);
        total += 0.5 * (b - a).cross(&(c - a)).norm();
        cumulated.push(total);
    }
    (0..n)
        .map(|k| {
            let area = total * (k as f64 + 0.5) / n as f64;
            let triangle = cumulated.partition_point(|&sum| sum < area).min(triangles.len() - 1);
            let [a, b, c] = triangles[triangle].map(|index| points[index as usize]);
            let (s, t) = (
                (0.5 + 0.754_877_666_246_692_7 * k as f64).fract(),
                (0.5 + 0.569_840_290_998_053_2 * k as f64).fract(),
            );
            let root = s.sqrt();
            a + (b - a) * (root * (1.0 - t)) + (c - a) * (root * t)
        })
        .collect()
}
