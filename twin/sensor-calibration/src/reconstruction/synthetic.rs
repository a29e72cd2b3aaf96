//! Synthetic presses, rendered with a sensor's fitted image-formation model.
//!
//! A dozen presses of one ball cover few slopes at few positions. Renders of other shapes, sizes and positions serve as
//! the prior for learning from the real presses.

use anyhow::Result;
use tactile_optics::calibration::{CalibratedSensor, SensorCalibration};
use tactile_perception::CalibrationPress;

use crate::pressed_shapes::{Relief, ball_height, make_each, training_reliefs};
use crate::real_presses::SimulatedSensor;

/// Radii of the balls pressed in addition to the shapes, as multiples of the calibration ball's, and weight of each in
/// the draw relative to a shape.
const BALL_RADIUS_FACTORS: [f64; 4] = [0.4, 0.7, 1.0, 1.6];
const BALL_WEIGHT: usize = 6;

/// Minimum number of columns of a rendered image; the pads' grid has fewer.
const MIN_COLUMNS: usize = 320;

/// Returns the sensor at the coarsest resolution whose images still have [`MIN_COLUMNS`], and the factor by which its
/// pixels are larger.
fn coarser(sensor: &CalibratedSensor) -> Result<(CalibratedSensor, usize)> {
    let (width, height) = sensor.size();
    let times = (width / MIN_COLUMNS).max(1);
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
    let likeness = SimulatedSensor::from_sensor(sensor);
    let balls = BALL_RADIUS_FACTORS.iter().flat_map(|share| std::iter::repeat_n(share * radius, BALL_WEIGHT));
    let balls = balls.map(|radius| Box::new(move |x, y| ball_height(radius, x, y)) as Relief);
    let reliefs: Vec<Relief> = training_reliefs().into_iter().chain(balls).collect();
    make_each(count, |n| likeness.press(&reliefs, n, noise, seed))
}
