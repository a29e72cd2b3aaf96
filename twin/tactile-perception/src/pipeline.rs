//! Processing of the camera images of a hand into the tactile perception of each pad.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::robot::{TactileFrame, TactileImage};
use nalgebra::Isometry3;
use rayon::prelude::*;

use crate::PIXELS;
use crate::calibration::PhotometricCalibration;
use crate::colour_change::StereoOptions;
use crate::contacts::{ContactOptions, contact_free_points, find_contacts};
use crate::error::TouchError;
use crate::frames::{CameraFault, ImageFault, valid_images};
use crate::network::{Network, PreparedNetwork};
use crate::pad_touch::{HeightMap, PadTouch};
use crate::photometric_stereo::gradients;
use crate::poisson::{PoissonSolver, rest_level};
use crate::pose::{KnownShape, PoseEstimate, PoseInputs, PoseOptions, PosePrior, costs_from_pose, estimate_pose};
use crate::posture::Readings;
use crate::self_contact::{ExpectedObject, SelfContactOptions, mark_self_contacts};

/// Columns and rows of the grid of contact-free points on an untouched pad.
const UNTOUCHED_GRID: (usize, usize) = (4, 6);
/// Columns and rows of that grid on a pad that is touched elsewhere, where the points mark the limits of the object.
const TOUCHED_GRID: (usize, usize) = (10, 14);

/// Collects one image of each of the `cameras`, taken with the pads untouched.
pub fn backgrounds(frames: &[TactileFrame], cameras: usize) -> Result<Vec<Arc<TactileImage>>, TouchError> {
    let image = |camera: usize| {
        let frame = frames.iter().rev().find(|frame| frame.camera == camera);
        frame.map(|frame| frame.image.clone()).ok_or(TouchError::NoBackground(camera))
    };
    (0..cameras).map(image).collect()
}

/// Perception of all pads, and the cameras that are left out.
#[derive(Debug, Clone, Default)]
pub struct PadPerception {
    /// One entry per pad.
    pub touches: Vec<PadTouch>,
    /// Cameras that were left out, with the reasons.
    pub faults: Vec<CameraFault>,
}

/// All steps from images to touches, for one hand with one calibration.
///
/// ```
/// use std::sync::Arc;
///
/// use tactile_perception::hand_model::Hand;
/// use tactile_perception::hand_model::robot::TactileImage;
/// use tactile_perception::{PIXELS, PhotometricCalibration, TouchPipeline};
///
/// // Images of the untouched pads, in camera order, and a calibration (see `PhotometricCalibration::read`).
/// let hand = Hand::ftac();
/// let grey = Arc::new(TactileImage { rgb: vec![110; 3 * PIXELS] });
/// let untouched = vec![grey; hand.cameras.len()];
/// let calibration = PhotometricCalibration { version: 1, configurations: Default::default() };
///
/// let pipeline = TouchPipeline::new(&hand, calibration, untouched.clone())?;
/// let touches = pipeline.perceive(&untouched)?;
/// assert_eq!(touches.len(), 17);
/// assert!(touches.iter().all(|touch| !touch.is_touched()));
/// # Ok::<(), tactile_perception::TouchError>(())
/// ```
#[derive(Debug, Clone)]
pub struct TouchPipeline {
    hand: Hand,
    calibration: PhotometricCalibration,
    backgrounds: Vec<Arc<TactileImage>>,
    poisson: PoissonSolver,
    network: Option<PreparedNetwork>,
    /// Thresholds for a pad to count as touched.
    pub stereo: StereoOptions,
    /// Thresholds of contact patches.
    pub contacts: ContactOptions,
    /// Options of the pose estimate.
    pub pose: PoseOptions,
    /// Thresholds for self-contacts of the hand. Without them, every contact counts as one with an object.
    pub self_contact: Option<SelfContactOptions>,
}

