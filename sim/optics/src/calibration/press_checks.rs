//! Fast checks of presses, before anything is fitted.
//!
//! A press is out of line if its image is arranged or exposed unlike the background's, or if its label is not where the
//! image changes. The checks are those that find presses without a label.

use rayon::prelude::*;

use crate::calibration::circle::{self, Circle, CircleNotFound};
use crate::calibration::folder::{BallPress, PressFolder};
use crate::calibration::orientation::describe_rearrangement;
use crate::calibration::photo::Photo;

/// Plausible ratio of an image's median brightness to that of the background; outside it, the exposure differed.
const EXPOSURE_RANGE: std::ops::RangeInclusive<f64> = 0.7..=1.4;
/// Distance between a label and the changed area above which the label is wrong, in radii of the label or of the circle
/// found (the larger one).
const MAX_LABEL_DISTANCE: f64 = 1.0;
/// Plausible ratio of a label's radius to that of the circle found, relative to the median of the presses; outside it,
/// the label is out of line.
const RADIUS_RATIO_RANGE: std::ops::RangeInclusive<f64> = 0.6..=1.7;

/// Computes the brightness of an image relative to a background of the same size: median over the pixels.
pub fn relative_brightness(photo: &Photo, background: &Photo) -> f64 {
    let bright = background.rgb.iter().zip(&photo.rgb).step_by(7).filter(|(before, _)| **before > 12);
    let mut ratios: Vec<f64> = bright.map(|(before, now)| f64::from(*now) / f64::from(*before)).collect();
    if ratios.is_empty() {
        return 1.0;
    }
    let middle = ratios.len() / 2;
    *ratios.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns the reason why an image of the right size cannot be compared with the background; `None` if it can.
pub fn background_mismatch(photo: &Photo, background: &Photo) -> Option<String> {
    let found = relative_brightness(photo, background);
    if !EXPOSURE_RANGE.contains(&found) {
        return Some(format!(
            "found an image {found:.2} times as bright as the untouched gel; expected {} to {} times: exposure, lamps or depth \
             (bits) differ",
            EXPOSURE_RANGE.start(),
            EXPOSURE_RANGE.end()
        ));
    }
    let way = describe_rearrangement(photo, background)?;
    Some(format!("found an image that looks {way} against the untouched gel; expected both alike"))
}

/// Returns the reason why each press is out of line; `None` for a good one.
pub fn inconsistent_presses(folder: &PressFolder) -> Vec<Option<String>> {
    let found: Vec<Result<Circle, CheckFailure>> =
        folder.presses.par_iter().map(|press| check(press, &folder.background)).collect();
    let ratio = |press: &BallPress, circle: &Circle| press.radius / circle.radius;
    let mut ratios: Vec<f64> = folder
        .presses
        .iter()
        .zip(&found)
        .filter_map(|(press, found)| Some(ratio(press, found.as_ref().ok()?)))
        .collect();
    ratios.sort_by(f64::total_cmp);
    let typical = ratios.get(ratios.len() / 2).copied().unwrap_or(1.0);
    let reason = |(press, found): (&BallPress, Result<Circle, CheckFailure>)| match found {
        Err(CheckFailure::Reason(reason)) => Some(reason),
        Err(CheckFailure::Unknown) => None,
        Ok(circle) => {
            let found = ratio(press, &circle) / typical;
            let out = press.labelled && !RADIUS_RATIO_RANGE.contains(&found);
            out.then(|| {
                format!(
                    "found a label of {:.0} pixels radius where the image changes within {:.0}; expected about {:.0}, as with the \
                     other labels",
                    press.radius,
                    circle.radius,
                    circle.radius * typical
                )
            })
        }
    };
    folder.presses.iter().zip(found).map(reason).collect()
}

enum CheckFailure {
    Reason(String),
    /// The image shows no circle: only the fit can judge the label.
    Unknown,
}

/// Finds the circle in a press's image.
fn check(press: &BallPress, background: &Photo) -> Result<Circle, CheckFailure> {
    if let Some(reason) = background_mismatch(&press.photo, background) {
        return Err(CheckFailure::Reason(reason));
    }
    if !press.labelled {
        return Ok(Circle { center: press.center, radius: press.radius });
    }
    let found = match circle::find_circle(&press.photo, background) {
        Ok(found) => found,
        Err(error @ CircleNotFound::NoContact { .. }) => return Err(CheckFailure::Reason(error.to_string())),
        Err(CircleNotFound::NotRound { .. }) => return Err(CheckFailure::Unknown),
    };
    let away = (found.center[0] - press.center[0]).hypot(found.center[1] - press.center[1]);
    if away > MAX_LABEL_DISTANCE * press.radius.max(found.radius) {
        let ([x, y], [u, v]) = (press.center, found.center);
        return Err(CheckFailure::Reason(format!(
            "found a label at column {x:.0}, row {y:.0}; expected it where the image changes, about column {u:.0}, row {v:.0}"
        )));
    }
    Ok(found)
}
