//! Resistance of the gel: pressure and force over indentation.
//!
//! The pressure at a point depends on the indentation d there alone, relative to the gel's thickness: `p = modulus
//! e^exponent / (1 - e)^hardening`, `e = d / thickness`. Winkler's foundation is the linear case: exponent 1, no
//! hardening.
//!
//! [`GelFoundation::paper`] reproduces the paper's probe: a ball of 1.5 mm radius, with pressure defined as force over the
//! ball's cross-section and response as the change of the gel's thickness in per cent.
//!
//! # Stiffness of the gel
//! The hand's parameter file has E = 0.15 MPa and uses `k = E / thickness`, the stiffness of a laterally free column of
//! gel. The paper's probe presses on a gel that is bonded to its window and laterally constrained by the surrounding
//! gel. For that case [`bonded_layer_force`] gives, with the same E and nothing fitted, the paper's response to 5 %
//! (`ftac optics eval --force`: 0.50 and 0.28 for 0.48 and 0.30 per kPa), while free columns give 0.90 and 0.59. So the
//! modulus is right, and the columns are 2.8 times too soft for this probe: Winkler columns of 0.42 MPa
//! ([`PAPER_WINKLER_MODULUS`]) respond like the paper's gel.
//!
//! The hand's pads use the soft columns nevertheless. The simulator and the touch pipeline share the value, so a pad's
//! force read from its image agrees with the physics either way. A stiffer gel would change every image of the trials,
//! and with them the stored photometric calibration, recordings and figures.

use hand_model::parameters::Gel;

use crate::error::{OpticsError, check_positive};

/// Pressure law of a gel.
///
/// ```
/// use tactile_optics::GelFoundation;
/// use tactile_optics::hand_model::parameters::Gel;
///
/// // A ball of 4 mm radius, 0.5 mm deep in independent columns: stiffness times volume.
/// let gel = GelFoundation::winkler(&Gel { thickness: 2.5e-3, stiffness: 60e6 });
/// let volume = std::f64::consts::PI * 0.5e-3_f64.powi(2) * (4e-3 - 0.5e-3 / 3.0);
/// assert!((gel.ball_force(4e-3, 0.5e-3) / (60e6 * volume) - 1.0).abs() < 1e-3);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GelFoundation {
    /// Thickness of the gel, m.
    pub thickness: f64,
    /// Pressure scale, Pa.
    pub modulus: f64,
    /// Exponent of the relative indentation.
    pub exponent: f64,
    /// Exponent of the remaining share of the thickness.
    pub hardening: f64,
}

/// Modulus (Pa) of Winkler columns that give the paper's probe the paper's response.
pub const PAPER_WINKLER_MODULUS: f64 = 0.42e6;

/// Computes the force (N) on a ball of this radius (m), pressed to this depth (m) into an incompressible elastic layer
/// of Young's `modulus` (Pa) and `thickness` (m) bonded to a rigid base: Hertz' law with the correction for the base
/// (Dimitriadis et al. 2002, for Poisson's ratio 0.5). Valid while the contact is not much wider than the layer is
/// thick.
pub fn bonded_layer_force(modulus: f64, thickness: f64, radius: f64, depth: f64) -> f64 {
    let chi = (radius * depth).max(0.0).sqrt() / thickness;
    let ground = 1.0 + chi * (1.133 + chi * (1.283 + chi * (0.769 + chi * 0.0975)));
    16.0 / 9.0 * modulus * radius.sqrt() * depth.max(0.0).powf(1.5) * ground
}

/// Relative indentation beyond which the pressure no longer rises: the hardening law has a pole at 1.
const MAX_RELATIVE_INDENTATION: f64 = 0.98;

impl GelFoundation {
    /// Returns the Winkler foundation of the hand's parameter file.
    pub fn winkler(gel: &Gel) -> Self {
        Self { thickness: gel.thickness, modulus: gel.stiffness * gel.thickness, exponent: 1.0, hardening: 0.0 }
    }

    /// Returns the law under which the paper's probe gives the paper's response (`ftac optics eval --force`).
    pub fn paper(thickness: f64) -> Self {
        Self { thickness, modulus: 176.4e3, exponent: 0.55, hardening: 1.0 }
    }

    /// Checks for impossible values.
    pub fn check(&self) -> Result<(), OpticsError> {
        check_positive("gel thickness", self.thickness)?;
        check_positive("gel modulus", self.modulus)?;
        check_positive("gel exponent", self.exponent)?;
        if self.hardening >= 0.0 && self.hardening.is_finite() {
            Ok(())
        } else {
            Err(OpticsError::NotPositive { what: "gel hardening", value: self.hardening })
        }
    }

    /// Computes the pressure (Pa) under an indentation (m).
    pub fn pressure(&self, indentation: f64) -> f64 {
        let part = (indentation / self.thickness).clamp(0.0, 1.0);
        if self.exponent == 1.0 && self.hardening == 0.0 {
            return self.modulus * part;
        }
        let part = part.min(MAX_RELATIVE_INDENTATION);
        self.modulus * part.powf(self.exponent) / (1.0 - part).powf(self.hardening)
    }

    /// Computes the force (N) on a ball of this radius (m) pressed to this depth (m).
    pub fn ball_force(&self, radius: f64, depth: f64) -> f64 {
        const RING_COUNT: usize = 400;
        let deep = depth.min(radius);
        let edge = (2.0 * radius * deep - deep * deep).max(0.0).sqrt();
        let ring = edge / RING_COUNT as f64;
        (0..RING_COUNT)
            .map(|i| (i as f64 + 0.5) * ring)
            .map(|r| {
                let indentation = (radius * radius - r * r).sqrt() - (radius - depth);
                self.pressure(indentation) * std::f64::consts::TAU * r * ring
            })
            .sum()
    }
}

