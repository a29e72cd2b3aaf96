//! Near-field point lamps.
//!
//! The irradiance at a surface point is the paper's `kappa = eta * (-s . p)^mu / |s|^2`: |s| is the distance and s the unit
//! direction from the point to the lamp, p the lamp's principal direction, eta its strength and mu its radiation exponent.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A light-emitting diode behind the gel, pad frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// Position, m; z is negative, behind the surface.
    #[cfg_attr(feature = "schemars", schemars(with = "[f64; 3]"))]
    pub position: Point3<f64>,
    /// Principal direction p, unit vector.
    #[cfg_attr(feature = "schemars", schemars(with = "[f64; 3]"))]
    pub direction: Vector3<f64>,
    /// Strength eta, in units of the nominal lamp.
    pub eta: f64,
    /// Exponent mu of the radiation pattern: 1 for a bare die, 3 to 6 with a lens.
    pub mu: f64,
    /// Share of the strength in red, green and blue.
    pub color: [f64; 3],
    /// Half of its extent, m; it makes the lamp's shadows soft.
    #[serde(default = "half_a_package")]
    pub size: f64,
}

/// Returns half of a 2835 package, m.
fn half_a_package() -> f64 {
    1.4e-3
}

impl Lamp {
    /// Creates a lamp aimed at a point (m, pad frame).
    pub fn aimed(position: Point3<f64>, target: Point3<f64>, eta: f64, mu: f64, color: [f64; 3]) -> Self {
        Self { position, direction: (target - position).normalize(), eta, mu, color, size: half_a_package() }
    }

    /// Computes the unit direction s from a surface point to the lamp, and kappa (1/m2) at the point.
    pub fn direction_and_irradiance(&self, point: &Point3<f64>) -> (Vector3<f64>, f64) {
        let to_lamp = self.position - point;
        let square = to_lamp.norm_squared();
        let s = to_lamp / square.sqrt();
        let along = -s.dot(&self.direction);
        let kappa = if along > 0.0 { self.eta * along.powf(self.mu) / square } else { 0.0 };
        (s, kappa)
    }

    /// Computes the visible share of the lamp above a horizon. Horizon and lamp are given as tangents of their
    /// elevation over the pad's plane, seen from the point; the lamp is at `distance` (m) along the plane. The lamp is
    /// `2 size` high, and the share rises from 0 to 1 in a smooth step.
    pub fn visible_share(&self, horizon: f64, elevation: f64, distance: f64) -> f64 {
        let over = ((elevation - horizon) * distance / self.size.max(1e-6)).clamp(-1.0, 1.0);
        let part = 0.5 * (over + 1.0);
        part * part * (3.0 - 2.0 * part)
    }
}
