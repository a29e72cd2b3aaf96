//! Signed distance grid: a query takes tens of nanoseconds instead of microseconds for a mesh.
//!
//! Distances are sampled on a regular grid around the shape and interpolated trilinearly; the gradient is that of the
//! interpolant. The grid is divided into blocks, and the samples of a block are computed when a query first falls into
//! it: most queries are near a few contacts. A point outside the grid is measured from the surface point nearest to the
//! grid's border, which slightly overestimates the distance at most.

use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::shape::ObjectShape;

/// Cells along each edge of a block.
const BLOCK: usize = 8;
/// Samples along each edge of a block: those on its faces are in the neighbours too, so that a cell needs one block.
const SAMPLES: usize = BLOCK + 1;

/// A sampled signed distance field, in the shape's frame.
#[derive(Debug, Clone)]
pub struct DistanceGrid {
    shape: ObjectShape,
    origin: Point3<f64>,
    cell: f64,
    /// Samples along x, y and z.
    size: [usize; 3],
    /// Blocks along x and y.
    row: [usize; 2],
    /// Samples of each block, m; x first, then y.
    blocks: Vec<OnceLock<Box<[f32; SAMPLES * SAMPLES * SAMPLES]>>>,
}

impl DistanceGrid {
    /// Creates a grid for `shape` with cells of `cell` (m), `margin` (m) beyond its bounding box.
    pub fn new(shape: &ObjectShape, cell: f64, margin: f64) -> Self {
        let (low, high) = shape.aabb();
        let origin = low - Vector3::repeat(margin);
        let extent = high - low + Vector3::repeat(2.0 * margin);
        let size = [0, 1, 2].map(|axis| (extent[axis] / cell).ceil() as usize + 1);
        let [x, y, z] = size.map(|samples| (samples - 1).div_ceil(BLOCK));
        Self { shape: shape.clone(), origin, cell, size, row: [x, y], blocks: vec![OnceLock::new(); x * y * z] }
    }

    /// Computes all samples, so that no query has to wait for its block.
    pub fn prepare(&self) {
        (0..self.blocks.len()).into_par_iter().for_each(|number| _ = self.block(number));
    }

    /// Returns the samples of a block.
    fn block(&self, number: usize) -> &[f32; SAMPLES * SAMPLES * SAMPLES] {
        self.blocks[number].get_or_init(|| {
            let row = number / self.row[0];
            let first = [number % self.row[0], row % self.row[1], row / self.row[1]].map(|block| block * BLOCK);
            let mut samples = Box::new([0.0; SAMPLES * SAMPLES * SAMPLES]);
            for (n, sample) in samples.iter_mut().enumerate() {
                let [i, j, k] = [n % SAMPLES, n / SAMPLES % SAMPLES, n / (SAMPLES * SAMPLES)];
                let step = Vector3::new((first[0] + i) as f64, (first[1] + j) as f64, (first[2] + k) as f64);
                *sample = self.shape.signed_distance(&(self.origin + step * self.cell)).0 as f32;
            }
            samples
        })
    }

    /// Returns the distance (m, negative inside) and the unit gradient.
    pub fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let (scaled, clamped) = self.scaled(point);
        let cell = self.cell_at(&clamped);
        let (distance, gradient) = (cell.distance(), cell.gradient());
        if scaled == clamped {
            return (distance, gradient);
        }
        let surface = self.origin + clamped * self.cell - gradient * distance;
        let away = point - surface;
        (away.norm(), away.try_normalize(1e-12).unwrap_or(gradient))
    }

    /// Returns the distance of [`Self::signed_distance`], the same to the bit.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let (scaled, clamped) = self.scaled(point);
        if scaled == clamped { self.cell_at(&clamped).distance() } else { self.signed_distance(point).0 }
    }

    /// Returns a point in cells from the grid's origin, and the point of the grid nearest to it.
    fn scaled(&self, point: &Point3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let last = Vector3::from_fn(|axis, _| (self.size[axis] - 1) as f64);
        let scaled = (point - self.origin) / self.cell;
        (scaled, scaled.sup(&Vector3::zeros()).inf(&last))
    }

    /// Returns the cell in which `scaled` is, in cells from the grid's origin, within the grid.
    fn cell_at(&self, scaled: &Vector3<f64>) -> Cell {
        let mut base = [0; 3];
        let mut part = Vector3::zeros();
        for axis in 0..3 {
            base[axis] = (scaled[axis] as usize).min(self.size[axis] - 2);
            part[axis] = scaled[axis] - base[axis] as f64;
        }
        let block = base.map(|index| index / BLOCK);
        let samples = self.block((block[2] * self.row[1] + block[1]) * self.row[0] + block[0]);
        let [x, y, z] = base.map(|index| index % BLOCK);
        let edge = |j: usize, k: usize| {
            let index = ((z + k) * SAMPLES + y + j) * SAMPLES + x;
            [f64::from(samples[index]), f64::from(samples[index + 1])]
        };
        Cell { edges: [edge(0, 0), edge(1, 0), edge(0, 1), edge(1, 1)], part }
    }
}

