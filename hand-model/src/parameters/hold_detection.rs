//! Thresholds by which a controller reads a hand: signs that a digit holds something, and the touch of an object by
//! free digits.

use std::path::Path;

use serde::Deserialize;

use super::HandParameters;
use ftac_platform::data::DataError;

/// Thresholds for detecting a hold. Shares are fractions of a digit's full closing.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HoldLimits {
    /// Tension threshold above which a cable counts as pulled, N.
    pub pulled: f64,
    /// Closure threshold: a digit whose cable is pulled and taken up by less than this share is blocked by something.
    pub blocked: f64,
    /// Closure threshold: a digit expected to close further than this share in its grasp plays no part in holding.
    pub idle: f64,
    /// Lateness threshold: a digit that stops this share later than expected in its grasp was stopped by something
    /// else, usually the thumb.
    pub late: f64,
    /// Distance threshold: a pad whose middle is this near to an object's surface is on it, m.
    pub near: f64,
}

/// Palpation: touch of an object by the free fingers, stretched out.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PalpationParameters {
    /// Cable tension of the touching fingers, N.
    pub tension: f64,
    /// Angle of each of their joints at that tension, rad.
    pub curl: f64,
}

impl HandParameters {
    /// Returns the thresholds for detecting a hold.
    ///
    /// # Errors
    /// [`DataError`] if the file has none.
    pub fn hold(&self) -> Result<HoldLimits, DataError> {
        let expected =
            "a table with pulled, blocked, idle, late and near: touch and reflex tell by it what the hand holds";
        self.hold.ok_or_else(|| DataError::field(Path::new(&self.name), "hold", "none", expected))
    }

    pub(super) fn check_hold_detection(&self, path: &Path) -> Result<(), DataError> {
        let hold = self.hold.iter().flat_map(|hold| {
            let HoldLimits { pulled, blocked, idle, late, near } = *hold;
            [("pulled", pulled), ("blocked", blocked), ("idle", idle), ("late", late), ("near", near)]
                .map(|(field, value)| (format!("hold.{field}"), value))
        });
        let palpation = self.palpation.iter().flat_map(|palpation| {
            let PalpationParameters { tension, curl } = *palpation;
            [("palpation.tension".to_owned(), tension), ("palpation.curl".to_owned(), curl)]
        });
        match hold.chain(palpation).find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((field, value)) => Err(DataError::field(path, field, value, "a positive number")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A controller that needs the thresholds gets an error that names the missing table. A wrong value is rejected
    /// with its field.
    #[test]
    fn missing_signs_are_named() {
        let without = HandParameters { hold: None, ..HandParameters::ftac() };
        let error = without.hold().expect_err("none").to_string();
        assert!(error.starts_with("ftac: hold: found none, expected a table with pulled"), "{error}");
        let text = include_str!("../../data/ftac_hand.toml");
        let parse = |text: &str| HandParameters::parse(text, Path::new("own.toml"));
        let error = parse(&text.replace("late = 0.25", "late = -1.0")).expect_err("wrong").to_string();
        assert_eq!(error, "own.toml: hold.late: found -1, expected a positive number");
    }
}
