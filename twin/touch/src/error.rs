//! What can go wrong, in words that say what to do.

use std::path::PathBuf;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum TouchError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A calibration file is not what it should be.
    #[error("{path}: not a calibration: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What was found.
        message: String,
    },
    /// A network file is not what it should be.
    #[error("{path}: not a network: {message}")]
    NetworkFormat {
        /// The file.
        path: PathBuf,
        /// What was found.
        message: String,
    },
    /// A kept training was made by another schedule.
    #[error("a kept training: found {found}, expected {expected}")]
    Schedule {
        /// Its schedule.
        found: String,
        /// The schedule asked for.
        expected: String,
    },
    /// There is no photometric model for a sensor configuration.
    #[error("no photometric model for sensor configuration `{0}`: calibrate it first")]
    Uncalibrated(char),
    /// Too little contact in the presses to fit a model.
    #[error(
        "configuration `{configuration}`: {samples} labelled contact pixels, at least {needed} are needed: press more often or deeper"
    )]
    TooFewSamples {
        /// Sensor configuration.
        configuration: char,
        /// Pixels found.
        samples: usize,
        /// Pixels needed.
        needed: usize,
    },
    /// Something has the wrong number of elements.
    #[error("{what}: found {found}, expected {expected}")]
    Size {
        /// What was counted.
        what: &'static str,
        /// Found.
        found: usize,
        /// Expected.
        expected: usize,
    },
    /// A number that must be finite is not.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A linear system has no solution.
    #[error("{0} has no solution")]
    Singular(&'static str),
}
