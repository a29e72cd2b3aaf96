//! Tactile perception of one pad: contact patches, contact-free surface, and the height maps in which they were found.

use std::sync::Arc;

use nalgebra::Point3;

use crate::contacts::ContactPatch;
use crate::photometric_stereo::Gradients;

/// Height map of one camera of a touched pad.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// Index of the camera.
    pub camera: usize,
    /// Indentation, m, [`PIXELS`](crate::PIXELS) values.
    pub height: Vec<f32>,
    /// Slopes of the indentation from photometric stereo.
    pub gradients: Gradients,
}

/// Tactile perception of one pad.
#[derive(Debug, Clone, Default)]
pub struct PadTouch {
    /// Index of the pad.
    pub pad: usize,
    /// Contact patches of all its cameras, including self-contacts of the hand.
    pub patches: Vec<ContactPatch>,
    /// Sum of the patches' normal forces, N.
    pub force: f64,
    /// Height maps of the cameras whose image differs from the background.
    pub heights: Vec<Arc<HeightMap>>,
    /// Points of the surface without contact (m, pad frame).
    pub contact_free: Vec<Point3<f64>>,
    /// True if a camera of the pad is left out, so that contact there is unknown.
    pub blind: bool,
}

impl PadTouch {
    /// True if the pad feels something other than the hand itself.
    pub fn is_touched(&self) -> bool {
        self.object_patches().next().is_some()
    }

    /// Contact patches that are not self-contacts of the hand.
    pub fn object_patches(&self) -> impl Iterator<Item = &ContactPatch> {
        self.patches.iter().filter(|patch| !patch.self_contact)
    }
}
