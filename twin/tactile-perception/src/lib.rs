//! Tactile perception: images become surface gradients, heights, contact patches and an in-hand object pose.
//!
//! There are two ways to use it:
//! - with **one sensor** (GelSight, DIGIT): [`single_sensor`] calibrates it by presses of a ball and turns its images, of any
//!   size, into surfaces and contacts;
//! - with **a hand** of many cameras: [`TouchPipeline`] does so for all of its pads at once, and locates the held object.
//!
//! # Example
//! The shape of a surface from its slopes, and the contact in it:
//! ```
//! use tactile_perception::contacts::{ContactOptions, find_contacts};
//! use tactile_perception::hand_model::Hand;
//! use tactile_perception::poisson::PoissonSolver;
//! use tactile_perception::{IMAGE_SIZE, PIXELS};
//!
//! let hand = Hand::ftac();
//! let pad = &hand.pads[0];
//! let camera = &hand.cameras[pad.cameras[0]];
//!
//! // A bump of 0.5 mm height and 2 mm width (standard deviation), as slopes.
//! let bump = |i: usize| {
//!     let (x, y) = camera.pixel_center(i % IMAGE_SIZE, i / IMAGE_SIZE);
//!     (x, y, 0.5e-3 * (-(x * x + y * y) / (2.0 * 2e-3_f64.powi(2))).exp())
//! };
//! let (gx, gy): (Vec<f32>, Vec<f32>) = (0..PIXELS)
//!     .map(bump)
//!     .map(|(x, y, h)| ((-x * h / 4e-6) as f32, (-y * h / 4e-6) as f32))
//!     .unzip();
//! let mut height = PoissonSolver::new().solve(&gx, &gy, camera.pixel_size());
//! let level = height.iter().copied().fold(f32::INFINITY, f32::min);
//! height.iter_mut().for_each(|h| *h -= level);
//!
//! let patches = find_contacts(pad, pad.cameras[0], camera, hand.gel(), &height, &ContactOptions::default());
//! assert_eq!(patches.len(), 1);
//! assert!((patches[0].peak - 0.5e-3).abs() < 0.02e-3 && patches[0].centroid.x.abs() < 0.1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//! From images to poses:
//! - [`frames`]: which camera images are valid. [`grid`]: images of any size on the grid of this crate.
//! - [`colour_change`]: the region in which an image differs from its background.
//! - [`calibration`]: the relation between colour change and slope, from labelled presses. [`photometric_stereo`] applies it
//!   pixel by pixel; [`network`] uses each pixel's surroundings as well.
//! - [`poisson`]: slopes to a height map. [`contacts`]: contact patches in it. [`slip`]: their motion.
//! - [`single_sensor`]: all of this for one sensor.
//! - [`pad_touch`]: the result for one pad of a hand. [`self_contact`]: contacts of the hand with itself.
//! - [`posture`]: joint angles from fewer servos. [`pose`]: registration of patches, untouched pads and servo readings to the
//!   known shape of the object. [`pipeline`]: all of it for the cameras of a hand.
//! - [`ball_press`]: a ball of known radius located in a pad.
//!
//! This crate knows the hand model and nothing of simulators or hardware, and it never sees ground truth.
//!
//! # Features
//! - `schemars`, off by default: the JSON schema of [`AngularError`].
//!
//! # Conventions
//! SI units. The indentation `h` is positive into the gel; its gradients are `gx = dh/dx` and `gy = dh/dy` in the pad frame.
//! Images, gradient fields and height maps are row-major, [`IMAGE_SIZE`] squared, row 0 at the distal edge (largest y).
//! Results do not depend on the number of threads.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(missing_docs, unreachable_pub)]

pub mod ball_press;
pub mod calibration;
pub mod colour_change;
pub mod contacts;
pub mod error;
pub mod frames;
pub mod grid;
pub mod network;
pub mod pad_touch;
pub mod photometric_stereo;
pub mod pipeline;
pub mod poisson;
pub mod pose;
pub mod posture;
pub mod self_contact;
pub mod single_sensor;
pub mod slip;

/// The crate of hands, pads and images, whose types appear in this one's functions.
pub use hand_model;

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
pub use single_sensor::SingleSensor;
pub use slip::PatchMotion;

pub use hand_model::pads::IMAGE_SIZE;

/// Number of pixels of one tactile image.
pub const PIXELS: usize = IMAGE_SIZE * IMAGE_SIZE;

/// Compiles and runs the example of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
