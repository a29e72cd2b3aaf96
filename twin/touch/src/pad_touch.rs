//! What one pad feels: contact patches, free surface, and the height maps they were found in.

use std::sync::Arc;

use nalgebra::Point3;

use crate::contacts::Patch;
use crate::photometric_stereo::Gradients;

/// Height map of one camera of a touched pad.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    pub camera: usize,
    /// Indentation, m, [`PIXELS`] values.
    pub height: Vec<f32>,
    /// Its slopes from photometric stereo.
    pub gradients: Gradients,
}

/// What one pad feels.
#[derive(Debug, Clone, Default)]
pub struct PadTouch {
    pub pad: usize,
    /// Contact patches of all its cameras, the hand's own among them.
    pub patches: Vec<Patch>,
    /// Sum of the patches' normal forces, N.
    pub force: f64,
    /// Height maps of the cameras whose image differs from the background.
    pub heights: Vec<Arc<HeightMap>>,
    /// Points of the surface without contact (m, pad frame).
    pub clear: Vec<Point3<f64>>,
    /// A camera of the pad is left out: contact there is unknown.
    pub blind: bool,
}

impl PadTouch {
    /// Whether it feels something that is not the hand itself.
    pub fn touched(&self) -> bool {
        self.of_objects().next().is_some()
    }

    /// Contact patches that are not the hand's own.
    pub fn of_objects(&self) -> impl Iterator<Item = &Patch> {
        self.patches.iter().filter(|patch| !patch.own)
    }
}
