//! Accuracy of reconstructed surfaces, as stated by a calibration.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tactile_perception::AngularError;

/// Width of a slope class, degrees. Errors of normals are grouped by such classes.
const SLOPE_CLASS_DEG: f64 = 10.0;
/// Number of slope classes.
pub(super) const SLOPE_CLASS_COUNT: usize = 8;

/// Errors on held-out presses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    pub presses: usize,
    /// Angle between estimated and true normals inside the contact, degrees.
    pub normals_deg: AngularError,
    /// Mean angle between level and true normals inside the contact, degrees: the error of the trivial estimate.
    pub level_deg: f64,
    /// Ratio of estimated to true slope, in the true slope's direction (least squares over the pixels inside the
    /// contact).
    pub slope_ratio: f64,
    /// Ratio of estimated to true depth of a ball's inner part, mean.
    pub depth_ratio: f64,
    /// Root-mean-square error of that depth over the depth. The trivial estimate, a level surface, has 1.
    pub depth_relative: f64,
    /// Presses whose inner part was estimated to bulge out of the gel, or to slope the other way.
    pub wrong_sign: usize,
    /// Root-mean-square error of the height over the inner part, m.
    pub height: f64,
    /// Intersection over union of estimated and true contact area, mean.
    pub contact_overlap: f64,
    /// Largest share of a press's slopes that is inconsistent with any surface.
    pub misfit: f64,
    /// Mean share of the contact whose colours or slopes are outside the range of the training presses.
    pub beyond: f64,
    /// Root-mean-square error (degrees) of normals estimated at slopes of 0 to 10, 10 to 20, ... degrees. A class
    /// without samples has the value of the steepest class below it that has some.
    pub by_slope_deg: [f64; SLOPE_CLASS_COUNT],
}

impl Accuracy {
    /// Returns the expected error of a normal with these estimated slopes, degrees.
    pub fn normal_error(&self, [gx, gy]: [f32; 2]) -> f32 {
        self.by_slope_deg[slope_class(f64::from(gx.hypot(gy)))] as f32
    }

    /// Returns the expected error of a depth, m.
    pub fn depth_error(&self, depth: f64) -> f64 {
        self.depth_relative * depth
    }
}

/// Returns the class of a slope.
pub(super) fn slope_class(slope: f64) -> usize {
    ((slope.atan().to_degrees() / SLOPE_CLASS_DEG) as usize).min(SLOPE_CLASS_COUNT - 1)
}
