//! Calibration of a real sensor: presses of a ball of known size determine the parameters of a
//! [`SensorModel`](crate::SensorModel).
//!
//! A [`folder`] of [images](image_files) is read, [checked](press_checks), and rectified if its camera's [`lens`] is
//! known or [`zhang`] determines it from a [`checkerboard`]. Presses without labels are detected as a [`circle`], which
//! [`relocation`] corrects, and the [`background`] is estimated from them. [`samples`] picks pixels, and [`fit`]
//! adjusts lamps, reflectance, response, camera and gel to them by least squares. [`evaluation`] renders held-out
//! presses and measures their [`similarity`] to the real images. [`recovery`] tests whether a fit finds the parameters
//! of a known sensor.

pub mod assumptions;
pub mod background;
pub mod bitmap;
pub mod checkerboard;
pub mod circle;
mod diameter;
pub mod evaluation;
pub mod file;
pub mod fit;
pub mod folder;
pub mod image_files;
mod labels;
pub mod lens;
pub mod orientation;
mod parameters;
pub mod photo;
pub mod press_checks;
mod profile;
pub mod recovery;
pub mod relocation;
mod rgb_image;
pub mod samples;
mod scene;
pub mod sensor;
pub mod similarity;
pub mod zhang;

pub use assumptions::Assumptions;
pub use evaluation::{HeldOutSimilarity, ViewSimilarity};
pub use file::SensorCalibration;
pub use fit::{BallFit, FitEffort};
pub use folder::{BallPress, PressFolder, PressReadOptions, SkippedImage};
pub use ftac_least_squares::FittedParameter;
pub use lens::Lens;
pub use photo::{BitDepth, Photo};
pub use sensor::CalibratedSensor;
pub use similarity::Similarity;
pub use zhang::LensFit;
