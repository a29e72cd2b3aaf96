//! Height map of a mesh seen by parallel rays: the height at which each ray first meets the solid.
//!
//! A bounding-volume hierarchy answers rays of any direction one by one. If thousands of them run along the same axis,
//! as under the pixels of a pad, it is cheaper to project the triangles once onto the plane across the axis and to sort
//! them into the cells of a grid. A ray then tests only the few triangles of its cell.

use nalgebra::{Isometry3, Point3};

use super::mesh::Mesh;

/// Edge length of a cell, m: a few pixels of a pad.
const CELL_SIZE: f64 = 5e-4;
/// Greatest number of cells along a side; a large mesh gets larger cells.
const MAX_CELLS_PER_SIDE: usize = 128;
/// Tolerance beside a triangle's edge, relative to the triangle's size, so that no ray slips between two triangles.
const EDGE_TOLERANCE: f64 = 1e-9;
/// Projected area below which a triangle counts as parallel to the rays, m2; its neighbours catch those rays.
const MIN_PROJECTED_AREA: f64 = 1e-18;

/// A triangle over the plane. For `(x, y)` relative to its first corner, the barycentric weight of corner n + 1 is
/// `weights[n] . (x, y)`.
#[derive(Debug, Clone)]
struct Face {
    corner: Point3<f64>,
    weights: [[f64; 2]; 2],
    /// Height of the other two corners over the first, m.
    rises: [f64; 2],
    /// True if a ray leaves the solid here.
    leaves: bool,
}

/// Height map of the side of a mesh that faces down the z axis of a frame.
#[derive(Debug, Clone)]
pub struct MeshHeightMap {
    start: f64,
    low: [f64; 2],
    cell: f64,
    size: [usize; 2],
    faces: Vec<Face>,
    /// The faces of cell n are `members[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl MeshHeightMap {
    /// Builds the height map for rays that start at `start` (m) on z and run along it, over the rectangle from `low` to
    /// `high` (m) of the frame's x and y.
    pub fn new(mesh: &Mesh, frame_from_mesh: &Isometry3<f64>, start: f64, (low, high): ([f64; 2], [f64; 2])) -> Self {
        let vertices: Vec<Point3<f64>> = mesh.vertices().iter().map(|vertex| frame_from_mesh * vertex).collect();
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| vertices[vertex as usize]);
        let mut bounds = [(f64::INFINITY, f64::NEG_INFINITY); 2];
        for axis in 0..2 {
            for vertex in &vertices {
                bounds[axis] = (bounds[axis].0.min(vertex[axis]), bounds[axis].1.max(vertex[axis]));
            }
            bounds[axis] = (bounds[axis].0.max(low[axis]), bounds[axis].1.min(high[axis]));
        }
        let extent = bounds.map(|(low, high)| (high - low).max(0.0));
        let cell = CELL_SIZE.max(extent[0].max(extent[1]) / MAX_CELLS_PER_SIDE as f64);
        let size = extent.map(|extent| (extent / cell) as usize + 1);
        let low = bounds.map(|(low, _)| low);
        let mut relief = Self { start, low, cell, size, faces: Vec::new(), starts: Vec::new(), members: Vec::new() };
        if bounds.iter().all(|(low, high)| low <= high) {
            let over =
                mesh.triangles().iter().map(corners).filter_map(|corners| relief.face_and_cells(corners)).collect();
            relief.store_faces(over);
        } else {
            relief.size = [0; 2];
        }
        relief
    }

    /// Returns a triangle that rays over the grid can meet, with the first and the last cell that it may cover.
    fn face_and_cells(&self, corners: [Point3<f64>; 3]) -> Option<(Face, [[usize; 2]; 2])> {
        if corners.iter().all(|corner| corner.z < self.start) {
            return None;
        }
        let mut cells = [[0; 2]; 2];
        for axis in 0..2 {
            let along = corners.map(|corner| (corner[axis] - self.low[axis]) / self.cell);
            let (least, most) = (along[0].min(along[1]).min(along[2]), along[0].max(along[1]).max(along[2]));
            // Slightly more than the triangle, because of the tolerance at its edges.
            let (least, most) = (least - 1e-6, most + 1e-6);
            if most < 0.0 || least > self.size[axis] as f64 {
                return None;
            }
            cells[0][axis] = least.max(0.0) as usize;
            cells[1][axis] = (most as usize).min(self.size[axis] - 1);
        }
        Some((Face::new(corners)?, cells))
    }

    /// Stores these faces, each in the cells from the first to the last.
    fn store_faces(&mut self, placed: Vec<(Face, [[usize; 2]; 2])>) {
        let width = self.size[0];
        let covered = |[first, last]: &[[usize; 2]; 2]| {
            let (columns, rows) = (first[0]..last[0] + 1, first[1]..last[1] + 1);
            rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
        };
        let mut ends = vec![0_u32; self.size[0] * self.size[1] + 1];
        for (_, cells) in &placed {
            covered(cells).for_each(|cell| ends[cell + 1] += 1);
        }
        for cell in 1..ends.len() {
            ends[cell] += ends[cell - 1];
        }
        let (starts, mut next) = (ends.clone(), ends);
        let mut members = vec![0; starts.last().map_or(0, |end| *end as usize)];
        for (number, (_, cells)) in placed.iter().enumerate() {
            for cell in covered(cells) {
                members[next[cell] as usize] = number as u32;
                next[cell] += 1;
            }
        }
        self.faces = placed.into_iter().map(|(face, _)| face).collect();
        (self.starts, self.members) = (starts, members);
    }

    /// Returns the height (m) at which the ray over (x, y) first meets the solid. It is the start of the ray if that is
    /// inside, and none if the ray misses or is outside the rectangle.
    pub fn height(&self, x: f64, y: f64) -> Option<f64> {
        let [column, row] = [(x, 0), (y, 1)].map(|(place, axis)| ((place - self.low[axis]) / self.cell).floor());
        if !(0.0..self.size[0] as f64).contains(&column) || !(0.0..self.size[1] as f64).contains(&row) {
            return None;
        }
        let cell = row as usize * self.size[0] + column as usize;
        let (mut first, mut leaves) = (f64::INFINITY, false);
        for member in &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize] {
            let face = &self.faces[*member as usize];
            if let Some(height) = face.height(x, y)
                && (self.start..first).contains(&height)
            {
                (first, leaves) = (height, face.leaves);
            }
        }
        // A ray that leaves the solid before it has entered must have started inside.
        (first < f64::INFINITY).then_some(if leaves { self.start } else { first })
    }
}

