//! Grasps in a hand's parameter file: the digits that take the objects of a trial one after the other, and the ranges
//! of grasp proposals.

use std::path::Path;
use std::sync::LazyLock;

use serde::Deserialize;

use super::HandParameters;
use crate::digit::Digit;
use ftac_platform::data::DataError;

/// Grasp sets of a hand. Field names are those of the file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grasps {
    /// Distance from the wrist to the palm frame's origin along y, m, for the hand to which the lengths below refer.
    pub wrist: f64,
    /// Distance of that hand's palm face from the palm frame's origin along -z, m.
    pub palm_face: f64,
    /// One grasp set for each object of a trial, in the order in which the objects are taken.
    pub set: Vec<GraspRanges>,
}

/// A set of digits that takes an object, and the sampling ranges of its grasp proposals.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspRanges {
    /// The digits that take the object, in their order.
    pub digits: Vec<Digit>,
    /// Roll about the finger axis, deg; negative values turn the ulnar edge down.
    pub roll: [f64; 2],
    /// Pitch, deg; positive with the fingers down.
    pub pitch: [f64; 2],
    /// Distance of the object's centre from the wrist, m.
    pub along: [f64; 2],
    /// Distance of the object's centre from the palm frame's origin along -x, m.
    pub across: [f64; 2],
    /// Gap between palm and object, m.
    pub gap: [f64; 2],
    /// Opposition angle, deg.
    pub opposition: [f64; 2],
    /// Distance by which the hand rises while the digits close, m.
    pub raise: [f64; 2],
    /// Cable tension of each finger, N.
    pub tension: [f64; 2],
    /// Cable tension while approaching, N.
    pub pre_tension: [f64; 2],
    /// Ranges of the thumb, if it is one of the digits.
    pub thumb: Option<ThumbRanges>,
}

/// Sampling ranges of a thumb that closes with the fingers.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThumbRanges {
    /// Delay behind the fingers, s.
    pub delay: [f64; 2],
    /// Cable tension, N.
    pub tension: [f64; 2],
    /// Cable tension while approaching, N.
    pub pre_tension: [f64; 2],
}

impl HandParameters {
    /// Returns the file's own grasps, or those of the F-TAC Hand.
    ///
    /// # Panics
    /// Never in a tested build: the built-in file has grasps.
    pub fn grasps(&self) -> &Grasps {
        static FTAC: LazyLock<Grasps> = LazyLock::new(|| HandParameters::ftac().grasps.expect("the built-in grasps"));
        self.grasps.as_ref().unwrap_or_else(|| &FTAC)
    }
}

impl Grasps {
    pub(super) fn check(&self, digits: usize, path: &Path) -> Result<(), DataError> {
        if !(self.wrist.is_finite() && self.wrist > 0.0) {
            return Err(DataError::field(path, "grasps.wrist", self.wrist, "a positive length"));
        }
        let mut taken: Vec<Digit> = Vec::new();
        for (n, set) in self.set.iter().enumerate() {
            let fault = |field: &str, found: String, expected: &str| {
                Err(DataError::field(path, format!("grasps.set[{n}].{field}"), found, expected))
            };
            let own = &set.digits;
            if own.is_empty() || !own.is_sorted_by(|a, b| a < b) || own.iter().any(|digit| digit.index() >= digits) {
                return fault("digits", format!("{own:?}"), "digits of the hand in their order");
            }
            if let Some(digit) = own.iter().find(|digit| taken.contains(digit)) {
                return fault("digits", digit.name().to_owned(), "digits that take no object before");
            }
            taken.extend(own);
            if own.contains(&Digit::Thumb) != set.thumb.is_some() {
                let found = if set.thumb.is_some() { "ranges" } else { "none" };
                return fault("thumb", found.to_owned(), "ranges where the thumb is among the digits");
            }
            let thumb = set.thumb.iter().flat_map(|thumb| {
                [
                    ("thumb.delay", thumb.delay),
                    ("thumb.tension", thumb.tension),
                    ("thumb.pre_tension", thumb.pre_tension),
                ]
            });
            let ranges = [
                ("roll", set.roll),
                ("pitch", set.pitch),
                ("along", set.along),
                ("across", set.across),
                ("gap", set.gap),
                ("opposition", set.opposition),
                ("raise", set.raise),
                ("tension", set.tension),
                ("pre_tension", set.pre_tension),
            ];
            for (field, range) in ranges.into_iter().chain(thumb) {
                if !(range[0] < range[1] && range.iter().all(|end| end.is_finite())) {
                    return fault(field, format!("{range:?}"), "the lower end before the upper");
                }
            }
        }
        Ok(())
    }
}
