//! From tactile images to the held object: the touch pipeline with the scenario's known shapes.

use std::sync::Arc;

use hand_model::CAMERAS;
use hand_model::robot::{TactileFrame, TactileImage};
use nalgebra::{Isometry3, Point3, Vector3};
use scenarios::geometry::{DistanceGrid, Shape};
use scenarios::objects::ObjectModel;
use touch::{KnownShape, PadTouch, PoseEstimate, PosePrior, TouchError, TouchPipeline};

use crate::executive::Executive;

/// Error of the plan's idea of where the object will sit in the hand: standard deviations, m and rad.
const PRIOR_SIGMA: (f64, f64) = (0.012, 0.35);

/// Cell of the distance grids of meshes and how far they reach beyond the shape, m.
const GRID: (f64, f64) = (0.001, 0.012);

/// An object whose shape can be registered quickly: meshes carry a distance grid.
#[derive(Debug, Clone)]
pub struct KnownObject {
    /// The object.
    pub model: Arc<ObjectModel>,
    grid: Option<DistanceGrid>,
}

impl KnownObject {
    /// Prepares an object; a mesh takes some tenths of a second.
    pub fn new(model: Arc<ObjectModel>) -> Self {
        let grid = matches!(model.shape, Shape::Mesh(_)).then(|| DistanceGrid::new(&model.shape, GRID.0, GRID.1));
        Self { model, grid }
    }
}

impl KnownShape for KnownObject {
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let quick = self.grid.as_ref().and_then(|grid| grid.signed_distance(point));
        quick.unwrap_or_else(|| self.model.shape.signed_distance(point))
    }
}

/// What was felt.
#[derive(Debug, Clone)]
pub struct Felt {
    /// One entry a pad.
    pub touches: Vec<PadTouch>,
    /// Estimate of the held object's pose.
    pub estimate: PoseEstimate,
    /// What the plan had expected: `palm_from_object`.
    pub prior: Isometry3<f64>,
}

impl Felt {
    /// Whether any pad feels anything.
    pub fn anything(&self) -> bool {
        self.touches.iter().any(PadTouch::touched)
    }
}

/// Interprets the images that the executive took of `object` in the hand.
pub fn feel(pipeline: &TouchPipeline, executive: &Executive, object: &KnownObject) -> Result<Felt, TouchError> {
    let touches = pipeline.perceive(&by_camera(pipeline, executive.images()))?;
    let (grasp, percept) = executive.first();
    let prior =
        grasp.held.unwrap_or_else(|| grasp.palm_pose(&percept.position, percept.yaw).inverse() * percept.pose());
    let weak = PosePrior { palm_from_object: prior, sigma_translation: PRIOR_SIGMA.0, sigma_rotation: PRIOR_SIGMA.1 };
    let estimate = pipeline.estimate_pose(&touches, executive.servos(), &weak, object)?;
    Ok(Felt { touches, estimate, prior })
}

/// One image a camera; a camera that sent nothing is taken as idle (its background).
fn by_camera(pipeline: &TouchPipeline, frames: &[TactileFrame]) -> Vec<Arc<TactileImage>> {
    let mut images = pipeline.backgrounds().to_vec();
    for frame in frames.iter().filter(|frame| frame.camera < CAMERAS) {
        images[frame.camera] = frame.image.clone();
    }
    images
}
