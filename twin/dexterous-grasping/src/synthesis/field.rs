//! Distance field of the object for the sampler: signed distance and surface normal on one regular grid, interpolated
//! trilinearly.
//!
//! A node holds the distance d and the outward unit normal n of the nearest surface as four adjacent numbers, so that a
//! look-up reads eight neighbours and gives d, n and all their derivatives. The normals are interpolated themselves
//! rather than differentiated from d: they are continuous, and their derivative is exact. Outside the grid the nearest
//! point of the grid's box is evaluated, and the distance to it is added, so that the gradient points towards the object
//! from anywhere.
//!
//! Every component of the gradient of a trilinear interpolant of a distance is at most 1, so d changes by at most
//! [`LIPSCHITZ_BOUND`] times the displacement. With this bound the energy skips a patch of points that is far enough away
//! without error.

use nalgebra::{Matrix3, Point3, Vector3};

/// Bound of the interpolated distance's slope.
pub const LIPSCHITZ_BOUND: f64 = 1.732_050_807_568_878;

/// Largest number of nodes: 64 MB.
const MAX_NODES: usize = 4_000_000;

/// Resolution of [`DistanceField::clearance`] in a cell.
const CLEARANCE_UNITS: f64 = 4.0;

/// Errors of sampling a field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// Invalid argument.
    #[error("{field}: found {found}, expected {expected}")]
    Argument {
        /// Name of the argument.
        field: &'static str,
        /// Value of the argument.
        found: f64,
        /// Valid values.
        expected: &'static str,
    },
}

/// Distance and normal at one point, with derivatives.
#[derive(Debug, Clone, Copy)]
pub struct FieldSample {
    /// Signed distance, m, negative inside.
    pub distance: f64,
    /// Derivative of the distance.
    pub gradient: Vector3<f64>,
    /// Outward normal of the nearest surface, as interpolated: shorter than 1 near edges.
    pub normal: Vector3<f64>,
    /// Derivative of the normal (row: component, column: direction), 1/m.
    pub normal_jacobian: Matrix3<f64>,
}

/// The sampled field of one object, in the object's frame.
///
/// ```
/// use dexterous_grasping::synthesis::field::DistanceField;
/// use nalgebra::{Point3, Vector3};
///
/// // A ball of 30 mm radius on a grid of 2 mm.
/// let corner = Point3::new(0.03, 0.03, 0.03);
/// let field = DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.002, 0.02, |p| {
///     (p.coords.norm() - 0.03, p.coords.try_normalize(1e-9).unwrap_or_else(Vector3::x))
/// })?;
/// let sample = field.sample_at(&Vector3::new(0.0, 0.04, 0.0));
/// assert!((sample.distance - 0.01).abs() < 1e-4);
/// assert!((sample.normal - Vector3::y()).norm() < 1e-3);
/// # Ok::<(), dexterous_grasping::synthesis::field::FieldError>(())
/// ```
#[derive(Debug, Clone)]
pub struct DistanceField {
    origin: Vector3<f64>,
    cells_per_meter: f64,
    size: [usize; 3],
    /// Distance and normal, for the few contact points.
    nodes: Vec<[f32; 4]>,
    /// The distances alone, for hundreds of surface points per step: a quarter of the memory to read.
    distances: Vec<f32>,
    /// Least distance in each cell in units of `1 / CLEARANCE_UNITS` cells, rounded down, by the index of its lowest node.
    clearance: Vec<u8>,
    low: Point3<f64>,
    high: Point3<f64>,
    /// Centre of mass, m.
    pub center: Point3<f64>,
    /// Half of the object's mean extent, m: the length scale of torques.
    pub length: f64,
}

/// A point on the grid: index of the cell's lowest node, position in the cell, and displacement from the grid's border if
/// outside.
struct GridPosition {
    node: usize,
    part: [f64; 3],
    beyond: Vector3<f64>,
}