/// One point of a probe's response.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct ProbePoint {
    /// Force over the ball's cross-section, kPa.
    pub pressure: f64,
    /// Change of the gel's thickness, per cent.
    pub response: f64,
}

/// A straight line fitted to a response.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct Sensitivity {
    /// Slope, per cent of thickness per kPa.
    pub per_kpa: f64,
    /// Coefficient of determination.
    pub r_squared: f64,
}

/// Radius of the paper's probe, m.
pub const PROBE_RADIUS: f64 = 1.5e-3;

/// Computes the response of a gel to the paper's probe at `count` pressures, evenly spread up to `most` (kPa).
pub fn probe_response(gel: &GelFoundation, most: f64, count: usize) -> Vec<ProbePoint> {
    response_to_force(gel.thickness, |depth| gel.ball_force(PROBE_RADIUS, depth), most, count)
}

/// Like [`probe_response`], for a gel of this `thickness` (m); `force` is the force (N) on the probe at a depth (m),
/// increasing with depth.
pub fn response_to_force(thickness: f64, force: impl Fn(f64) -> f64, most: f64, count: usize) -> Vec<ProbePoint> {
    let section = std::f64::consts::PI * PROBE_RADIUS * PROBE_RADIUS;
    let at = |pressure: f64| {
        let (mut low, mut high) = (0.0, thickness);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if force(middle) < 1e3 * pressure * section { low = middle } else { high = middle }
        }
        ProbePoint { pressure, response: 100.0 * 0.5 * (low + high) / thickness }
    };
    (0..count).map(|i| at(most * i as f64 / (count.max(2) - 1) as f64)).collect()
}

/// Fits the least-squares line through points up to a pressure (kPa).
pub fn sensitivity(points: &[ProbePoint], up_to: f64) -> Sensitivity {
    let some: Vec<&ProbePoint> = points.iter().filter(|point| point.pressure <= up_to + 1e-9).collect();
    let n = some.len() as f64;
    let (mx, my) = some.iter().fold((0.0, 0.0), |(x, y), p| (x + p.pressure / n, y + p.response / n));
    let (xx, xy, yy) = some.iter().fold((0.0, 0.0, 0.0), |(xx, xy, yy), p| {
        let (x, y) = (p.pressure - mx, p.response - my);
        (xx + x * x, xy + x * y, yy + y * y)
    });
    Sensitivity { per_kpa: xy / xx, r_squared: xy * xy / (xx * yy) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_probe_gives_the_papers_response() {
        let points = probe_response(&GelFoundation::paper(0.0025), 160.0, 161);
        let (low, all) = (sensitivity(&points, 50.0), sensitivity(&points, 160.0));
        assert!((low.per_kpa - 0.48).abs() < 0.01 && low.r_squared >= 0.973, "{low:?}");
        assert!((all.per_kpa - 0.30).abs() < 0.006 && all.r_squared >= 0.967, "{all:?}");
    }

    #[test]
    fn the_hands_own_modulus_bonded_to_its_window_responds_as_the_paper_says() {
        let thickness = 0.0025;
        let slopes = |force: &dyn Fn(f64) -> f64| {
            let points = response_to_force(thickness, force, 160.0, 161);
            [sensitivity(&points, 50.0).per_kpa, sensitivity(&points, 160.0).per_kpa]
        };
        let near = |found: [f64; 2], within: f64| {
            (found[0] / 0.48 - 1.0).abs() < within && (found[1] / 0.30 - 1.0).abs() < within
        };
        let bonded = slopes(&|depth| bonded_layer_force(0.15e6, thickness, PROBE_RADIUS, depth));
        assert!(near(bonded, 0.07), "{bonded:?}");
        let columns = |modulus: f64| GelFoundation { thickness, modulus, exponent: 1.0, hardening: 0.0 };
        let loose = slopes(&|depth| columns(0.15e6).ball_force(PROBE_RADIUS, depth));
        assert!(loose[0] > 1.8 * 0.48 && loose[1] > 1.8 * 0.30, "{loose:?}");
        let stiff = slopes(&|depth| columns(PAPER_WINKLER_MODULUS).ball_force(PROBE_RADIUS, depth));
        assert!(near(stiff, 0.03), "{stiff:?}");
    }

    #[test]
    fn a_thick_bonded_layer_is_a_half_space() {
        // Hertz with E / (1 - 0.25), on a layer a hundred times thicker than the contact is wide.
        let (radius, depth) = (1e-3, 1e-5);
        let hertz = 4.0 / 3.0 * 2e5 / 0.75 * f64::sqrt(radius) * f64::powf(depth, 1.5);
        assert!((bonded_layer_force(2e5, 0.05, radius, depth) / hertz - 1.0).abs() < 3e-3);
    }

    #[test]
    fn a_ball_on_winkler() {
        let gel = GelFoundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };
        let (radius, depth) = (0.01, 0.6e-3);
        // k times the cap's volume.
        let exact = 1.5e5 / 0.0025 * std::f64::consts::PI * depth * depth * (radius - depth / 3.0);
        assert!((gel.ball_force(radius, depth) / exact - 1.0).abs() < 1e-4);
    }
}
