//! Rebuilding of any set of triangles as a watertight mesh: the sign of the distance comes from the winding number, the
//! surface from marching tetrahedra over a regular grid.
//!
//! Every grid cube is cut into the same six tetrahedra along its diagonal, so that neighbours agree on their common
//! faces and the surface is closed by construction.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::mesh::{GeometryError, Mesh, to_parry};
use super::winding::WindingTree;

/// Number of cells along the longest side.
const CELLS_PER_SIDE: f64 = 56.0;
/// Smallest cell size, m.
const MIN_CELL_SIZE: f64 = 1.5e-3;
/// Least distance of surface vertices from the ends of their grid edge, as a share of the edge; it avoids slivers.
const EDGE_END_MARGIN: f64 = 0.05;
/// Number of cells around the vertices on each side.
const MARGIN_CELLS: f64 = 1.5;
/// Winding number above which a point is inside.
const INSIDE_WINDING: f64 = 0.5;

/// Values at the nodes of a grid.
struct Grid {
    origin: Point3<f64>,
    cell: f64,
    size: [usize; 3],
    /// Signed distances, m, negative inside.
    values: Vec<f64>,
}

impl Grid {
    fn node(&self, at: [usize; 3]) -> usize {
        (at[2] * self.size[1] + at[1]) * self.size[0] + at[0]
    }

    fn node_position(&self, node: usize) -> Point3<f64> {
        let (x, rest) = (node % self.size[0], node / self.size[0]);
        let (y, z) = (rest % self.size[1], rest / self.size[1]);
        self.origin + Vector3::new(x as f64, y as f64, z as f64) * self.cell
    }
}

/// Returns the bounding box of the vertices, m.
fn bounds(vertices: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let start = (Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY)));
    vertices.iter().fold(start, |(low, high), vertex| (low.inf(vertex), high.sup(vertex)))
}

impl Mesh {
    /// Returns the cell size of the first grid on which triangles with these vertices are rebuilt, m: a 56th of the
    /// longest side, 1.5 mm at least.
    pub(super) fn rebuilding_cell(vertices: &[Point3<f64>]) -> f64 {
        let (low, high) = bounds(vertices);
        MIN_CELL_SIZE.max((high - low).max() / CELLS_PER_SIDE)
    }

    /// Returns the number of nodes of a grid around these vertices with cells of `cell`, m.
    pub(super) fn rebuilding_nodes(vertices: &[Point3<f64>], cell: f64) -> f64 {
        let (low, high) = bounds(vertices);
        (high - low).iter().map(|side| side / cell + 2.0 * MARGIN_CELLS + 1.0).product()
    }

    /// Returns a watertight mesh that follows triangles, which may have holes and overlap, to about half of a grid cell
    /// of `cell`, m. All vertices must belong to triangles, and all triangles must have an area.
    pub(super) fn rebuilt(vertices: &[Point3<f64>], triangles: &[[u32; 3]], cell: f64) -> Result<Self, GeometryError> {
        let fault = |found: String, expected: &str| GeometryError::Element {
            element: "mesh".into(),
            found,
            expected: expected.into(),
        };
        let grid = sample(vertices, triangles, &bounds(vertices), cell)
            .map_err(|error| fault(error, "triangles that a distance can be measured to"))?;
        if !grid.values.iter().any(|value| *value < 0.0) {
            return Err(fault(
                "triangles that wind around no volume".into(),
                "a surface that encloses something, even if it has holes",
            ));
        }
        let (points, faces) = marching_tetrahedra(&grid);
        Self::new(points, faces)
    }
}

fn sample(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
    (low, high): &(Point3<f64>, Point3<f64>),
    cell: f64,
) -> Result<Grid, String> {
    let surface =
        TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).map_err(|error| error.to_string())?;
    let winding = WindingTree::new(vertices, triangles);
    let margin = MARGIN_CELLS * cell;
    let origin = low - Vector3::repeat(margin);
    let size = [0, 1, 2].map(|axis| ((high[axis] - low[axis] + 2.0 * margin) / cell).ceil() as usize + 1);
    let mut grid = Grid { origin, cell, size, values: Vec::new() };
    grid.values = (0..size.iter().product())
        .map(|node| {
            let point = grid.node_position(node);
            let distance = surface.distance_to_local_point(to_parry(&point), false).max(1e-9);
            // An inside-out surface has a negative winding number.
            if winding.winding_number(&point).abs() > INSIDE_WINDING { -distance } else { distance }
        })
        .collect();
    // The border counts as outside, even near stray triangles: the surface has to close within the grid.
    for node in 0..grid.values.len() {
        let (x, rest) = (node % size[0], node / size[0]);
        let at = [x, rest % size[1], rest / size[1]];
        if (0..3).any(|axis| at[axis] == 0 || at[axis] + 1 == size[axis]) {
            grid.values[node] = grid.values[node].abs();
        }
    }
    Ok(grid)
}

/// Orders in which the three axes are walked from one corner of a cube to the opposite one; each order defines a
/// tetrahedron.
const AXIS_ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

fn marching_tetrahedra(grid: &Grid) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    let mut known: HashMap<(usize, usize), u32> = HashMap::new();
    let [nx, ny, nz] = grid.size;
    for (k, j, i) in (0..nz - 1).flat_map(|k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| (k, j, i)))) {
        for walk in AXIS_ORDERS {
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
                    let part = (fa / (fa - fb)).clamp(EDGE_END_MARGIN, 1.0 - EDGE_END_MARGIN);
                    points.push(grid.node_position(a) + (grid.node_position(b) - grid.node_position(a)) * part);
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
                nodes.iter().map(|node| grid.node_position(*node).coords).sum::<Vector3<f64>>() / nodes.len() as f64
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
    use crate::geometry::ObjectShape;

    fn ball() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (points, triangles, _) = ObjectShape::Sphere { radius: 0.03 }.triangles();
        (points, triangles)
    }

    /// A ball with a hole is closed again, with its volume and its surface, and so is an inside-out ball.
    #[test]
    fn a_broken_ball_is_closed_again() {
        let (points, mut triangles) = ball();
        let cell = Mesh::rebuilding_cell(&points);
        assert!((cell - MIN_CELL_SIZE).abs() < 1e-12, "{cell}");
        for keep in [1.0, 0.98] {
            triangles.truncate((triangles.len() as f64 * keep) as usize);
            let mesh = Mesh::rebuilt(&points, &triangles, cell).expect("rebuilt");
            let volume = 4.0 / 3.0 * std::f64::consts::PI * 0.03f64.powi(3);
            assert!((mesh.volume() / volume - 1.0).abs() < 0.03, "{} {volume}", mesh.volume());
            let off = mesh.vertices().iter().map(|p| (p.coords.norm() - 0.03).abs()).fold(0.0, f64::max);
            assert!(off < if keep == 1.0 { 1e-3 } else { 8e-3 }, "{off}");
        }
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        assert!(Mesh::rebuilt(&points, &triangles, cell).expect("rebuilt").volume() > 1e-4);
    }
}
