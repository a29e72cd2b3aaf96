//! Depth over force of an object that presses into a cover: the pressure law under the gap between their shapes.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use optics::Foundation;
use scenarios::geometry::Shape;

/// Rays along each side of a grid.
const SIDE: usize = 15;
/// Points of a curve; their depths grow with the square of their number.
const POINTS: usize = 16;
/// Rays on the cover start this far above the contact, those on the object this deep below it, m: deeper than any contact.
const ABOVE: f64 = 0.02;
/// See [`ABOVE`].
const BELOW: f64 = 0.006;

/// A cover and an object about to press into it.
#[derive(Debug)]
pub struct Gap<'a> {
    /// The cover as a solid, in its own frame.
    pub cover: &'a Shape,
    pub object: &'a Shape,
    pub object_from_cover: Isometry3<f64>,
    /// Middle of the contact, cover frame, m.
    pub middle: Point3<f64>,
    /// The normal out of the cover there, cover frame.
    pub out: Unit<Vector3<f64>>,
}

/// A window in the plane across the normal, m.
#[derive(Debug, Clone, Copy)]
struct Window {
    low: [f64; 2],
    high: [f64; 2],
}

impl Window {
    fn spacing(&self, axis: usize) -> f64 {
        (self.high[axis] - self.low[axis]) / SIDE as f64
    }

    fn at(&self, axis: usize, n: usize) -> f64 {
        self.low[axis] + (n as f64 + 0.5) * self.spacing(axis)
    }
}

/// Force over depth of one contact, from none to all of the gel's thickness.
#[derive(Debug, Clone, PartialEq)]
pub struct PressCurve {
    thickness: f64,
    /// Force (N) at each depth, increasing.
    forces: [f64; POINTS],
}

impl PressCurve {
    /// The curve of `gap`, most accurate around `force` (N); `None` where the shapes miss each other along the normal.
    pub fn of(gap: &Gap, gel: &Foundation, force: f64) -> Option<Self> {
        // The whole cover first, then the part of it that is pressed.
        let reach = match gap.cover {
            Shape::Cuboid { half, .. } => half.max(),
            other => other.bounding_radius(),
        };
        let around = Window { low: [-reach; 2], high: [reach; 2] };
        let coarse = gap.penetrations(&around);
        let curve = Self::from_penetrations(&coarse, &around, gel)?;
        let close = pressed(&coarse, &around, 1.3 * curve.depth(force) + 2e-5)?;
        Self::from_penetrations(&gap.penetrations(&close), &close, gel)
    }

    fn from_penetrations(map: &[Option<f64>], window: &Window, gel: &Foundation) -> Option<Self> {
        let deepest = map.iter().flatten().copied().reduce(f64::max)?;
        let area = window.spacing(0) * window.spacing(1);
        let forces = std::array::from_fn(|n| {
            let depth = depth_of(n, gel.thickness);
            let under = map.iter().flatten().map(|at| gel.pressure((at - deepest + depth).max(0.0)));
            area * under.sum::<f64>()
        });
        Some(Self { thickness: gel.thickness, forces })
    }

    /// Depth (m) at which the gel bears `force` (N).
    pub fn depth(&self, force: f64) -> f64 {
        let above = self.forces.partition_point(|at| *at < force);
        if above == POINTS {
            return self.thickness;
        }
        let (low, from) =
            if above == 0 { (0.0, 0.0) } else { (self.forces[above - 1], depth_of(above - 1, self.thickness)) };
        let (high, to) = (self.forces[above], depth_of(above, self.thickness));
        if high > low { from + (to - from) * (force - low) / (high - low) } else { to }
    }
}

/// Depth of a curve's `n`-th point, m.
fn depth_of(n: usize, thickness: f64) -> f64 {
    thickness * ((n + 1) as f64 / POINTS as f64).powi(2)
}

