//! What a controller goes by when it reads a hand: when a digit holds something, and how free digits touch an object.

use std::path::Path;

use serde::Deserialize;

use super::HandParameters;
use platform::data::DataError;

/// Signs of a hold. Shares are of a full closing of the digit.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HoldLimits {
    /// Tension from which a cable counts as pulled, N.
    pub pulled: f64,
    /// A digit whose cable is taken up by less than this share has something in its way.
    pub blocked: f64,
    /// A digit that closes further than this share where its grasp holds has no part in holding.
    pub idle: f64,
    /// A digit that stops by this share later than where its grasp holds is stopped by something else: the thumb, most often.
    pub late: f64,
    /// A pad's middle this near to an object's surface is on it, m.
    pub near: f64,
}

/// Touch of an object by the free fingers, stretched.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Palpation {
    /// Tension of the touching fingers' cables, N.
    pub tension: f64,
    /// Angle of each of their joints under it, rad.
    pub curl: f64,
}

impl HandParameters {
    /// The signs of a hold.
    ///
    /// # Errors
    /// [`DataError`] where the file has none.
    pub fn hold(&self) -> Result<HoldLimits, DataError> {
        let expected =
            "a table with pulled, blocked, idle, late and near: touch and reflex tell by it what the hand holds";
        self.hold.ok_or_else(|| DataError::field(Path::new(&self.name), "hold", "none", expected))
    }

    pub(super) fn check_reading(&self, path: &Path) -> Result<(), DataError> {
        let hold = self.hold.iter().flat_map(|hold| {
            let HoldLimits { pulled, blocked, idle, late, near } = *hold;
            [("pulled", pulled), ("blocked", blocked), ("idle", idle), ("late", late), ("near", near)]
                .map(|(field, value)| (format!("hold.{field}"), value))
        });
        let palpation = self.palpation.iter().flat_map(|palpation| {
            let Palpation { tension, curl } = *palpation;
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

    /// Who needs signs of a hold is told which table is missing; a wrong sign is refused by its field.
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
