//! Errors of the input, and the checks that several modules share.

use std::path::Path;

/// An input that no image can be formed from.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OpticsError {
    /// A map of the wrong length.
    #[error("a map has {found} values; expected {expected} (240 x 240)")]
    MapSize {
        /// Number of values.
        found: usize,
        /// Number of pixels of the image.
        expected: usize,
    },
    /// An image or a map of the wrong length for a calibrated sensor.
    #[error("found {found} values; expected {expected}, by the calibration's image size")]
    ImageSize {
        /// Number of values.
        found: usize,
        /// Number of values of the calibration's image size.
        expected: usize,
    },
    /// An invalid size of reduced images.
    #[error("reduced image: found {0} pixels a side, expected 1 to 240")]
    ReducedSize(usize),
    /// A map has a value that is not a number or out of range.
    #[error("pixel (column {column}, row {row}) has the value {value}; expected {expected}")]
    MapValue {
        /// Column of the first such pixel.
        column: usize,
        /// Row of the first such pixel.
        row: usize,
        /// Its value.
        value: f32,
        /// Range of valid values.
        expected: &'static str,
    },
    /// The object's surface has a height that is not a number.
    #[error("the object's surface at ({x}, {y}) m is at {z} m; expected a number, or nothing")]
    Surface {
        /// Pad coordinate, m.
        x: f64,
        /// Pad coordinate, m.
        y: f64,
        /// Height, m.
        z: f64,
    },
    /// A force is negative or not finite.
    #[error("normal force is {0} N; expected a finite force of at least 0 N")]
    Force(f64),
    /// A pad or a gel has a size, thickness or stiffness that is not positive.
    #[error("{what} is {value}; expected a positive number")]
    NotPositive {
        /// Name of the quantity.
        what: &'static str,
        /// Its value, SI.
        value: f64,
    },
    /// A ball that is too small or too large for a tactile sensor, mm.
    #[error("ball diameter is {0} mm; expected 0.5 to 60 mm")]
    BallDiameter(f64),
    /// A pad is too wide for its cover's cylinder.
    #[error("cover: the pad is {found} m wide; expected at most {max} m, 0.8 of the cylinder's diameter")]
    CoverWidth {
        /// The pad's width, m.
        found: f64,
        /// Largest width that fits, m.
        max: f64,
    },
    /// A calibration file is not well-formed or contains an impossible value.
    #[error("sensor calibration: {0}")]
    Calibration(String),
    /// A job names a sensor that the renderer does not have.
    #[error("a job names sensor {found}; expected one below {count}")]
    NoSensor {
        /// Index in the job.
        found: usize,
        /// Number of sensors.
        count: usize,
    },
    /// No GPU was found, or it failed.
    #[error("GPU: {0}")]
    Gpu(String),
    /// A file or folder cannot be used.
    #[error("{path}: {what}")]
    File {
        /// Path of the file or folder.
        path: String,
        /// Description: what was found and what was expected.
        what: String,
    },
}

impl OpticsError {
    /// Builds an error about a file or folder.
    pub(crate) fn file(path: &Path, what: impl std::fmt::Display) -> Self {
        Self::File { path: path.display().to_string(), what: what.to_string() }
    }

    /// Builds an error about a calibration that does not parse or contains an impossible value.
    pub(crate) fn calibration(what: impl std::fmt::Display) -> Self {
        Self::Calibration(what.to_string())
    }
}

pub(crate) fn check_force(force: f64) -> Result<(), OpticsError> {
    if force.is_finite() && force >= 0.0 { Ok(()) } else { Err(OpticsError::Force(force)) }
}

pub(crate) fn check_positive(what: &'static str, value: f64) -> Result<(), OpticsError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(OpticsError::NotPositive { what, value }) }
}