impl TouchPipeline {
    /// Creates the pipeline. `backgrounds` has an image of every untouched camera, in camera order. Pads that
    /// `calibration` does not cover are blind.
    pub fn new(
        hand: &Hand,
        calibration: PhotometricCalibration,
        backgrounds: Vec<Arc<TactileImage>>,
    ) -> Result<Self, TouchError> {
        check_images(hand, "background", &backgrounds)?;
        Ok(Self {
            hand: hand.clone(),
            calibration,
            backgrounds,
            poisson: PoissonSolver::new(),
            network: None,
            stereo: StereoOptions::default(),
            contacts: ContactOptions::default(),
            pose: PoseOptions::default(),
            self_contact: None,
        })
    }

    /// The same pipeline with slopes from a network.
    pub fn with_network(&self, network: &Network) -> Self {
        Self { network: Some(network.prepare()), ..self.clone() }
    }

    /// The same pipeline with slopes by another calibration.
    pub fn with_calibration(&self, calibration: PhotometricCalibration) -> Self {
        Self { calibration, ..self.clone() }
    }

    /// The same pipeline with other background images, one per camera.
    pub fn with_backgrounds(&self, backgrounds: Vec<Arc<TactileImage>>) -> Result<Self, TouchError> {
        check_images(&self.hand, "background", &backgrounds)?;
        Ok(Self { backgrounds, ..self.clone() })
    }

    /// Perceives the contacts of all pads from a valid image of every camera; for frames that may be faulty see
    /// [`Self::perceive_frames`]. Cameras are processed in parallel; the result does not depend on the number of
    /// threads.
    pub fn perceive(&self, images: &[Arc<TactileImage>]) -> Result<Vec<PadTouch>, TouchError> {
        check_images(&self.hand, "tactile image", images)?;
        self.touches(&images.iter().cloned().map(Some).collect::<Vec<_>>())
    }

    /// Perceives the contacts of all pads from the camera board's frames. A camera is reported as a fault, and its pad
    /// is blind, if its image is missing, of the wrong size, frozen (`before` has the sequence numbers of earlier
    /// images), black or saturated, or if its pad is not calibrated.
    pub fn perceive_frames(
        &self,
        frames: &[TactileFrame],
        before: &[Option<u64>],
    ) -> Result<PadPerception, TouchError> {
        let (mut images, mut faults) = valid_images(&self.hand, frames, before);
        for (camera, image) in images.iter_mut().enumerate().filter(|(_, image)| image.is_some()) {
            let view = &self.hand.cameras[camera];
            let configuration = self.hand.pads[view.pad].configuration;
            if self.calibration.model(configuration).is_err() {
                *image = None;
                let fault = ImageFault::Uncalibrated(configuration);
                faults.push(CameraFault { camera, name: view.name.clone(), fault });
            }
        }
        Ok(PadPerception { touches: self.touches(&images)?, faults })
    }

    fn touches(&self, images: &[Option<Arc<TactileImage>>]) -> Result<Vec<PadTouch>, TouchError> {
        let maps: Vec<Option<HeightMap>> = (0..self.hand.cameras.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|camera| images[camera].as_ref().map_or(Ok(None), |image| self.height_map(camera, image)))
            .collect::<Result<_, _>>()?;
        let mut touches: Vec<PadTouch> =
            (0..self.hand.pads.len()).map(|pad| PadTouch { pad, ..PadTouch::default() }).collect();
        for (index, map) in maps.into_iter().enumerate() {
            let camera = &self.hand.cameras[index];
            let pad = &self.hand.pads[camera.pad];
            let touch = &mut touches[camera.pad];
            if images[index].is_none() {
                touch.blind = true;
                continue;
            }
            let height = map.as_ref().map(|map| map.height.as_slice());
            if let Some(height) = height {
                touch.patches.extend(find_contacts(pad, index, camera, self.hand.gel(), height, &self.contacts));
            }
            let (columns, rows) = if height.is_some() { TOUCHED_GRID } else { UNTOUCHED_GRID };
            touch.contact_free.extend(contact_free_points(pad, camera, height, self.contacts.raised, columns, rows));
            touch.heights.extend(map.map(Arc::new));
        }
        for touch in &mut touches {
            touch.force = touch.patches.iter().map(|patch| patch.force).sum();
        }
        Ok(touches)
    }

