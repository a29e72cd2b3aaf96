//! Errors of the crate.

use std::path::PathBuf;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum TouchError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// A file is not a photometric calibration.
    #[error("{path}: not a calibration: {message}")]
    Format {
        path: PathBuf,
        /// Parser message or found value.
        message: String,
    },
    /// A file is not a network.
    #[error("{path}: not a network: {message}")]
    NetworkFormat {
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
    TooFewSamples { configuration: char, samples: usize, needed: usize },
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
    Size { what: &'static str, found: usize, expected: usize },
    /// A value is infinite or not a number.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A linear system has no solution.
    #[error("{0} has no solution")]
    Singular(&'static str),
}