impl DistanceField {
    /// Samples `signed_distance` (distance and outward unit gradient, in the object's frame) in the box from `low` to `high`
    /// widened by `margin` on every side, with cells of `cell`, all m. `center` is the object's centre of mass.
    ///
    /// # Errors
    /// [`FieldError::Argument`] for an empty box, a length that is not positive, or more than 4e6 nodes.
    pub fn sample(
        low: &Point3<f64>,
        high: &Point3<f64>,
        center: &Point3<f64>,
        cell: f64,
        margin: f64,
        signed_distance: impl Fn(&Point3<f64>) -> (f64, Vector3<f64>),
    ) -> Result<Self, FieldError> {
        let positive = |field: &'static str, found: f64| {
            let good = found.is_finite() && found > 0.0;
            if good { Ok(()) } else { Err(FieldError::Argument { field, found, expected: "a positive length in m" }) }
        };
        positive("cell", cell)?;
        positive("margin", margin)?;
        let extent = high - low;
        positive("extent", extent.min())?;
        let origin = low.coords - Vector3::repeat(margin);
        let size = [0, 1, 2].map(|axis| ((extent[axis] + 2.0 * margin) / cell).ceil() as usize + 1);
        let count = size.iter().map(|n| *n as f64).product::<f64>();
        if count > MAX_NODES as f64 {
            return Err(FieldError::Argument { field: "cell", found: cell, expected: "at most 4e6 nodes in the grid" });
        }
        let mut nodes = Vec::with_capacity(count as usize);
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let point = origin + Vector3::new(i as f64, j as f64, k as f64) * cell;
                    let (distance, normal) = signed_distance(&point.into());
                    nodes.push([distance as f32, normal.x as f32, normal.y as f32, normal.z as f32]);
                }
            }
        }
        let distances: Vec<f32> = nodes.iter().map(|node| node[0]).collect();
        Ok(Self {
            clearance: cell_clearances(&distances, size, cell),
            origin,
            cells_per_meter: 1.0 / cell,
            size,
            distances,
            nodes,
            low: *low,
            high: *high,
            center: *center,
            length: extent.sum() / 6.0,
        })
    }

    /// Returns the lowest and highest corner of the object's bounding box, m.
    pub fn extent(&self) -> (Point3<f64>, Point3<f64>) {
        (self.low, self.high)
    }

    fn grid_position(&self, point: &Vector3<f64>) -> GridPosition {
        let mut node = 0;
        let mut part = [0.0; 3];
        let mut beyond = Vector3::zeros();
        let mut stride = 1;
        for axis in 0..3 {
            let scaled = (point[axis] - self.origin[axis]) * self.cells_per_meter;
            let inside = scaled.clamp(0.0, (self.size[axis] - 1) as f64);
            let base = (inside as usize).min(self.size[axis] - 2);
            node += base * stride;
            stride *= self.size[axis];
            part[axis] = inside - base as f64;
            beyond[axis] = (scaled - inside) / self.cells_per_meter;
        }
        GridPosition { node, part, beyond }
    }

    /// True if a look-up of one number shows that the interpolated distance at `point` is greater than `distance` (m).
    /// Otherwise it may be either.
    pub(crate) fn is_clear(&self, point: &Vector3<f64>, distance: f64) -> bool {
        let mut node = 0;
        for axis in [2, 1, 0] {
            // A float becomes the nearest integer that the type has, so that points below the grid are in its first cell.
            let base = ((point[axis] - self.origin[axis]) * self.cells_per_meter) as usize;
            node = node * self.size[axis] + base.min(self.size[axis] - 2);
        }
        f64::from(self.clearance[node]) > distance * self.cells_per_meter * CLEARANCE_UNITS
    }

    /// Interpolates the distance, m.
    pub fn distance(&self, point: &Vector3<f64>) -> f64 {
        let GridPosition { node, part: [x, y, z], beyond } = self.grid_position(point);
        let (row, layer) = (self.size[0], self.size[0] * self.size[1]);
        let at = |offset: usize| f64::from(self.distances[node + offset]);
        let edge = |offset: usize| {
            let a = at(offset);
            a + (at(offset + 1) - a) * x
        };
        let face = |offset: usize| {
            let a = edge(offset);
            a + (edge(offset + row) - a) * y
        };
        let near = face(0);
        let inside = near + (face(layer) - near) * z;
        if beyond == Vector3::zeros() { inside } else { inside + beyond.norm() }
    }

    /// Interpolates the distance (m) and its derivative.
    pub fn distance_gradient(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let GridPosition { node, part: [x, y, z], beyond } = self.grid_position(point);
        let (row, layer) = (self.size[0], self.size[0] * self.size[1]);
        let at = |offset: usize| f64::from(self.distances[node + offset]);
        // (value, slope along x) on the four edges, then across them.
        let edge = |offset: usize| {
            let a = at(offset);
            let slope = at(offset + 1) - a;
            (a + slope * x, slope)
        };
        let (c00, c10, c01, c11) = (edge(0), edge(row), edge(layer), edge(layer + row));
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let (near, far) = (mix(c00.0, c10.0, y), mix(c01.0, c11.0, y));
        let slope_x = mix(mix(c00.1, c10.1, y), mix(c01.1, c11.1, y), z);
        let slope_y = mix(c10.0 - c00.0, c11.0 - c01.0, z);
        let gradient = Vector3::new(slope_x, slope_y, far - near) * self.cells_per_meter;
        extrapolate(mix(near, far, z), gradient, &beyond)
    }

    /// Interpolates distance and normal with their derivatives.
    pub fn sample_at(&self, point: &Vector3<f64>) -> FieldSample {
        let GridPosition { node, part: [x, y, z], beyond } = self.grid_position(point);
        let (row, layer) = (self.size[0], self.size[0] * self.size[1]);
        let at = |offset: usize| self.nodes[node + offset].map(f64::from);
        let mix = |a: [f64; 4], b: [f64; 4], t: f64| -> [f64; 4] { std::array::from_fn(|n| a[n] + (b[n] - a[n]) * t) };
        let minus = |a: [f64; 4], b: [f64; 4]| -> [f64; 4] { std::array::from_fn(|n| a[n] - b[n]) };
        let corners: [[f64; 4]; 8] = [0, 1, row, row + 1, layer, layer + 1, layer + row, layer + row + 1].map(at);
        let edges: [[f64; 4]; 4] = std::array::from_fn(|n| mix(corners[2 * n], corners[2 * n + 1], x));
        let slopes: [[f64; 4]; 4] = std::array::from_fn(|n| minus(corners[2 * n + 1], corners[2 * n]));
        let (near, far) = (mix(edges[0], edges[1], y), mix(edges[2], edges[3], y));
        let along_x = mix(mix(slopes[0], slopes[1], y), mix(slopes[2], slopes[3], y), z);
        let along_y = mix(minus(edges[1], edges[0]), minus(edges[3], edges[2]), z);
        let along_z = minus(far, near);
        let value = mix(near, far, z);
        let derivative = |n: usize| Vector3::new(along_x[n], along_y[n], along_z[n]) * self.cells_per_meter;
        let (distance, gradient) = extrapolate(value[0], derivative(0), &beyond);
        let mut jacobian = Matrix3::zeros();
        for row in 0..3 {
            let slope = derivative(row + 1).zip_map(&beyond, |slope, out| if out == 0.0 { slope } else { 0.0 });
            jacobian.set_row(row, &slope.transpose());
        }
        FieldSample {
            distance,
            gradient,
            normal: Vector3::new(value[1], value[2], value[3]),
            normal_jacobian: jacobian,
        }
    }
}