    /// Height map of one camera; `None` if its pad is untouched.
    pub fn height_map(&self, camera: usize, image: &Arc<TactileImage>) -> Result<Option<HeightMap>, TouchError> {
        let background = &self.backgrounds[camera];
        if Arc::ptr_eq(image, background) {
            return Ok(None);
        }
        let configuration = self.hand.pads[self.hand.cameras[camera].pad].configuration;
        let model = self.calibration.model(configuration)?;
        let found = match &self.network {
            Some(network) => network.gradients(image, background, (configuration, model), &self.stereo),
            None => gradients(image, background, model, &self.stereo),
        };
        let Some(gradients) = found else { return Ok(None) };
        let mut height = self.poisson.solve(&gradients.gx, &gradients.gy, self.hand.cameras[camera].pixel_size());
        let level = rest_level(&height, gradients.region);
        for value in &mut height {
            *value -= level;
        }
        Ok(Some(HeightMap { camera, height, gradients }))
    }

    /// Marks the patches that the hand itself presses, if the pipeline identifies self-contacts ([`Self::self_contact`]);
    /// `objects` are those expected in the hand.
    pub fn mark_self_contacts(
        &self,
        touches: &mut [PadTouch],
        readings: Readings,
        objects: &[ExpectedObject],
    ) -> Result<(), TouchError> {
        match &self.self_contact {
            Some(options) => mark_self_contacts(&self.hand, touches, readings, objects, (options, &self.pose)),
            None => Ok(()),
        }
    }

    /// Estimates the in-hand pose of an object of known shape from touches and servo readings.
    pub fn estimate_pose(
        &self,
        touches: &[PadTouch],
        readings: Readings,
        prior: &PosePrior,
        shape: &dyn KnownShape,
    ) -> Result<PoseEstimate, TouchError> {
        estimate_pose(&self.pose_inputs(touches, readings, prior, shape))
    }

    /// Computes the costs of a given pose of the object (palm frame) under the same evidence: see [`costs_from_pose`].
    pub fn costs_from_pose(
        &self,
        touches: &[PadTouch],
        readings: Readings,
        prior: &PosePrior,
        shape: &dyn KnownShape,
        pose: &Isometry3<f64>,
    ) -> Result<[f64; 2], TouchError> {
        costs_from_pose(&self.pose_inputs(touches, readings, prior, shape), pose)
    }

    fn pose_inputs<'a>(
        &'a self,
        touches: &'a [PadTouch],
        readings: Readings<'a>,
        prior: &'a PosePrior,
        shape: &'a dyn KnownShape,
    ) -> PoseInputs<'a> {
        PoseInputs { hand: &self.hand, touches, readings, prior, shape, options: &self.pose }
    }

    /// Images of the untouched pads, in camera order.
    pub fn backgrounds(&self) -> &[Arc<TactileImage>] {
        &self.backgrounds
    }

    /// The hand whose images are perceived.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }
}

fn check_images(hand: &Hand, what: &'static str, images: &[Arc<TactileImage>]) -> Result<(), TouchError> {
    if images.len() != hand.cameras.len() {
        return Err(TouchError::Size { what, found: images.len(), expected: hand.cameras.len() });
    }
    match images.iter().find(|image| image.rgb.len() != 3 * PIXELS) {
        Some(image) => {
            Err(TouchError::Size { what: "bytes of a tactile image", found: image.rgb.len(), expected: 3 * PIXELS })
        }
        None => Ok(()),
    }
}
