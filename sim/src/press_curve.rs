//! Depth over force of an object that presses into a cover, from the pressure law applied to the gap between their
//! shapes.

use hand_model::pads::Pad;
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use tactile_optics::GelFoundation;
use world::geometry::ObjectShape;

/// Number of rays along each side of a grid.
const GRID_SIDE: usize = 15;
/// Number of points of a curve; their depths grow quadratically with the index.
const CURVE_POINTS: usize = 16;
/// Start height above the contact of rays onto a solid cover, m: greater than any contact.
const RAY_START_HEIGHT: f64 = 0.02;
/// Start depth below the contact of rays onto the object, m: greater than any contact.
const RAY_START_DEPTH: f64 = 0.006;

/// A surface into which an object presses, seen from a frame whose z is its outward normal.
#[derive(Debug)]
pub enum PressedSurface<'a> {
    /// A pad, in its own frame: the surface that its image shows.
    Pad(&'a Pad),
    /// A solid cover, with its pose: `cover_from_frame`.
    Solid(&'a ObjectShape, Isometry3<f64>),
}

impl<'a> PressedSurface<'a> {
    /// Returns the surface of the solid `cover` around `middle`, where its normal is `out`, and `cover_from_frame`.
    pub fn around(cover: &'a ObjectShape, middle: &Point3<f64>, out: &Unit<Vector3<f64>>) -> (Self, Isometry3<f64>) {
        // Align the tangential axes with the solid's edges, if it has any.
        let least = out.iamin();
        let other = (0..3).filter(|axis| *axis != least).min_by(|a, b| out[*a].abs().total_cmp(&out[*b].abs()));
        let up = Vector3::ith(other.unwrap_or(least), 1.0);
        let cover_from_frame = Isometry3::from_parts(middle.coords.into(), UnitQuaternion::face_towards(out, &up));
        (Self::Solid(cover, cover_from_frame), cover_from_frame)
    }

    fn height(&self, x: f64, y: f64) -> Option<f64> {
        match self {
            Self::Pad(pad) => Some(pad.surface_height(x, y)),
            Self::Solid(cover, cover_from_frame) => {
                let inward = Unit::new_unchecked(cover_from_frame * -Vector3::z());
                cover
                    .ray(&(cover_from_frame * Point3::new(x, y, RAY_START_HEIGHT)), &inward)
                    .map(|down| RAY_START_HEIGHT - down)
            }
        }
    }

    fn window(&self) -> Window {
        let half = match self {
            Self::Pad(pad) => [0.5 * pad.w, 0.5 * pad.h],
            Self::Solid(ObjectShape::Cuboid { half, .. }, _) => [half.max(); 2],
            Self::Solid(other, _) => [other.bounding_radius(); 2],
        };
        Window { low: half.map(|half| -half), high: half, half_extents: half }
    }
}

/// A surface and an object about to press into it.
#[derive(Debug)]
pub struct SurfaceGap<'a> {
    pub surface: PressedSurface<'a>,
    pub object: &'a ObjectShape,
    /// `object_from_frame`, for the surface's frame.
    pub object_from_frame: Isometry3<f64>,
}

/// A window in the plane perpendicular to the normal, m.
#[derive(Debug, Clone, Copy)]
struct Window {
    low: [f64; 2],
    high: [f64; 2],
    /// Half extents of the surface of which it is a window.
    half_extents: [f64; 2],
}

impl Window {
    fn spacing(&self, axis: usize) -> f64 {
        (self.high[axis] - self.low[axis]) / GRID_SIDE as f64
    }

    fn cell_coordinate(&self, axis: usize, n: usize) -> f64 {
        self.low[axis] + (n as f64 + 0.5) * self.spacing(axis)
    }
}

/// Force over depth of one contact, from zero to the gel's full thickness.
#[derive(Debug, Clone, PartialEq)]
pub struct PressCurve {
    thickness: f64,
    /// Force (N) at each depth, increasing.
    forces: [f64; CURVE_POINTS],
}

impl PressCurve {
    /// Computes the curve of `gap`, most accurate around `force` (N); `None` if the shapes miss each other along the
    /// normal.
    pub fn from_gap(gap: &SurfaceGap, gel: &GelFoundation, force: f64) -> Option<Self> {
        // The whole surface first, then its pressed part.
        let around = gap.surface.window();
        let coarse = gap.penetrations(&around);
        let curve = Self::from_penetrations(&coarse, &around, gel)?;
        let close = contact_window(&coarse, &around, 1.3 * curve.depth(force) + 2e-5)?;
        Self::from_penetrations(&gap.penetrations(&close), &close, gel)
    }

    fn from_penetrations(map: &[Option<f64>], window: &Window, gel: &GelFoundation) -> Option<Self> {
        let deepest = map.iter().flatten().copied().reduce(f64::max)?;
        let area = window.spacing(0) * window.spacing(1);
        let forces = std::array::from_fn(|n| {
            let depth = point_depth(n, gel.thickness);
            let under = map.iter().flatten().map(|at| gel.pressure((at - deepest + depth).max(0.0)));
            area * under.sum::<f64>()
        });
        Some(Self { thickness: gel.thickness, forces })
    }