/// Computes [`DistanceField::clearance`]. No interpolated value in a cell is less than that of its least corner.
fn cell_clearances(distances: &[f32], size: [usize; 3], cell: f64) -> Vec<u8> {
    let (row, layer) = (size[0], size[0] * size[1]);
    let corners = [0, 1, row, row + 1, layer, layer + 1, layer + row, layer + row + 1];
    let least = |node: usize| {
        let values = corners.iter().map(|offset| distances.get(node + offset).copied().unwrap_or(f32::NEG_INFINITY));
        values.fold(f32::INFINITY, f32::min)
    };
    (0..distances.len()).map(|node| (f64::from(least(node)) / cell * CLEARANCE_UNITS) as u8).collect()
}

/// Extends a distance and its gradient from the border of the grid to a point `beyond` it.
fn extrapolate(distance: f64, gradient: Vector3<f64>, beyond: &Vector3<f64>) -> (f64, Vector3<f64>) {
    if *beyond == Vector3::zeros() {
        return (distance, gradient);
    }
    let way = beyond.norm();
    let inner = gradient.zip_map(beyond, |slope, out| if out == 0.0 { slope } else { 0.0 });
    (distance + way, inner + beyond / way)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the field of a ball of `radius` (m) around the origin.
    pub(crate) fn ball(radius: f64) -> DistanceField {
        let corner = Point3::new(radius, radius, radius);
        DistanceField::sample(&-corner, &corner, &Point3::origin(), 0.002, 0.03, |p| {
            let away = p.coords.norm();
            (away - radius, p.coords.try_normalize(1e-12).unwrap_or_else(Vector3::x))
        })
        .expect("sampled")
    }

    #[test]
    fn agrees_with_the_closed_form() {
        let field = ball(0.03);
        for n in 0..200 {
            let turn = f64::from(n) * 0.7;
            let point =
                Vector3::new(turn.cos(), turn.sin(), (0.37 * turn).sin()).normalize() * (0.02 + 1.5e-4 * f64::from(n));
            let sample = field.sample_at(&point);
            assert!((sample.distance - (point.norm() - 0.03)).abs() < 5e-5);
            assert!(sample.normal.angle(&point) < 0.01, "{} {}", sample.normal, point.normalize());
            assert_eq!(sample.distance, field.distance(&point));
        }
    }

    #[test]
    fn bad_cells_are_named() {
        let corner = Point3::new(1.0, 1.0, 1.0);
        let error = DistanceField::sample(&-corner, &corner, &Point3::origin(), 1e-3, 0.1, |_| (0.0, Vector3::x()));
        assert!(error.expect_err("too fine").to_string().starts_with("cell: found 0.001, expected at most"));
    }

    proptest! {
        /// Inside the grid and beyond it, the derivatives are those of the values.
        #[test]
        fn derivatives_are_finite_differences(p in [-0.15..0.15_f64, -0.15..0.15, -0.15..0.15]) {
            let field = ball(0.03);
            let point = Vector3::from(p);
            let h = 1e-7;
            let sample = field.sample_at(&point);
            let (distance, gradient) = field.distance_gradient(&point);
            prop_assert_eq!(distance, sample.distance);
            prop_assert!((gradient - sample.gradient).norm() < 1e-12);
            for axis in 0..3 {
                let step = Vector3::ith(axis, h);
                let (back, forth) = (field.sample_at(&(point - step)), field.sample_at(&(point + step)));
                // A step across a cell's border meets a kink.
                let scaled = (point[axis] - field.origin[axis]) * field.cells_per_meter;
                if (scaled - scaled.round()).abs() < 1e-3 { continue; }
                prop_assert!(((forth.distance - back.distance) / (2.0 * h) - gradient[axis]).abs() < 1e-5);
                let slope = (forth.normal - back.normal) / (2.0 * h);
                prop_assert!((slope - sample.normal_jacobian.column(axis)).norm() < 1e-3);
            }
        }

        /// Points that one look-up shows to be clear are that far, inside the grid and beyond it.
        #[test]
        fn clear_points_are_far(p in [-0.12..0.12_f64, -0.12..0.12, -0.12..0.12], far in 0.0..0.03_f64) {
            let (field, point) = (ball(0.03), Vector3::from(p));
            let (clear, distance) = (field.is_clear(&point, far), field.distance(&point));
            prop_assert!(!clear || distance > far, "{} {}", distance, far);
            // A cell's diagonal and the rounding: 3.5 mm and 0.5 mm. Beyond the grid its border counts.
            let seen = field.distance(&point.map(|x| x.clamp(-0.06, 0.06)));
            prop_assert!(clear || seen < far + 0.004, "{} {}", seen, far);
        }

        /// The bound that lets the energy skip patches holds.
        #[test]
        fn slope_is_bounded(p in [-0.12..0.12_f64, -0.12..0.12, -0.12..0.12], q in [-0.12..0.12_f64, -0.12..0.12, -0.12..0.12]) {
            let field = ball(0.03);
            let (p, q) = (Vector3::from(p), Vector3::from(q));
            prop_assert!((field.distance(&p) - field.distance(&q)).abs() <= LIPSCHITZ_BOUND * (p - q).norm() + 1e-9);
        }
    }
}
