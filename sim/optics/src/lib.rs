//! Image formation of a camera-based tactile sensor: from the shape and force that press into a pad to the image its
//! camera sees.
//!
//! There are two ways to use it:
//! - with a **sensor of your own** (GelSight, DIGIT): [`calibration`] fits the model to presses of a ball and renders at
//!   that sensor's own image size, as [`calibration::CalibratedSensor`];
//! - with the **pads of a hand**, flat or part of a cylinder ([`cover`]): [`press`] balances a force on the gel and
//!   [`Sensor`] renders 240 x 240 pixels; [`CurvedSensor`], [`ReducedSensor`] and a [`renderer`] for many images at once are
//!   built on it.
//!
//! Surfaces are reconstructed from images by the companion crate `tactile-perception`.
//!
//! # Model
//! The steps follow Zhao et al. 2025, doi:10.1038/s42256-025-01053-3 ("Details of image formation model"), called the
//! paper in this documentation. The object's shape above the pad and the normal force give an [`indentation`]. The
//! [`elastomer`] rounds it off where the gel leaves the object. Near-field [`lamps`] illuminate the gel's coating, with cast
//! [`shadows`]; its [`reflectance`] sends light to the [`camera`], which turns radiance into grey levels. A [`sensor`]
//! combines these steps for one camera unit, and a [`model`] holds all its parameters: nominal, of one unit, or calibrated.
//!
//! A pixel on deformed or shadowed gel has the background pixel's radiance plus `model(deformed gel) - model(flat
//! gel)`; any other pixel is the background's. The [`foundation`] relates force to indentation, and [`shapes`] has
//! twenty test objects. The 17 pads of the F-TAC Hand ship with one parameter file each ([`pads`]).
//!
//! Not modelled:
//! - light from one part of the gel to another;
//! - the sideways shift of points pressed towards the camera in the images of flat pads (calibrated and curved sensors
//!   have it);
//! - lens distortion in the pads' images, which are rectified (a calibrated sensor may have a
//!   [`lens`](calibration::lens)).
//!
//! The pads' rounded edges shape the background only, not the relief that casts shadows.
//!
//! # Frames
//! Everything is in the pad's frame, in metres: z out of the surface, camera and lamps at negative z. Maps are row-major,
//! 240 x 240 for a pad; row 0 is the distal edge (largest y), column 0 has the smallest x.
//!
//! # Example
//! A ball of 20 mm diameter, pressed with 2 N onto the middle of the index finger's distal pad. The package's page has
//! an example of a calibration.
//! ```
//! use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
//! use tactile_optics::hand_model::Hand;
//! use tactile_optics::{Sensor, press};
//!
//! let hand = Hand::ftac();
//! let pad = hand.pads.iter().find(|pad| pad.name == "index_distal").ok_or("no such pad")?;
//! let camera = &hand.cameras[pad.cameras[0]];
//!
//! let radius = 0.010_f64;
//! let ball = |x: f64, y: f64| {
//!     let inside = radius * radius - x * x - y * y;
//!     (inside > 0.0).then(|| radius - inside.sqrt()) // lowest point of the ball; it touches the surface at z = 0
//! };
//! let pressed = press(pad, &[camera], &hand.parameters.gel, 2.0, ball)?;
//! assert!((pressed.force - 2.0).abs() < 0.01);
//!
//! let sensor = Sensor::unit(pad, camera, 7);
//! let image = sensor.render(&pressed.maps[0], &mut ChaCha8Rng::seed_from_u64(1));
//! assert_ne!(image, **sensor.background());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Features
//! - `gpu`, off by default: `GpuRenderer`, the renderer on a GPU through wgpu.
//! - `schemars`, off by default: JSON schemas of models and similarities.
//!
//! # Determinism
//! Images rendered on the CPU are bit-identical on every machine, for any number of threads. The same seed gives the same
//! unit, noise and fit.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(missing_docs, unreachable_pub)]

pub mod calibration;
pub mod camera;
pub mod cover;
pub mod elastomer;
pub mod error;
pub mod foundation;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod indentation;
pub mod lamps;
pub mod model;
mod noise;
pub mod pads;
pub mod raster;
pub mod reflectance;
pub mod renderer;
pub mod sensor;
mod shading;
pub mod shadows;
pub mod shapes;
mod versioned;
mod wide;

/// The crate of pads, cameras and gel parameters, whose types appear in this one's functions.
pub use hand_model;

pub use cover::PadCover;
pub use error::OpticsError;
pub use foundation::GelFoundation;
#[cfg(feature = "gpu")]
pub use gpu::GpuRenderer;
pub use indentation::{IndentationMap, PressResult, press};
pub use model::{SensorModel, UnitVariation};
pub use raster::Raster;
pub use renderer::{CpuRenderer, RenderJob, Renderer};
pub use sensor::Sensor;
pub use sensor::curved::CurvedSensor;
pub use sensor::reduced::ReducedSensor;

/// Compiles and runs the example of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
