//! The camera behind the gel: a pinhole, and the response that turns radiance into grey levels.
//!
//! A pinhole parallel to the pad's plane sees that plane without distortion. The image rectified to the camera's
//! rectangle (`PadCamera::pixel_center`) is therefore the pinhole's own image of the undeformed gel, and the camera enters
//! the shading only as the direction v to the viewer. The sideways shift of points pressed towards the camera is left to
//! the rectification. The response is the paper's (Mitsunaga's): the radiance `G(M)` is a third-order polynomial of the
//! measured intensity M.

use hand_model::pads::{IMAGE_SIZE, PadCamera};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::wide::integer_part;

/// A perspective camera that looks along the pad's +z.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pinhole {
    /// Centre of projection (m, pad frame), z negative.
    #[cfg_attr(feature = "schemars", schemars(with = "[f64; 3]"))]
    pub position: Point3<f64>,
}

impl Pinhole {
    /// Computes the unit direction from a surface point to the camera (the paper's v).
    pub fn direction_to_camera(&self, point: &Point3<f64>) -> Vector3<f64> {
        (self.position - point).normalize()
    }

    /// Computes the intrinsics K for which the undeformed plane z = 0 fills the image of `camera`. Camera frame: x, -y
    /// and z of the pad; mirrored, because the rectified image shows the pad as seen from outside.
    pub fn intrinsics(&self, camera: &PadCamera) -> Matrix3<f64> {
        let ((dx, dy), (x0, y0)) = (camera.pixel_size(), camera.pixel_center(0, 0));
        let depth = -self.position.z;
        Matrix3::new(
            depth / dx,
            0.0,
            (self.position.x - x0) / dx, //
            0.0,
            depth / dy,
            (y0 - self.position.y) / dy, //
            0.0,
            0.0,
            1.0,
        )
    }

    /// Projects a point of the pad frame to column and row (fractional; pixel centres are whole numbers): `x = K X /
    /// Z`.
    pub fn project(&self, camera: &PadCamera, point: &Point3<f64>) -> (f64, f64) {
        let v = point - self.position;
        let image = self.intrinsics(camera) * Vector3::new(v.x, -v.y, v.z) / v.z;
        (image.x, image.y)
    }

    /// True if the point is within the image.
    pub fn is_in_view(&self, camera: &PadCamera, point: &Point3<f64>) -> bool {
        let (column, row) = self.project(camera, point);
        let inside = -0.5..IMAGE_SIZE as f64 - 0.5;
        inside.contains(&column) && inside.contains(&row)
    }
}

/// Photometric response of one channel: `G(M) = g1 M + g2 M^2 + g3 M^3`, M in 0..1; G(1) = 1 is the full scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CameraResponse {
    /// Coefficients g1, g2, g3.
    pub coefficients: [f64; 3],
}

impl CameraResponse {
    /// The response whose grey levels are proportional to radiance.
    pub const LINEAR: Self = Self { coefficients: [1.0, 0.0, 0.0] };

    /// Computes G: radiance from measured intensity.
    pub fn radiance(&self, measured: f64) -> f64 {
        let [g1, g2, g3] = self.coefficients;
        measured * (g1 + measured * (g2 + measured * g3))
    }

    /// Computes F, the inverse of G, by bracketed Newton iteration; above full scale it continues as a straight line.
    pub fn measured(&self, radiance: f64) -> f64 {
        let [g1, g2, g3] = self.coefficients;
        let full = self.radiance(1.0);
        if radiance >= full {
            return 1.0 + (radiance - full) / (g1 + 2.0 * g2 + 3.0 * g3);
        }
        if radiance <= 0.0 {
            return 0.0;
        }
        let (mut low, mut high) = (0.0, 1.0);
        let mut m = radiance / full;
        for _ in 0..60 {
            let over = self.radiance(m) - radiance;
            if over > 0.0 {
                high = m
            } else {
                low = m
            }
            let newton = m - over / (g1 + m * (2.0 * g2 + 3.0 * g3 * m));
            // The bounds count: at the root, which is one of them, the step is zero.
            let next = if (low..=high).contains(&newton) { newton } else { 0.5 * (low + high) };
            let step = (next - m).abs();
            m = next;
            if step < 1e-14 {
                break;
            }
        }
        m
    }

    /// True if G is increasing on 0..1.
    pub fn is_monotonic(&self) -> bool {
        let [g1, g2, g3] = self.coefficients;
        (0..=100).map(|i| f64::from(i) / 100.0).all(|m| g1 + 2.0 * g2 * m + 3.0 * g3 * m * m > 0.0)
    }
}

/// F as a table in grey levels, which may exceed 255.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ResponseTable {
    grey: Vec<f32>,
}

impl ResponseTable {
    const TABLE_CELLS: usize = 1024;
    /// Radiance at the end of the table.
    const MAX_RADIANCE: f64 = 4.0;

    pub(crate) fn new(response: &CameraResponse) -> Self {
        let value =
            |cell| 255.0 * response.measured(cell as f64 * Self::MAX_RADIANCE / Self::TABLE_CELLS as f64) as f32;
        Self { grey: (0..=Self::TABLE_CELLS + 1).map(value).collect() }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn values(&self) -> &[f32] {
        &self.grey
    }

    /// Returns the grey level of a radiance, by linear interpolation in the table.
    #[inline(always)]
    pub(crate) fn grey(&self, radiance: f32) -> f32 {
        let at =
            (radiance * (Self::TABLE_CELLS as f64 / Self::MAX_RADIANCE) as f32).clamp(0.0, Self::TABLE_CELLS as f32);
        let cell = integer_part(at).min(Self::TABLE_CELLS as u32) as usize;
        let part = at - cell as i32 as f32;
        let [low, high] = [0, 1].map(|next| self.grey[cell + next]);
        low + part * (high - low)
    }
}