/// A cell of the grid with a point in it.
struct Cell {
    /// Distances at both ends of the edges along x: y and z low, y high, z high, both high.
    edges: [[f64; 2]; 4],
    /// Position of the point in the cell, 0 to 1 along each axis.
    part: Vector3<f64>,
}

impl Cell {
    /// Interpolates along the edges, then between them: the distances at low and at high z.
    fn faces(&self) -> ([f64; 4], [f64; 2]) {
        let along = self.edges.map(|[a, b]| mix(a, b, self.part.x));
        (along, [mix(along[0], along[1], self.part.y), mix(along[2], along[3], self.part.y)])
    }

    fn distance(&self) -> f64 {
        let (_, [near, far]) = self.faces();
        mix(near, far, self.part.z)
    }

    /// Returns the direction of the interpolant's gradient.
    fn gradient(&self) -> Vector3<f64> {
        let ([c00, c10, c01, c11], [near, far]) = self.faces();
        let slopes = self.edges.map(|[a, b]| b - a);
        let (y, z) = (self.part.y, self.part.z);
        let gradient = Vector3::new(
            mix(mix(slopes[0], slopes[1], y), mix(slopes[2], slopes[3], y), z),
            mix(c10 - c00, c11 - c01, z),
            far - near,
        );
        gradient.try_normalize(1e-12).unwrap_or_else(Vector3::z)
    }
}

fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Agrees with the closed form of a ball, away from the centre: distances to 0.05 mm, directions to 4.5 degrees
    /// (half a cell's diagonal seen from 12 mm is 4.1).
    #[test]
    fn agrees_with_a_ball() {
        let ball = ObjectShape::Sphere { radius: 0.02 };
        let grid = DistanceGrid::new(&ball, 0.001, 0.008);
        for n in 0..500 {
            let turn = f64::from(n) * 0.7;
            let r = 0.012 + 0.014 * f64::from(n) / 500.0;
            let point = Point3::from(Vector3::new(turn.cos(), turn.sin(), (0.37 * turn).sin()).normalize() * r);
            let (distance, gradient) = grid.signed_distance(&point);
            let (exact, normal) = ball.signed_distance(&point);
            assert!((distance - exact).abs() < 5e-5, "{distance} {exact}");
            assert_eq!(grid.distance(&point).to_bits(), distance.to_bits());
            assert!(gradient.angle(&normal) < 4.5f64.to_radians());
        }
        // The blocks that no query has met yet are the same, whichever thread computes them.
        let prepared = DistanceGrid::new(&ball, 0.001, 0.008);
        prepared.prepare();
        for number in 0..grid.blocks.len() {
            assert_eq!(grid.block(number), prepared.block(number));
        }
        for far in [Point3::new(0.1, 0.0, 0.0), Point3::new(0.06, -0.05, 0.03)] {
            let ((distance, gradient), (exact, normal)) = (grid.signed_distance(&far), ball.signed_distance(&far));
            assert!(distance > exact - 5e-5 && distance < 1.02 * exact, "{distance} {exact}");
            assert!(gradient.angle(&normal) < 6f64.to_radians());
            assert_eq!(grid.distance(&far).to_bits(), distance.to_bits());
        }
    }
}
