//! Errors of the crate.

use std::path::PathBuf;

use crate::single_sensor::ImageGeometry;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum TouchError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file is not a photometric calibration.
    #[error("{path}: not a calibration: {message}")]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Parser message or found value.
        message: String,
    },
    /// A file is not a network.
    #[error("{path}: not a network: {message}")]
    NetworkFormat {
        /// Path of the file.
        path: PathBuf,
        /// Parser message or found value.
        message: String,
    },
    /// The hand's file lacks the parameters by which its readings are judged.
    #[error(transparent)]
    Hand(#[from] ftac_platform::data::DataError),
    /// No image of this camera shows its pad untouched.
    #[error("camera {0}: found no image of its untouched pad, expected one before anything was touched")]
    NoBackground(usize),
    /// There is no photometric model for a sensor configuration.
    #[error("no photometric model for sensor configuration `{0}`: calibrate it first")]
    Uncalibrated(char),
    /// The presses have too few contact pixels to fit a model.
    #[error(
        "configuration `{configuration}`: {samples} labelled contact pixels, at least {needed} are needed: press more often or deeper"
    )]
    TooFewSamples {
        /// Letter of the sensor configuration.
        configuration: char,
        /// Number of labelled contact pixels.
        samples: usize,
        /// Least number for a fit.
        needed: usize,
    },
    /// A calibration from presses is no better than the one at hand.
    #[error(
        "calibration from presses on a ball: normals of held-out presses are {after:.2} deg off on the mean, expected less than the {before:.2} deg of the calibration at hand"
    )]
    NoImprovement {
        /// Mean angular error of the calibration at hand, degrees.
        before: f64,
        /// Mean angular error of the calibration from presses, degrees.
        after: f64,
    },
    /// The number of elements is wrong.
    #[error("{what}: found {found}, expected {expected}")]
    Size {
        /// Name of the quantity.
        what: &'static str,
        /// Number of elements found.
        found: usize,
        /// Number of elements expected.
        expected: usize,
    },
    /// A sensor's images have no pixels, or pixels without a size.
    #[error("image of {} x {} pixels of {} m: expected positive numbers", .0.columns, .0.rows, .0.pixel)]
    Geometry(ImageGeometry),
    /// A contact that a ball of this diameter cannot have.
    #[error(
        "contact of {radius} m radius with a ball of {diameter} m diameter: expected a radius above 0 and below the ball's"
    )]
    Ball {
        /// Radius of the contact, m.
        radius: f64,
        /// Diameter of the ball, m.
        diameter: f64,
    },
    /// A value is infinite or not a number.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A linear system has no solution.
    #[error("{0} has no solution")]
    Singular(&'static str),
}