impl Gap<'_> {
    /// How far the object reaches below the cover's surface along the normal, less a constant, at the middles of the window's cells.
    fn penetrations(&self, window: &Window) -> Vec<Option<f64>> {
        let [u, v] = across(&self.out);
        let inward = -self.out;
        let (direction, origin) = (self.object_from_cover * self.out, self.middle);
        let mut map = Vec::with_capacity(SIDE * SIDE);
        for row in 0..SIDE {
            for column in 0..SIDE {
                let foot = origin + u * window.at(0, column) + v * window.at(1, row);
                let down = self.cover.ray(&(foot + *self.out * ABOVE), &inward);
                let below = self.object_from_cover * (foot - *self.out * BELOW);
                map.push(down.and_then(|down| {
                    let up = self.object.ray(&below, &direction)?;
                    Some((ABOVE - down) - (up - BELOW))
                }));
            }
        }
        map
    }
}

/// Two directions across a normal, so that for a face of a cover they are along its edges.
fn across(out: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let least = out.iamin();
    let other = (0..3).filter(|axis| *axis != least).min_by(|a, b| out[*a].abs().total_cmp(&out[*b].abs()));
    let u = Vector3::ith(other.unwrap_or(least), 1.0).cross(out).normalize();
    [u, out.cross(&u)]
}

/// The smallest window, one cell wider on each side, that holds all cells within `depth` (m) of the deepest.
fn pressed(map: &[Option<f64>], window: &Window, depth: f64) -> Option<Window> {
    let deepest = map.iter().flatten().copied().reduce(f64::max)?;
    let (mut first, mut last) = ([SIDE; 2], [0; 2]);
    for (n, at) in map.iter().enumerate() {
        if at.is_some_and(|at| at > deepest - depth) {
            for (axis, cell) in [n % SIDE, n / SIDE].into_iter().enumerate() {
                first[axis] = first[axis].min(cell);
                last[axis] = last[axis].max(cell);
            }
        }
    }
    let edge = |axis: usize, cell: f64| window.low[axis] + cell * window.spacing(axis);
    Some(Window {
        low: [0, 1].map(|axis| edge(axis, first[axis] as f64 - 1.0)),
        high: [0, 1].map(|axis| edge(axis, last[axis] as f64 + 2.0)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEL: Foundation = Foundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };

    fn cover() -> Shape {
        Shape::Cuboid { half: Vector3::new(0.018, 0.00925, 0.010), radius: 0.005 }
    }

    /// The curve of an object that touches the middle of the cover's broad face.
    fn curve(object: &Shape, height: f64, force: f64) -> PressCurve {
        let cover = cover();
        let gap = Gap {
            cover: &cover,
            object,
            object_from_cover: Isometry3::translation(0.0, 0.00925 + height, 0.0).inverse(),
            middle: Point3::new(0.0, 0.00925, 0.0),
            out: Vector3::y_axis(),
        };
        PressCurve::of(&gap, &GEL, force).expect("it touches")
    }

    /// A ball on a flat face sinks in as the cap's volume says; balls that are small enough not to meet the face's edges.
    #[test]
    fn a_ball_s_depth_is_that_of_its_cap() {
        for radius in [0.006, 0.01, 0.015] {
            let ball = Shape::Sphere { radius };
            for force in [0.2, 0.5, 1.0] {
                let depth = curve(&ball, radius, force).depth(force);
                let bears = GEL.ball_force(radius, depth);
                assert!((bears / force - 1.0).abs() < 0.08, "{radius} {force}: {depth} bears {bears}");
            }
        }
    }

    /// A small flat plate sinks in by its pressure over the foundation's stiffness.
    #[test]
    fn a_plate_s_depth_is_its_pressure_s() {
        let half = Vector3::new(0.004, 0.003, 0.0035);
        let plate = Shape::Cuboid { half, radius: 1e-5 };
        let depth = curve(&plate, half.y, 2.0).depth(2.0);
        let exact = 2.0 / (4.0 * half.x * half.z) / (GEL.modulus / GEL.thickness);
        assert!((depth / exact - 1.0).abs() < 0.2, "{depth} {exact}");
    }

    #[test]
    fn depth_grows_with_force_up_to_the_thickness() {
        let curve = curve(&Shape::Sphere { radius: 0.01 }, 0.01, 1.0);
        let depths: Vec<f64> = (0..200).map(|n| curve.depth(n as f64 * 0.3)).collect();
        assert_eq!(depths[0], 0.0);
        assert!(depths.windows(2).all(|pair| pair[0] <= pair[1]) && depths[199] <= GEL.thickness);
        assert_eq!(curve.depth(1e4), GEL.thickness);
    }
}
