//! Accuracy of reconstructed surfaces, as a calibration states it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use touch::AngularError;

/// Width of a class of slopes in which errors of normals are counted, degrees.
const CLASS_DEG: f64 = 10.0;
/// Number of those classes.
pub(super) const CLASSES: usize = 8;

/// Errors on presses that nothing was learned from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    pub presses: usize,
    /// Angle between found and true normals inside the contact, degrees.
    pub normals_deg: AngularError,
    /// Mean angle between level and true normals inside the contact, degrees: the error of doing nothing.
    pub level_deg: f64,
    /// Found over true slope, in the true slope's direction (least squares over the pixels inside the contact).
    pub slope_ratio: f64,
    /// Mean of found over true depth of a ball's inner part.
    pub depth_ratio: f64,
    /// Root mean square error of that depth over the depth. Doing nothing has 1.
    pub depth_relative: f64,
    /// Presses whose inner part was found to stand out of the gel, or to slope the other way.
    pub wrong_sign: usize,
    /// Root mean square error of the height over the inner part, m.
    pub height: f64,
    /// Mean of the area that found and true contact share, over the area of both together.
    pub contact_overlap: f64,
    /// Largest share of a press's slopes that fit no surface.
    pub misfit: f64,
    /// Mean share of the contact whose colours or slopes the presses that were learned from did not have.
    pub beyond: f64,
    /// Root mean square error (degrees) of normals that were found at slopes of 0 to 10, 10 to 20, ... degrees. Where none was, that of
    /// the steepest slopes at which some were.
    pub by_slope_deg: [f64; CLASSES],
}

impl Accuracy {
    /// Expected error of a normal that was found with these slopes, degrees.
    pub fn normal_error(&self, [gx, gy]: [f32; 2]) -> f32 {
        self.by_slope_deg[class(f64::from(gx.hypot(gy)))] as f32
    }

    /// Expected error of a depth, m.
    pub fn depth_error(&self, depth: f64) -> f64 {
        self.depth_relative * depth
    }
}

/// Class of a slope.
pub(super) fn class(slope: f64) -> usize {
    ((slope.atan().to_degrees() / CLASS_DEG) as usize).min(CLASSES - 1)
}
