//! Calibration to a real sensor: presses of a ball of known size become the numbers of a [`SensorModel`](crate::SensorModel).
//!
//! In order: a [`folder`] of images is read (and rectified, if its camera's [`lens`] is known or [`zhang`] finds it from a
//! [`checkerboard`]), presses without labels are found as a [`circle`]; [`samples`] picks pixels;
//! [`fit`] adjusts lamps, reflectance, response, camera and gel to them by [`least_squares`]; [`evaluation`] renders presses that were held
//! out and measures their [`similarity`] to the real images; [`recovery`] asks whether a fit finds a sensor that is known.

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
pub mod samples;
mod scene;
pub mod sensor;
pub mod similarity;
pub mod zhang;

pub use evaluation::{HeldOut, Views};
pub use file::CalibrationFile;
pub use fit::{Assumptions, BallFit, Effort};
pub use folder::{BallPress, PressFolder};
pub use lens::Lens;
pub use photo::Photo;
pub use sensor::CalibratedSensor;
pub use similarity::Similarity;
pub use zhang::LensFit;
