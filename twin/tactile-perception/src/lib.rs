//! Tactile perception: images become surface gradients, heights, contact patches and an in-hand object pose.
//!
//! [`frames`] decides which camera images are valid. [`colour_change`] finds the region in which an image differs from
//! its background. [`calibration`] fits the relation between colour change and slope to labelled presses;
//! [`photometric_stereo`] applies it pixel by pixel, and [`network`] uses each pixel's surroundings as well.
//! [`poisson`] integrates slopes to a height map. [`contacts`] finds contact patches in it, and [`slip`] their motion;
//! [`pad_touch`] is the result for one pad. [`self_contact`] distinguishes contacts of the hand with itself from contacts
//! with objects. [`posture`] estimates joint angles from fewer servos. [`pose`] registers patches, untouched pads and
//! servo readings to the known shape of the object. [`pipeline`] runs all of it for the 18 cameras of the hand.
//!
//! [`ball_press`] locates a ball of known radius that is pressed into a pad.
//!
//! This crate knows the hand model and nothing of simulators or hardware, and it never sees ground truth.
//!
//! # Conventions
//! SI units. The indentation `h` is positive into the gel; its gradients are `gx = dh/dx` and `gy = dh/dy` in the pad frame.
//! Images, gradient fields and height maps are row-major, [`IMAGE_SIZE`] squared, row 0 at the distal edge (largest y).

pub mod ball_press;
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
pub mod self_contact;
pub mod slip;

pub use ball_press::{BallEstimate, BallPress};
pub use calibration::{AngularError, CalibrationPress, PhotometricCalibration, PhotometricModel};
pub use colour_change::StereoOptions;
pub use contacts::{ContactOptions, ContactPatch, SurfacePoint};
pub use error::TouchError;
pub use frames::{CameraFault, ImageFault};
pub use network::{Network, PreparedNetwork};
pub use pad_touch::{HeightMap, PadTouch};
pub use photometric_stereo::Gradients;
pub use pipeline::{PadPerception, TouchPipeline, backgrounds};
pub use pose::{KnownShape, PoseEstimate, PoseInputs, PoseOptions, PosePrior, costs_from_pose, estimate_pose};
pub use posture::{Posture, Readings};
pub use self_contact::{ExpectedObject, SelfContactOptions};
pub use slip::PatchMotion;

pub use hand_model::pads::IMAGE_SIZE;

/// Number of pixels of one tactile image.
pub const PIXELS: usize = IMAGE_SIZE * IMAGE_SIZE;
