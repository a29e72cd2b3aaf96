//! How much the gel resists: pressure against indentation, and force.
//!
//! A foundation answers place by place: pressure depends on the indentation d there alone, relative to the gel's thickness,
//! `p = modulus e^exponent / (1 - e)^hardening`, `e = d / thickness`. Winkler's is linear: exponent 1, no hardening.
//!
//! [`Foundation::paper`] reproduces the paper's probe: a ball of 1.5 mm radius, pressure as force over the ball's cross-section,
//! response as the gel's change of thickness in per cent.

use hand_model::parameters::Gel;

use crate::error::OpticsError;
use crate::indentation::positive;

/// Pressure law of a gel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foundation {
    /// Thickness of the gel, m.
    pub thickness: f64,
    /// Pressure scale, Pa.
    pub modulus: f64,
    /// Exponent of the relative indentation.
    pub exponent: f64,
    /// Exponent of what is left of the thickness.
    pub hardening: f64,
}

/// Relative indentation beyond which the pressure no longer rises: the hardening law has a pole at 1.
const PRESSED_FLAT: f64 = 0.98;

impl Foundation {
    /// A Winkler foundation, as the hand's parameter file has it.
    pub fn winkler(gel: &Gel) -> Self {
        Self { thickness: gel.thickness, modulus: gel.stiffness * gel.thickness, exponent: 1.0, hardening: 0.0 }
    }

    /// The law under which the paper's probe gives the paper's response (`ftac optics eval --force`).
    pub fn paper(thickness: f64) -> Self {
        Self { thickness, modulus: 176.4e3, exponent: 0.55, hardening: 1.0 }
    }

    /// Refuses impossible values.
    pub fn check(&self) -> Result<(), OpticsError> {
        positive("gel thickness", self.thickness)?;
        positive("gel modulus", self.modulus)?;
        positive("gel exponent", self.exponent)?;
        if self.hardening >= 0.0 && self.hardening.is_finite() {
            Ok(())
        } else {
            Err(OpticsError::NotPositive { what: "gel hardening", value: self.hardening })
        }
    }

    /// Pressure (Pa) under an indentation (m).
    pub fn pressure(&self, indentation: f64) -> f64 {
        let part = (indentation / self.thickness).clamp(0.0, 1.0);
        if self.exponent == 1.0 && self.hardening == 0.0 {
            return self.modulus * part;
        }
        let part = part.min(PRESSED_FLAT);
        self.modulus * part.powf(self.exponent) / (1.0 - part).powf(self.hardening)
    }

    /// Force (N) on a ball of this radius (m) pressed in this deep (m).
    pub fn ball_force(&self, radius: f64, depth: f64) -> f64 {
        const RINGS: usize = 400;
        let deep = depth.min(radius);
        let edge = (2.0 * radius * deep - deep * deep).max(0.0).sqrt();
        let ring = edge / RINGS as f64;
        (0..RINGS)
            .map(|i| (i as f64 + 0.5) * ring)
            .map(|r| {
                let indentation = (radius * radius - r * r).sqrt() - (radius - depth);
                self.pressure(indentation) * std::f64::consts::TAU * r * ring
            })
            .sum()
    }
}

/// One row of a probe's response.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ProbePoint {
    /// Force over the ball's cross-section, kPa.
    pub pressure: f64,
    /// Change of the gel's thickness, per cent.
    pub response: f64,
}

/// A straight line through a response.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Sensitivity {
    /// Slope, per cent of thickness per kPa.
    pub per_kpa: f64,
    /// Coefficient of determination.
    pub r_squared: f64,
}

/// Radius of the paper's probe, m.
pub const PROBE_RADIUS: f64 = 1.5e-3;

/// The response of a gel to the paper's probe at `count` pressures, evenly spread up to `most` (kPa).
pub fn probe_response(gel: &Foundation, most: f64, count: usize) -> Vec<ProbePoint> {
    let section = std::f64::consts::PI * PROBE_RADIUS * PROBE_RADIUS;
    let at = |pressure: f64| {
        // The force rises with the depth, so bisection finds it.
        let (mut low, mut high) = (0.0, gel.thickness);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if gel.ball_force(PROBE_RADIUS, middle) < 1e3 * pressure * section { low = middle } else { high = middle }
        }
        ProbePoint { pressure, response: 100.0 * 0.5 * (low + high) / gel.thickness }
    };
    (0..count).map(|i| at(most * i as f64 / (count.max(2) - 1) as f64)).collect()
}

/// The least-squares line through points up to a pressure (kPa).
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
        let points = probe_response(&Foundation::paper(0.0025), 160.0, 161);
        let (low, all) = (sensitivity(&points, 50.0), sensitivity(&points, 160.0));
        assert!((low.per_kpa - 0.48).abs() < 0.01 && low.r_squared >= 0.973, "{low:?}");
        assert!((all.per_kpa - 0.30).abs() < 0.006 && all.r_squared >= 0.967, "{all:?}");
    }

    #[test]
    fn a_ball_on_winkler() {
        let gel = Foundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };
        let (radius, depth) = (0.01, 0.6e-3);
        // k times the cap's volume.
        let exact = 1.5e5 / 0.0025 * std::f64::consts::PI * depth * depth * (radius - depth / 3.0);
        assert!((gel.ball_force(radius, depth) / exact - 1.0).abs() < 1e-4);
    }
}
