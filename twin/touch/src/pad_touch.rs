//! What one pad feels: contact patches, free surface, and the height maps they were found in.

use std::sync::Arc;

use nalgebra::Point3;

use crate::contacts::Patch;
use crate::photometric_stereo::Gradients;

/// What one camera saw of a touched pad.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// Index of the camera.
    pub camera: usize,
    /// Indentation, m, [`PIXELS`] values.
    pub height: Vec<f32>,
    /// Its slopes as photometric stereo gave them.
    pub gradients: Gradients,
}

/// What one pad feels.
#[derive(Debug, Clone, Default)]
pub struct PadTouch {
    /// Index of the pad.
    pub pad: usize,
    /// Contact patches of all its cameras.
    pub patches: Vec<Patch>,
    /// Sum of the patches' normal forces, N.
    pub force: f64,
    /// Height maps of the cameras whose image differs from the background.
    pub heights: Vec<Arc<HeightMap>>,
    /// Points of the surface that are felt to be free (m, pad frame).
    pub clear: Vec<Point3<f64>>,
    /// A camera of the pad is left out: what presses there is not known.
    pub blind: bool,
}

impl PadTouch {
    /// Whether anything presses.
    pub fn touched(&self) -> bool {
        !self.patches.is_empty()
    }
}
