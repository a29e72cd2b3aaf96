//! Calibration of a real sensor: presses of a ball of known size determine the parameters of a
//! [`SensorModel`](crate::SensorModel).
//!
//! A [`folder`] of images is read, and rectified if its camera's [`lens`] is known or [`zhang`] finds it from a
//! [`checkerboard`]. Presses without labels are detected as a [`circle`], which [`relocation`] corrects, and the [`background`] is estimated from them. [`samples`]
//! picks pixels, and [`fit`] adjusts
//! lamps, reflectance, response, camera and gel to them by [`least_squares`]. [`evaluation`] renders held-out presses and
//! measures their [`similarity`] to the real images; [`recovery`] tests whether a fit finds the parameters of a known
//! sensor.

pub mod assumptions;
pub mod background;
pub mod checkerboard;
pub mod circle;
pub mod evaluation;
pub mod file;
pub mod fit;
pub mod folder;
pub mod least_squares;
pub mod lens;
mod parameters;
pub mod photo;
mod profile;
pub mod recovery;
pub mod relocation;
pub mod samples;
mod scene;
pub mod sensor;
pub mod similarity;
pub mod zhang;

pub use assumptions::Assumptions;
pub use evaluation::{HeldOut, Views};
pub use file::SensorCalibration;
pub use fit::{BallFit, Effort};
pub use folder::{BallPress, LeftOut, PressFolder};
pub use lens::Lens;
pub use photo::Photo;
pub use sensor::CalibratedSensor;
pub use similarity::Similarity;
pub use zhang::LensFit;
