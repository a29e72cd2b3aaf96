//! What the hand feels: tactile images become surface gradients, heights, contact patches and an in-hand object pose.
//!
//! The story in order: [`frames`] says which images can be believed; [`calibration`] learns from labelled presses how colour changes with slope; [`photometric_stereo`]
//! applies it to an image, pixel by pixel, and [`network`] with its surroundings; [`poisson`] integrates the slopes to a height map; [`contacts`] finds the patches where something
//! presses, and [`slip`] how they move; [`posture`] says what six servos tell about fifteen joints; [`pose`] registers patches, untouched pads and servo
//! readings to the known shape of the object; [`pipeline`] runs all of it for the 18 cameras of the hand.
//!
//! This crate knows the hand model and nothing of simulators or hardware, and it never sees ground truth.
//!
//! # Conventions
//! SI units. Indentation `h` is positive into the gel; its gradients are `gx = dh/dx` and `gy = dh/dy` in the pad frame.
//! Images, gradient fields and height maps are row-major, [`IMAGE_SIZE`] squared, row 0 at the distal edge (largest y).

pub mod calibration;
pub mod colour_change;
pub mod contacts;
pub mod error;
pub mod frames;
pub mod network;
pub mod pad_touch;
pub mod photometric_stereo;
pub mod pipeline;
pub mod poisson;
pub mod pose;
pub mod posture;
pub mod slip;

pub use calibration::{AngularError, CalibrationPress, PhotometricCalibration, PhotometricModel};
pub use colour_change::StereoOptions;
pub use contacts::{ContactOptions, Patch, SurfacePoint};
pub use error::TouchError;
pub use frames::{CameraFault, Fault};
pub use network::{Network, PreparedNetwork};
pub use pad_touch::{HeightMap, PadTouch};
pub use photometric_stereo::Gradients;
pub use pipeline::{Perceived, TouchPipeline};
pub use pose::{KnownShape, PoseEstimate, PoseInputs, PoseOptions, PosePrior, costs_from_pose, estimate_pose};
pub use posture::Posture;
pub use slip::Slip;

pub use hand_model::pads::IMAGE_SIZE;

/// Pixels of one tactile image.
pub const PIXELS: usize = IMAGE_SIZE * IMAGE_SIZE;
