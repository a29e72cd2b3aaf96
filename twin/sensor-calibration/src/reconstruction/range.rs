//! Range of colours and slopes in a calibration's presses, and thereby of the images for which its stated errors hold.
//!
//! The errors of a calibration are measured on balls like those it learned from. Steeper slopes show colours that no
//! press had. A pixel is out of range if the cell of its colour change, of side [`CELL_SIZE`], and all cells around it
//! are empty of the presses' pixels, if its slope is steeper than the steepest one, or if a channel is saturated.

use serde::{Deserialize, Serialize};
use tactile_perception::colour_change::whole_change;
use tactile_perception::{CalibrationPress, PIXELS};

use super::known_ball::{KnownBall, KnownPresses};
use crate::grid::PadGrid;

/// Side of a cell in the space of relative colour changes.
const CELL_SIZE: f32 = 0.06;
/// Number of cells on each side of zero change, per channel.
const CELLS_PER_SIDE: i32 = 128;
/// Quantile of the presses' slopes that counts as the steepest, and tolerance factor on it.
const STEEPEST_QUANTILE: f64 = 0.995;
const SLOPE_TOLERANCE: f32 = 1.1;
/// Range of grey levels of an unsaturated channel.
const UNSATURATED_LEVELS: std::ops::RangeInclusive<u8> = 3..=252;
/// Distance from a ball's centre, in contact radii, beyond which a pixel is untouched.
const UNTOUCHED_DISTANCE: f64 = 2.5;
/// Minimum noise of a relative colour change: the rounding of a grey level.
const MIN_NOISE: f32 = 2e-3;

/// Range of the presses' colours and slopes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRange {
    /// Steepest slope (tangent).
    steepest: f32,
    /// Sorted numbers of the occupied cells: colour changes of pixels in contact.
    cells: Vec<u32>,
    /// Standard deviation of the relative colour change of an untouched pixel.
    pub(super) noise: f32,
}

impl CalibrationRange {
    /// Determines the range of presses.
    pub fn from_presses(known: &KnownPresses, grid: PadGrid, pixel: f64) -> Self {
        let (mut slopes, mut cells) = (Vec::new(), std::collections::BTreeSet::new());
        let (mut squares, mut count) = (0.0f64, 0.0f64);
        for (press, ball) in known.presses.iter().zip(&known.balls) {
            let change = drift_free(press, ball, grid, pixel);
            for (i, change) in change.iter().enumerate() {
                let offset = ball.offset(grid, pixel, i);
                if let Some((_, [gx, gy])) = ball.at(offset) {
                    slopes.push(gx.hypot(gy));
                    cells.extend(cell(*change).map(cell_number));
                } else if offset[0].hypot(offset[1]) > UNTOUCHED_DISTANCE * ball.contact {
                    squares += change.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>() / 3.0;
                    count += 1.0;
                }
            }
        }
        slopes.sort_by(f64::total_cmp);
        let steepest =
            slopes.get(((slopes.len().max(1) - 1) as f64 * STEEPEST_QUANTILE) as usize).copied().unwrap_or(0.0);
        Self {
            steepest: steepest as f32,
            cells: cells.into_iter().collect(),
            noise: ((squares / f64::max(count, 1.0)).sqrt() as f32).max(MIN_NOISE),
        }
    }

    /// Returns the steepest slope, degrees.
    pub fn steepest_deg(&self) -> f32 {
        self.steepest.atan().to_degrees()
    }

    /// True if a pixel is out of range by its colour change, slope, or grey levels.
    pub fn is_beyond(&self, change: [f32; 3], [gx, gy]: [f32; 2], grey: [u8; 3]) -> bool {
        gx.hypot(gy) > SLOPE_TOLERANCE * self.steepest
            || grey.iter().any(|level| !UNSATURATED_LEVELS.contains(level))
            || !self.has_colour(change)
    }

    fn has_colour(&self, change: [f32; 3]) -> bool {
        let Some([r, g, b]) = cell(change) else { return false };
        let around = |at: i32| at - 1..=at + 1;
        let mut near =
            around(r).flat_map(|r| around(g).flat_map(move |g| around(b).map(move |b| cell_number([r, g, b]))));
        near.any(|number| self.cells.binary_search(&number).is_ok())
    }

    /// Returns an error if the numbers are implausible.
    pub fn check(&self) -> Result<(), String> {
        let sorted = self.cells.windows(2).all(|pair| pair[0] < pair[1]);
        if self.steepest > 0.0 && self.steepest.is_finite() && self.noise > 0.0 && sorted && !self.cells.is_empty() {
            return Ok(());
        }
        Err("range: found no colours, or a slope or noise that is not positive".to_owned())
    }
}

/// Returns a press's colour change, minus the median of each channel over untouched pixels, which is drift.
pub(super) fn drift_free(press: &CalibrationPress, ball: &KnownBall, grid: PadGrid, pixel: f64) -> Vec<[f32; 3]> {
    let mut change = whole_change(&press.image, &press.background);
    let far = |i: &usize| {
        let [x, y] = ball.offset(grid, pixel, *i);
        x.hypot(y) > UNTOUCHED_DISTANCE * ball.contact
    };
    for c in 0..3 {
        let mut values: Vec<f32> = (0..PIXELS).step_by(5).filter(far).map(|i| change[i][c]).collect();
        if values.is_empty() {
            continue;
        }
        let middle = values.len() / 2;
        let drift = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
        change.iter_mut().for_each(|change| change[c] -= drift);
    }
    change
}

/// Returns the cell of a colour change; `None` beyond all cells.
fn cell(change: [f32; 3]) -> Option<[i32; 3]> {
    let cells = change.map(|value| (value / CELL_SIZE).floor() as i32);
    cells.iter().all(|at| (-CELLS_PER_SIDE + 1..CELLS_PER_SIDE - 1).contains(at)).then_some(cells)
}

fn cell_number(cell: [i32; 3]) -> u32 {
    cell.iter().fold(0, |number, at| number * 2 * CELLS_PER_SIDE as u32 + (at + CELLS_PER_SIDE) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_or_slope_that_no_press_had_is_beyond() {
        let seen: std::collections::BTreeSet<u32> =
            (0..20).flat_map(|k| cell([0.02 * k as f32, -0.01 * k as f32, 0.0])).map(cell_number).collect();
        let range = CalibrationRange { steepest: 0.6, cells: seen.into_iter().collect(), noise: 0.01 };
        let grey = [100; 3];
        assert!(!range.is_beyond([0.2, -0.1, 0.01], [0.3, 0.3], grey));
        assert!(range.is_beyond([0.2, -0.1, 0.01], [0.6, 0.4], grey), "steeper");
        assert!(range.is_beyond([0.2, 0.3, 0.01], [0.3, 0.3], grey), "another colour");
        assert!(range.is_beyond([0.2, -0.1, 0.01], [0.3, 0.3], [255, 100, 100]), "saturated");
        assert!(range.is_beyond([f32::NAN, 9.0, 0.0], [0.1, 0.1], grey));
        assert!(range.check().is_ok() && CalibrationRange { steepest: f32::NAN, ..range }.check().is_err());
    }
}