impl Face {
    /// Returns none for a triangle parallel to the rays.
    fn new([a, b, c]: [Point3<f64>; 3]) -> Option<Self> {
        let twice = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if twice.abs() < MIN_PROJECTED_AREA {
            return None;
        }
        let weights = [[(c.y - a.y) / twice, (a.x - c.x) / twice], [(a.y - b.y) / twice, (b.x - a.x) / twice]];
        Some(Self { corner: a, weights, rises: [b.z - a.z, c.z - a.z], leaves: twice > 0.0 })
    }

    /// Returns the height over (x, y), m; none beside the triangle.
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        let (x, y) = (x - self.corner.x, y - self.corner.y);
        let [b, c] = self.weights.map(|weight| weight[0] * x + weight[1] * y);
        let on = b >= -EDGE_TOLERANCE && c >= -EDGE_TOLERANCE && b + c <= 1.0 + EDGE_TOLERANCE;
        on.then(|| self.corner.z + b * self.rises[0] + c * self.rises[1])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::super::shape::ObjectShape;
    use super::*;
    use crate::objects::ObjectSet;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]
        /// The heights agree with those of single rays, for rays from outside and from inside, over a rectangle that
        /// cuts the mesh.
        #[test]
        fn as_single_rays(turn in prop::array::uniform3(-3.0..3.0_f64), place in prop::array::uniform3(-0.02..0.02_f64)) {
            const START: f64 = -0.006;
            let pose = Isometry3::new(Vector3::from(place), Vector3::from(turn));
            let set = ObjectSet::standard();
            let meshes = set.iter().filter_map(|object| match &object.shape {
                ObjectShape::Mesh(mesh) => Some((&object.name, mesh)),
                _ => None,
            });
            let mut met = 0;
            for (name, mesh) in meshes {
                let relief = MeshHeightMap::new(mesh, &pose, START, ([-0.012; 2], [0.012, 0.02]));
                let along = pose.inverse() * Vector3::z_axis();
                for n in 0..400 {
                    let (x, y) = (-0.0119 + 0.0012 * f64::from(n % 20), -0.0119 + 0.00159 * f64::from(n / 20));
                    let single = mesh.ray(&(pose.inverse() * Point3::new(x, y, START)), &along).map(|way| START + way);
                    let height = relief.height(x, y);
                    match (single, height) {
                        (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-9, "{name} at {x}, {y}: {a}, {b}"),
                        (a, b) => prop_assert!(a == b, "{name} at {x}, {y}: {a:?}, {b:?}"),
                    }
                    met += usize::from(height.is_some());
                }
            }
            prop_assert!(met > 0);
        }
    }

    /// No height outside the rectangle, nor for a mesh below the start or elsewhere.
    #[test]
    fn what_no_ray_meets() {
        let set = ObjectSet::standard();
        let mesh = set.iter().find_map(|object| match &object.shape {
            ObjectShape::Mesh(mesh) => Some(mesh),
            _ => None,
        });
        let mesh = mesh.expect("one has a mesh");
        let far = Isometry3::translation(1.0, 0.0, 0.0);
        let below = Isometry3::translation(0.0, 0.0, -1.0);
        let window = ([-0.01; 2], [0.01; 2]);
        assert_eq!(MeshHeightMap::new(mesh, &far, 0.0, window).height(0.0, 0.0), None);
        assert_eq!(MeshHeightMap::new(mesh, &below, 0.0, window).height(0.0, 0.0), None);
        let here = MeshHeightMap::new(mesh, &Isometry3::identity(), -1.0, window);
        assert!(here.height(0.0, 0.0).is_some());
        assert_eq!(here.height(0.3, 0.0), None);
    }
}
