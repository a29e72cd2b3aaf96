//! A watertight mesh from any set of triangles: the sign of the distance comes from the winding number, the surface from
//! marching tetrahedra over a regular grid.
//!
//! Every grid cube is cut into the same six tetrahedra along its diagonal, so that neighbours agree on their common faces and
//! the surface closes by construction.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::mesh::{GeometryError, MAX_EXTENT, Mesh, to_parry};
use super::winding::Winding;

/// Cells along the longest side.
const CELLS: f64 = 56.0;
/// No finer than this, m.
const FINEST: f64 = 1.5e-3;
/// Surface vertices keep off the ends of their edge by this share of it: no slivers.
const OFF_ENDS: f64 = 0.05;
/// Inside is where the surface winds around more than this.
const INSIDE: f64 = 0.5;

/// The values at the grid's nodes.
struct Grid {
    origin: Point3<f64>,
    cell: f64,
    size: [usize; 3],
    /// Signed distance, m, negative inside.
    values: Vec<f64>,
}

impl Grid {
    fn node(&self, at: [usize; 3]) -> usize {
        (at[2] * self.size[1] + at[1]) * self.size[0] + at[0]
    }

    fn place(&self, node: usize) -> Point3<f64> {
        let (x, rest) = (node % self.size[0], node / self.size[0]);
        let (y, z) = (rest % self.size[1], rest / self.size[1]);
        self.origin + Vector3::new(x as f64, y as f64, z as f64) * self.cell
    }
}

impl Mesh {
    /// A watertight mesh that follows `triangles` to about half a grid cell (a 56th of the longest side, 1.5 mm at least), which
    /// may have holes, overlap, or be a million. Gives the mesh and the cell, m.
    pub fn mended(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(Self, f64), GeometryError> {
        let fault = |found: String, expected: &str| GeometryError::Element {
            element: "mesh".into(),
            found,
            expected: expected.into(),
        };
        let usable: Vec<[u32; 3]> = triangles
            .iter()
            .filter(|triangle| {
                let [Some(a), Some(b), Some(c)] = triangle.map(|index| vertices.get(index as usize)) else {
                    return false;
                };
                let area = (b - a).cross(&(c - a)).norm();
                area.is_finite() && area > 1e-16
            })
            .copied()
            .collect();
        if usable.len() < 4 {
            return Err(fault(format!("{} triangles with an area", usable.len()), "at least 4"));
        }
        let used = usable.iter().flatten().map(|index| vertices[*index as usize]);
        let start = (Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY)));
        let (low, high) = used.fold(start, |(low, high), vertex| (low.inf(&vertex), high.sup(&vertex)));
        let extent = (high - low).max();
        if extent > MAX_EXTENT {
            return Err(GeometryError::Units { found: extent });
        }
        let cell = FINEST.max(extent / CELLS);
        let grid = sample(vertices, &usable, (&low, &high), cell)
            .map_err(|error| fault(error, "triangles that a distance can be measured to"))?;
        if !grid.values.iter().any(|value| *value < 0.0) {
            return Err(fault(
                "triangles that wind around no volume".into(),
                "a surface that encloses something, even if it has holes",
            ));
        }
        let (points, faces) = march(&grid);
        Ok((Self::new(points, faces)?, cell))
    }
}

fn sample(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
    (low, high): (&Point3<f64>, &Point3<f64>),
    cell: f64,
) -> Result<Grid, String> {
    let surface =
        TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).map_err(|error| error.to_string())?;
    let winding = Winding::new(vertices, triangles);
    let margin = 1.5 * cell;
    let origin = low - Vector3::repeat(margin);
    let size = [0, 1, 2].map(|axis| ((high[axis] - low[axis] + 2.0 * margin) / cell).ceil() as usize + 1);
    let mut grid = Grid { origin, cell, size, values: Vec::new() };
    grid.values = (0..size.iter().product())
        .map(|node| {
            let point = grid.place(node);
            let distance = surface.distance_to_local_point(to_parry(&point), false).max(1e-9);
            // A surface that is inside out winds the other way.
            if winding.at(&point).abs() > INSIDE { -distance } else { distance }
        })
        .collect();
    // The border is outside, whatever a stray triangle makes of it: the surface has to close within the grid.
    for node in 0..grid.values.len() {
        let (x, rest) = (node % size[0], node / size[0]);
        let at = [x, rest % size[1], rest / size[1]];
        if (0..3).any(|axis| at[axis] == 0 || at[axis] + 1 == size[axis]) {
            grid.values[node] = grid.values[node].abs();
        }
    }
    Ok(grid)
}

