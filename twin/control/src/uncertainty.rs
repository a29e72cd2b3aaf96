//! Errors that a controller expects of its own robot. They come from a file with values found by calibration, whatever
//! the actual errors are.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use serde::Deserialize;

/// Standard deviations of the errors that the controller expects, and their persistent share.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uncertainty {
    /// Persistent error of the arm, each axis, m.
    pub arm: f64,
    /// Error of object detection, each of x and y, m.
    #[serde(alias = "eyes")]
    pub detector: f64,
    /// Share of the variance of `detector` that stays the same over the detections of a trial.
    #[serde(alias = "eyes_lasting")]
    pub detector_persistent_share: f64,
}

impl Uncertainty {
    /// Errors of a robot and a detector that were measured to be exact. No smaller values are claimed than a tenth of a
    /// millimetre.
    pub const EXACT: Self = Self { arm: 1e-4, detector: 1e-4, detector_persistent_share: 0.5 };

    /// Errors of the robot that comes with the program, `control/data/uncertainty.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn standard() -> Self {
        let text = include_str!("../data/uncertainty.toml");
        Self::parse(text, Path::new("uncertainty.toml")).expect("the built-in uncertainties are valid")
    }

    /// Replaces the error of the detector by the standard deviation of a detection, m, each of x and y.
    #[must_use]
    pub fn with_detector_sigma(self, sigma: Option<f64>) -> Self {
        Self { detector: sigma.unwrap_or(self.detector), ..self }
    }

    /// Standard deviation of the part of a detection's error that is new each time, each of x and y, m.
    pub fn independent_detection_sigma(&self) -> f64 {
        self.detector * (1.0 - self.detector_persistent_share).sqrt()
    }

    /// Standard deviation of the part of the hand's position error relative to an object that persists through a trial,
    /// each of x and y, m.
    pub fn persistent_sigma(&self) -> f64 {
        self.arm.hypot(self.detector * self.detector_persistent_share.sqrt())
    }

    /// Standard deviation of the hand's position relative to an object whose position is the mean of `detections`
    /// detections, each axis, m.
    pub fn aim_sigma(&self, detections: u32) -> f64 {
        self.persistent_sigma().hypot(self.independent_detection_sigma() / f64::from(detections.max(1)).sqrt())
    }

    /// Parses and checks the text of a file; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let read: Self = parse_toml(text, path)?;
        for (field, value) in [("arm", read.arm), ("detector", read.detector)] {
            if !(value > 0.0 && value <= 0.1) {
                return Err(DataError::field(path, field, value, "more than 0 and at most 0.1 m"));
            }
        }
        if !(0.0..=1.0).contains(&read.detector_persistent_share) {
            return Err(DataError::field(path, "detector_persistent_share", read.detector_persistent_share, "0 to 1"));
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_that_never_errs_is_refused() {
        assert!(Uncertainty::standard().arm > 0.0);
        let error = Uncertainty::parse("arm = 0.0\neyes = 0.005\neyes_lasting = 0.5", Path::new("mine.toml"))
            .unwrap_err()
            .to_string();
        assert!(error.contains("mine.toml") && error.contains("arm") && error.contains("more than 0"), "{error}");
    }
}
