//! Diameters that a ball pressed into a fingertip sensor can have.

use crate::error::{OpticsError, check_positive};

/// Plausible ball diameters, from a pinhead to one and a half table-tennis balls, m; a value outside was given in
/// another unit.
const DIAMETER_RANGE: std::ops::RangeInclusive<f64> = 0.5e-3..=60e-3;

/// Returns an error for a diameter (m) that no ball pressed into a fingertip sensor has.
pub(crate) fn check_diameter(diameter: f64) -> Result<(), OpticsError> {
    check_positive("ball diameter", diameter)?;
    if DIAMETER_RANGE.contains(&diameter) { Ok(()) } else { Err(OpticsError::BallDiameter(1e3 * diameter)) }
}