/// Orders in which the three axes are walked from one corner of a cube to the opposite one: a tetrahedron each.
const WALKS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

fn march(grid: &Grid) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    let mut known: HashMap<(usize, usize), u32> = HashMap::new();
    let [nx, ny, nz] = grid.size;
    for (k, j, i) in (0..nz - 1).flat_map(|k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| (k, j, i)))) {
        for walk in WALKS {
            let mut at = [i, j, k];
            let mut corners = [grid.node(at); 4];
            for (n, axis) in walk.into_iter().enumerate() {
                at[axis] += 1;
                corners[n + 1] = grid.node(at);
            }
            let (inside, outside): (Vec<usize>, Vec<usize>) =
                corners.into_iter().partition(|node| grid.values[*node] < 0.0);
            let mut cut = |a: usize, b: usize| {
                *known.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let (fa, fb) = (grid.values[a], grid.values[b]);
                    let part = (fa / (fa - fb)).clamp(OFF_ENDS, 1.0 - OFF_ENDS);
                    points.push(grid.place(a) + (grid.place(b) - grid.place(a)) * part);
                    points.len() as u32 - 1
                })
            };
            let found: Vec<[u32; 3]> = match (&inside[..], &outside[..]) {
                (&[a], &[b, c, d]) | (&[b, c, d], &[a]) => vec![[cut(a, b), cut(a, c), cut(a, d)]],
                (&[a, b], &[c, d]) => {
                    let (p, q, r, s) = (cut(a, c), cut(a, d), cut(b, d), cut(b, c));
                    vec![[p, q, r], [p, r, s]]
                }
                _ => continue,
            };
            let mean = |nodes: &[usize]| {
                nodes.iter().map(|node| grid.place(*node).coords).sum::<Vector3<f64>>() / nodes.len() as f64
            };
            let outwards = mean(&outside) - mean(&inside);
            for mut face in found {
                let [a, b, c] = face.map(|index| points[index as usize]);
                if (b - a).cross(&(c - a)).dot(&outwards) < 0.0 {
                    face.swap(1, 2);
                }
                faces.push(face);
            }
        }
    }
    (points, faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    fn ball() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (points, triangles, _) = Shape::Sphere { radius: 0.03 }.triangles();
        (points, triangles)
    }

    /// A ball of loose triangles, some of them missing, comes back closed, with its volume and its surface.
    #[test]
    fn a_broken_ball_is_closed_again() {
        let (points, mut triangles) = ball();
        for keep in [1.0, 0.98] {
            triangles.truncate((triangles.len() as f64 * keep) as usize);
            let (mesh, cell) = Mesh::mended(&points, &triangles).expect("mended");
            assert!((cell - FINEST).abs() < 1e-12, "{cell}");
            let volume = 4.0 / 3.0 * std::f64::consts::PI * 0.03f64.powi(3);
            assert!((mesh.volume() / volume - 1.0).abs() < 0.03, "{} {volume}", mesh.volume());
            let off = mesh.vertices().iter().map(|p| (p.coords.norm() - 0.03).abs()).fold(0.0, f64::max);
            assert!(off < if keep == 1.0 { 1e-3 } else { 8e-3 }, "{off}");
        }
    }

    /// Inside out is no matter; a sheet encloses nothing and is refused.
    #[test]
    fn sense_does_not_matter_and_volume_does() {
        let (points, mut triangles) = ball();
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        assert!(Mesh::mended(&points, &triangles).expect("mended").0.volume() > 1e-4);
        let sheet: Vec<Point3<f64>> =
            (0..9).map(|n| Point3::new(0.02 * f64::from(n % 3), 0.02 * f64::from(n / 3), 0.0)).collect();
        let faces: Vec<[u32; 3]> = [0, 1, 3, 4].iter().flat_map(|&a| [[a, a + 1, a + 4], [a, a + 4, a + 3]]).collect();
        let error = Mesh::mended(&sheet, &faces).expect_err("flat").to_string();
        assert!(error.contains("wind around no volume"), "{error}");
    }
}
