//! Synthetic ("imagined") presses, rendered with a sensor's fitted image-formation model.
//!
//! A dozen presses of one ball cover few slopes at few positions. Renders of other shapes, sizes and positions serve as
//! the prior for learning from the real presses.

use anyhow::Result;
use tactile_optics::calibration::{CalibratedSensor, SensorCalibration};
use tactile_perception::CalibrationPress;

use crate::pressed_shapes::{Relief, ball, each, seen};
use crate::real_presses::Likeness;

/// Radii of the balls pressed in addition to the shapes, as multiples of the calibration ball's, and weight of each in
/// the draw relative to a shape.
const BALLS: [f64; 4] = [0.4, 0.7, 1.0, 1.6];
const OFTEN: usize = 6;

/// Minimum number of columns of a rendered image; the pads' grid has fewer.
const COLUMNS: usize = 320;

/// Returns the sensor at the coarsest resolution whose images still have [`COLUMNS`], and the factor by which its
/// pixels are larger.
fn coarser(sensor: &CalibratedSensor) -> Result<(CalibratedSensor, usize)> {
    let (width, height) = sensor.size();
    let times = (width / COLUMNS).max(1);
    let (columns, rows) = (width / times, height / times);
    let mean = |at: usize| {
        let (channel, column, row) = (at % 3, at / 3 % columns * times, at / 3 / columns * times);
        let pixels = (0..times * times).map(|k| (row + k / times) * width + column + k % times);
        pixels.map(|pixel| sensor.background()[3 * pixel + channel]).sum::<f32>() / (times * times) as f32
    };
    let background = (0..3 * columns * rows).map(mean).collect();
    let calibration = sensor.calibration();
    let pixel_mm = calibration.pixel_mm * times as f64;
    let file = SensorCalibration { columns, rows, pixel_mm, ..calibration.clone() };
    Ok((CalibratedSensor::new(file, background)?, times))
}

/// Renders `count` presses into the sensor; `radius` is the calibration ball's, m.
pub fn presses(sensor: &CalibratedSensor, radius: f64, count: usize, seed: u64) -> Result<Vec<CalibrationPress>> {
    let (sensor, times) = coarser(sensor)?;
    // A pixel averaged from several has less noise.
    let noise = sensor.model().noise / times as f64;
    let likeness = Likeness::of(sensor);
    let balls = BALLS.iter().flat_map(|share| std::iter::repeat_n(share * radius, OFTEN));
    let balls = balls.map(|radius| Box::new(move |x, y| ball(radius, x, y)) as Relief);
    let reliefs: Vec<Relief> = seen().into_iter().chain(balls).collect();
    each(count, |n| likeness.press(&reliefs, n, noise, seed))
}
