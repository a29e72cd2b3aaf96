//! Reflectance of the gel's coating: the generalised Lambertian model of Oren and Nayar, as stated in the paper.
//!
//! `L_c = kappa rho_c / pi max(0, cos theta_i) f_r`, `f_r = A + B max(0, cos(phi_r - phi_i)) sin(alpha) tan(beta)`, `A =
//! 1 - 0.5 sigma^2 / (sigma^2 + 0.33)`, `B = 0.45 sigma^2 / (sigma^2 + 0.09)`, alpha the larger and beta the smaller of
//! the angles theta_i (light) and theta_r (viewer) to the normal.

use std::f64::consts::PI;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Reflectance of the coating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Reflectance {
    /// Albedo rho_c in red, green and blue.
    pub albedo: [f64; 3],
    /// Roughness sigma, rad; 0 is Lambertian.
    pub roughness: f64,
}

impl Reflectance {
    /// Computes the paper's A.
    pub fn a(&self) -> f64 {
        let square = self.roughness * self.roughness;
        1.0 - 0.5 * square / (square + 0.33)
    }

    /// Computes the paper's B.
    pub fn b(&self) -> f64 {
        let square = self.roughness * self.roughness;
        0.45 * square / (square + 0.09)
    }

    /// Computes `max(0, cos theta_i) f_r / pi` from unit normal, direction to the light and direction to the viewer.
    ///
    /// Uses `cos(phi_r - phi_i) sin(alpha) tan(beta) = (l.v - (n.l)(n.v)) / max(n.l, n.v)`, which needs no angles.
    pub fn factor(&self, normal: &Vector3<f64>, light: &Vector3<f64>, viewer: &Vector3<f64>) -> f64 {
        let (cos_i, cos_r) = (normal.dot(light), normal.dot(viewer));
        if cos_i <= 0.0 {
            return 0.0;
        }
        let across = (light.dot(viewer) - cos_i * cos_r).max(0.0);
        cos_i / PI * (self.a() + self.b() * across / cos_i.max(cos_r))
    }

    /// Computes the radiance L_c of each channel under irradiance `kappa`.
    pub fn radiance(&self, kappa: f64, normal: &Vector3<f64>, light: &Vector3<f64>, viewer: &Vector3<f64>) -> [f64; 3] {
        let factor = kappa * self.factor(normal, light, viewer);
        self.albedo.map(|albedo| albedo * factor)
    }
}
