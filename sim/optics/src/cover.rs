//! Curved pads: a cover that is part of a cylinder along the digit.
//!
//! A point of the cover is given by its position (x, y) in the pad's plane; it is at `z = sqrt(R^2 - x^2) - R`. The gel's
//! height map is measured along the normal there. An object that presses along the pad's z indents the gel along these
//! normals by the distance from the cover to the object's surface. The gel's pressure acts against the normal; its z
//! component on a patch is the pressure times the area of the patch projected onto the plane, whatever its tilt. A cover
//! of curvature 0 is the flat pad.

use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use nalgebra::{Point3, Vector3};

use crate::error::{OpticsError, check_force, check_positive};
use crate::foundation::GelFoundation;
use crate::indentation::{IndentationMap, PIXEL_COUNT, PressResult, press_on};

/// Shape of a pad's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PadCover {
    /// One over the cylinder's radius, 1/m; 0 is flat.
    curvature: f64,
}

/// Largest ratio of half a pad's width to the radius: a steeper cover is outside the view of its camera and lamps.
const MAX_WIDTH_RATIO: f64 = 0.8;
/// Spacing of the first pass of [`PadCover::press`], pixels.
const COARSE_SPACING: usize = 4;
/// Largest number of iterations of a search, and the tolerance of the intersection along a normal, m.
const MAX_ITERATIONS: usize = 12;
const INTERSECTION_TOLERANCE: f64 = 1e-8;

impl PadCover {
    /// The flat pad.
    pub const FLAT: Self = Self { curvature: 0.0 };

    /// Creates a part of a cylinder of this radius (m) with its axis along y behind the pad.
    pub fn cylinder(radius: f64) -> Result<Self, OpticsError> {
        check_positive("cover radius", radius)?;
        Ok(Self { curvature: 1.0 / radius })
    }

    /// True if the cover is a plane and not part of a cylinder.
    pub fn is_flat(&self) -> bool {
        self.curvature == 0.0
    }

    /// Returns an error if the pad is too wide for the cylinder.
    pub fn check(&self, pad: &Pad) -> Result<(), OpticsError> {
        let most = 2.0 * MAX_WIDTH_RATIO / self.curvature;
        if pad.w <= most { Ok(()) } else { Err(OpticsError::CoverWidth { found: pad.w, max: most }) }
    }

    /// Computes the height (m, never positive) over the pad's plane.
    pub fn height(&self, x: f64) -> f64 {
        let part = (self.curvature * x).clamp(-1.0, 1.0);
        // sqrt(R^2 - x^2) - R without cancellation, valid for curvature 0 too.
        -self.curvature * x * x / (1.0 + (1.0 - part * part).sqrt())
    }

    /// Computes the unit normal, out of the gel.
    pub fn normal(&self, x: f64) -> Vector3<f64> {
        let part = (self.curvature * x).clamp(-1.0, 1.0);
        Vector3::new(part, 0.0, (1.0 - part * part).sqrt())
    }

    /// Computes the depth (m) of an object below the cover at (x, y), along the normal: negative above it, `None`
    /// without an object.
    pub fn penetration(
        &self,
        pad: &Pad,
        (x, y): (f64, f64),
        shift: f64,
        z_object: &mut impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<Option<f64>, OpticsError> {
        let normal = self.normal(x);
        let start = Point3::new(x, y, self.height(x) + pad.surface_height(x, y));
        // Depth of a point on the normal inside the object, along z.
        let mut inside = |depth: f64| -> Result<Option<f64>, OpticsError> {
            let place = start - depth * normal;
            let Some(z) = z_object(place.x, place.y) else { return Ok(None) };
            if !z.is_finite() {
                return Err(OpticsError::Surface { x: place.x, y: place.y, z });
            }
            Ok(Some(place.z - z + shift))
        };
        let Some(mut before) = inside(0.0)? else { return Ok(None) };
        let (mut last, mut depth) = (0.0, before / normal.z);
        for _ in 0..MAX_ITERATIONS {
            let Some(here) = inside(depth)? else { return Ok(None) };
            if here.abs() < INTERSECTION_TOLERANCE || here == before {
                break;
            }
            let next = depth - here * (depth - last) / (here - before);
            (last, before, depth) = (depth, here, next);
        }
        Ok(depth.is_finite().then_some(depth))
    }

    /// Like [`crate::indentation::press_on`], on this cover: the maps are along its normals.
    pub fn press(
        &self,
        pad: &Pad,
        cameras: &[&PadCamera],
        gel: &GelFoundation,
        force: f64,
        z_object: impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<PressResult, OpticsError> {
        if self.is_flat() {
            return press_on(pad, cameras, gel, force, z_object);
        }
        check_force(force)?;
        gel.check()?;
        self.check(pad)?;
        let untouched = || PressResult { shift: 0.0, force: 0.0, maps: vec![IndentationMap::idle(); cameras.len()] };
        if force == 0.0 {
            return Ok(untouched());
        }
        let mut contact = CoverContact { cover: self, pad, cameras, gel, z_object };
        let Some(shift) = contact.bisect(force)? else { return Ok(untouched()) };
        let (shift, force, maps) = contact.balance(shift, force)?;
        debug_assert!(maps.iter().all(|map| map.len() == PIXEL_COUNT));
        let maps: Result<Vec<_>, _> = maps.into_iter().map(IndentationMap::from_depth).collect();
        Ok(PressResult { shift, force, maps: maps? })
    }
}

/// An object above a curved pad, for the search for the shift at which the gel bears a given force.
struct CoverContact<'a, F> {
    cover: &'a PadCover,
    pad: &'a Pad,
    cameras: &'a [&'a PadCamera],
    gel: &'a GelFoundation,
    z_object: F,
}