    /// Interpolates the depth (m) at which the gel bears `force` (N).
    pub fn depth(&self, force: f64) -> f64 {
        let above = self.forces.partition_point(|at| *at < force);
        if above == CURVE_POINTS {
            return self.thickness;
        }
        let (low, from) =
            if above == 0 { (0.0, 0.0) } else { (self.forces[above - 1], point_depth(above - 1, self.thickness)) };
        let (high, to) = (self.forces[above], point_depth(above, self.thickness));
        if high > low { from + (to - from) * (force - low) / (high - low) } else { to }
    }
}

/// Computes the depth of a curve's `n`-th point, m.
fn point_depth(n: usize, thickness: f64) -> f64 {
    thickness * ((n + 1) as f64 / CURVE_POINTS as f64).powi(2)
}

impl SurfaceGap<'_> {
    /// Samples the object's penetration below the cover's surface along the normal, up to a constant, at the centres of
    /// the window's cells.
    fn penetrations(&self, window: &Window) -> Vec<Option<f64>> {
        let direction = Unit::new_unchecked(self.object_from_frame * Vector3::z());
        let mut map = Vec::with_capacity(GRID_SIDE * GRID_SIDE);
        for row in 0..GRID_SIDE {
            for column in 0..GRID_SIDE {
                let (x, y) = (window.cell_coordinate(0, column), window.cell_coordinate(1, row));
                let below = self.object_from_frame * Point3::new(x, y, -RAY_START_DEPTH);
                let under =
                    || Some(self.surface.height(x, y)? - (self.object.ray(&below, &direction)? - RAY_START_DEPTH));
                map.push(under());
            }
        }
        map
    }
}

/// Finds the smallest window, one cell wider on each side, that contains all cells within `depth` (m) of the deepest.
fn contact_window(map: &[Option<f64>], window: &Window, depth: f64) -> Option<Window> {
    let deepest = map.iter().flatten().copied().reduce(f64::max)?;
    let (mut first, mut last) = ([GRID_SIDE; 2], [0; 2]);
    for (n, at) in map.iter().enumerate() {
        if at.is_some_and(|at| at > deepest - depth) {
            for (axis, cell) in [n % GRID_SIDE, n / GRID_SIDE].into_iter().enumerate() {
                first[axis] = first[axis].min(cell);
                last[axis] = last[axis].max(cell);
            }
        }
    }
    let edge = |axis: usize, cell: f64| window.low[axis] + cell * window.spacing(axis);
    Some(Window {
        low: [0, 1].map(|axis| edge(axis, first[axis] as f64 - 1.0).max(-window.half_extents[axis])),
        high: [0, 1].map(|axis| edge(axis, last[axis] as f64 + 2.0).min(window.half_extents[axis])),
        half_extents: window.half_extents,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEL: GelFoundation = GelFoundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };

    fn cover() -> ObjectShape {
        ObjectShape::Cuboid { half: Vector3::new(0.018, 0.00925, 0.010), radius: 0.005 }
    }

    /// Computes the curve of an object that touches the middle of the cover's broad face.
    fn curve(object: &ObjectShape, height: f64, force: f64) -> PressCurve {
        let cover = cover();
        let (surface, cover_from_frame) =
            PressedSurface::around(&cover, &Point3::new(0.0, 0.00925, 0.0), &Vector3::y_axis());
        let object_from_cover = Isometry3::translation(0.0, 0.00925 + height, 0.0).inverse();
        let gap = SurfaceGap { surface, object, object_from_frame: object_from_cover * cover_from_frame };
        PressCurve::from_gap(&gap, &GEL, force).expect("it touches")
    }

    /// A sphere penetrates a flat face by the depth that the volume of its cap implies. The spheres are too small to
    /// reach the face's edges.
    #[test]
    fn a_ball_s_depth_is_that_of_its_cap() {
        for radius in [0.006, 0.01, 0.015] {
            let ball = ObjectShape::Sphere { radius };
            for force in [0.2, 0.5, 1.0] {
                let depth = curve(&ball, radius, force).depth(force);
                let bears = GEL.ball_force(radius, depth);
                assert!((bears / force - 1.0).abs() < 0.08, "{radius} {force}: {depth} bears {bears}");
            }
        }
    }

    /// A small flat plate penetrates by its pressure divided by the foundation's stiffness.
    #[test]
    fn a_plate_s_depth_is_its_pressure_s() {
        let half = Vector3::new(0.004, 0.003, 0.0035);
        let plate = ObjectShape::Cuboid { half, radius: 1e-5 };
        let depth = curve(&plate, half.y, 2.0).depth(2.0);
        let exact = 2.0 / (4.0 * half.x * half.z) / (GEL.modulus / GEL.thickness);
        assert!((depth / exact - 1.0).abs() < 0.2, "{depth} {exact}");
    }

    #[test]
    fn depth_grows_with_force_up_to_the_thickness() {
        let curve = curve(&ObjectShape::Sphere { radius: 0.01 }, 0.01, 1.0);
        let depths: Vec<f64> = (0..200).map(|n| curve.depth(n as f64 * 0.3)).collect();
        assert_eq!(depths[0], 0.0);
        assert!(depths.windows(2).all(|pair| pair[0] <= pair[1]) && depths[199] <= GEL.thickness);
        assert_eq!(curve.depth(1e4), GEL.thickness);
    }
}