impl<F: FnMut(f64, f64) -> Option<f64>> CoverContact<'_, F> {
    /// Computes the force (N) that the gel bears with the object moved in by `shift` (m), and the indentation (m) on
    /// every `spacing`-th row and column of each camera.
    fn force_and_indentation(&mut self, shift: f64, spacing: usize) -> Result<(f64, Vec<Vec<f32>>), OpticsError> {
        let (mut sum, mut all) = (0.0, Vec::with_capacity(self.cameras.len()));
        for camera in self.cameras {
            let (dx, dy) = camera.pixel_size();
            check_positive("camera width", dx)?;
            check_positive("camera height", dy)?;
            let mut depths = Vec::new();
            for row in (spacing / 2..IMAGE_SIZE).step_by(spacing) {
                for column in (spacing / 2..IMAGE_SIZE).step_by(spacing) {
                    let place = camera.pixel_center(column, row);
                    let found = self.cover.penetration(self.pad, place, shift, &mut self.z_object)?;
                    let depth = found.map_or(0.0, |depth| depth.clamp(0.0, self.gel.thickness));
                    sum += self.gel.pressure(depth) * dx * dy * (spacing * spacing) as f64;
                    depths.push(depth as f32);
                }
            }
            all.push(depths);
        }
        Ok((sum, all))
    }

    fn coarse_force(&mut self, shift: f64) -> Result<f64, OpticsError> {
        Ok(self.force_and_indentation(shift, COARSE_SPACING)?.0)
    }

    /// Finds the shift (m) at which a coarse grid bears `force` (N); `None` if nothing is above the pad.
    fn bisect(&mut self, force: f64) -> Result<Option<f64>, OpticsError> {
        // The height of the object's lowest point is unknown: move out until the contact is lost, then in until the gel
        // bears the force.
        let (mut low, mut high) = (-self.gel.thickness, self.gel.thickness);
        for _ in 0..MAX_ITERATIONS {
            if self.coarse_force(low)? <= force {
                break;
            }
            (low, high) = (2.0 * low, low);
        }
        let mut most = self.coarse_force(high)?;
        for _ in 0..MAX_ITERATIONS {
            if most >= force {
                break;
            }
            let next = self.coarse_force(2.0 * high)?;
            if next <= most && most > 0.0 {
                break;
            }
            (low, high, most) = (high, 2.0 * high, next);
        }
        if most == 0.0 {
            return Ok(None);
        }
        while high - low > 1e-7 {
            let middle = 0.5 * (low + high);
            if self.coarse_force(middle)? < force { low = middle } else { high = middle }
        }
        Ok(Some(high))
    }

    /// Finds the shift (m), force (N) and full maps at which all pixels bear `force`, by the secant method from an
    /// approximate shift.
    fn balance(&mut self, start: f64, force: f64) -> Result<(f64, f64, Vec<Vec<f32>>), OpticsError> {
        let (mut shift, mut last) = (start, None);
        let mut found = self.force_and_indentation(shift, 1)?;
        for _ in 0..MAX_ITERATIONS {
            if (found.0 - force).abs() < 1e-6 * force {
                break;
            }
            let slope = match last {
                Some((shift_before, force_before)) => (found.0 - force_before) / (shift - shift_before),
                None => (self.force_and_indentation(shift + 1e-6, 1)?.0 - found.0) / 1e-6,
            };
            let step = (force - found.0) / slope;
            if !step.is_finite() || step.abs() > self.gel.thickness {
                break;
            }
            last = Some((shift, found.0));
            shift += step;
            found = self.force_and_indentation(shift, 1)?;
        }
        Ok((shift, found.0, found.1))
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;

    use super::*;

    /// A phalanx pad with sharp edges, so that only the cover is curved.
    fn pad() -> (Pad, PadCamera) {
        let hand = Hand::ftac();
        let pad = hand.pads.iter().find(|pad| pad.name == "index_distal").unwrap();
        (Pad { edge_radius: 0.0, ..pad.clone() }, hand.cameras[pad.cameras[0]].clone())
    }

    const GEL: GelFoundation = GelFoundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };

    #[test]
    fn a_plate_on_a_cylinder_touches_a_stripe_of_the_analytic_width_and_force() {
        let (pad, camera) = pad();
        for (radius, force) in [(0.02, 1.0), (0.03, 4.0), (0.05, 8.0)] {
            let cover = PadCover::cylinder(radius).unwrap();
            let press = cover.press(&pad, &[&camera], &GEL, force, |_, _| Some(0.0)).unwrap();
            let deep = press.shift;
            // Chord of the circle at this depth.
            let half = (2.0 * radius * deep - deep * deep).sqrt();
            // k times the integral of (z + deep) / n_z over the stripe.
            let per_length = 2.0 * (radius * half - radius * (radius - deep) * (half / radius).asin());
            let exact = GEL.modulus / GEL.thickness * per_length * camera.h;
            assert!(
                (press.force / force - 1.0).abs() < 1e-5 && (exact / force - 1.0).abs() < 5e-3,
                "{exact} {press:?}"
            );
            let contact = press.maps[0].contact().unwrap();
            let (dx, _) = camera.pixel_size();
            assert_eq!(contact.height(), IMAGE_SIZE, "a line along the digit");
            assert!((contact.width() as f64 * dx - 2.0 * half).abs() < 1.01 * dx, "{} {half}", contact.width());
            assert!((f64::from(press.maps[0].max_depth()) - deep).abs() < 1e-6);
        }
    }

    #[test]
    fn a_concentric_hollow_is_at_the_same_depth_everywhere() {
        let (pad, camera) = pad();
        let radius = 0.025;
        let cover = PadCover::cylinder(radius).unwrap();
        // A hollow of a larger cylinder about the same axis, 0.3 mm inside the gel: the distance along every normal.
        let inner: f64 = radius - 0.3e-3;
        let hollow = |x: f64, _: f64| Some((inner * inner - x * x).max(0.0).sqrt() - radius);
        for column in [0, 60, 120, 239] {
            let place = camera.pixel_center(column, 100);
            let found = cover.penetration(&pad, place, 0.0, &mut { hollow }).unwrap().unwrap();
            assert!((found - 0.3e-3).abs() < 1e-7, "{column} {found}");
        }
    }

    #[test]
    fn a_flat_cover_is_the_flat_pad_to_the_bit() {
        let hand = Hand::ftac();
        let pad = &hand.pads[5];
        let cameras: Vec<&PadCamera> = pad.cameras.iter().map(|&camera| &hand.cameras[camera]).collect();
        let ball = |x: f64, y: f64| {
            let inside = 1e-4 - x * x - y * y;
            (inside > 0.0).then(|| 0.01 - inside.sqrt())
        };
        let gel = GelFoundation::winkler(&hand.parameters.gel);
        let flat = press_on(pad, &cameras, &gel, 1.3, ball).unwrap();
        assert_eq!(PadCover::FLAT.press(pad, &cameras, &gel, 1.3, ball).unwrap(), flat);
        // A cylinder of 100 m is flat but for rounding.
        let nearly = PadCover::cylinder(100.0).unwrap().press(pad, &cameras, &gel, 1.3, ball).unwrap();
        assert!((nearly.shift - flat.shift).abs() < 1e-6, "{} {}", nearly.shift, flat.shift);
    }

    #[test]
    fn impossible_covers_are_refused() {
        let (pad, camera) = pad();
        assert!(PadCover::cylinder(0.0).is_err() && PadCover::cylinder(f64::NAN).is_err());
        let narrow = PadCover::cylinder(0.4 * pad.w).unwrap();
        let text = narrow.press(&pad, &[&camera], &GEL, 1.0, |_, _| Some(0.0)).unwrap_err().to_string();
        assert!(text.contains("cover") && text.contains("expected"), "{text}");
        let cover = PadCover::cylinder(0.03).unwrap();
        assert!(cover.press(&pad, &[&camera], &GEL, 1.0, |_, _| Some(f64::NAN)).is_err());
        let nothing = cover.press(&pad, &[&camera], &GEL, 1.0, |_, _| None).unwrap();
        assert!(nothing.maps[0].contact().is_none() && nothing.force == 0.0);
    }
}
