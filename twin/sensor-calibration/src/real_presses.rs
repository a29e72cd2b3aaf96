//! Presses of a ball into a real sensor, and into its simulated counterpart, on the grid of the pads' images.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use hand_model::robot::TactileImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use tactile_optics::calibration::{CalibratedSensor, PressFolder};
use tactile_perception::CalibrationPress;

use crate::grid::PadGrid;
use crate::pressed_shapes::{PressPlace, Relief};
use crate::reconstruction::known_ball::KnownBall;

/// Placeholder for the only sensor, in place of a pad's configuration.
pub const CONFIGURATION: char = 'a';
/// Range of penetration depths into a simulated sensor, m.
const DEPTH_RANGE: std::ops::Range<f64> = 0.15e-3..1.1e-3;

/// Minimum indentation, m; below it the gel counts as level.
const MIN_DEPTH: f32 = 2e-6;

/// Presses with the size of a pixel (dx, dy; m).
pub struct RealPresses {
    /// Presses in the order of their file names.
    pub presses: Vec<CalibrationPress>,
    /// Size of a pixel on the pads' grid, m.
    pub pixel: (f64, f64),
}

impl RealPresses {
    /// Reads a folder like `optics calibrate`. `diameter` is the ball's, `pixel` the size of the photos' pixels, m.
    pub fn read(folder: &Path, diameter: f64, pixel: f64) -> Result<Self> {
        let folder = PressFolder::read(folder, diameter, false)?;
        if let Some(image) = folder.skipped.first() {
            bail!("{}: {}", image.name, image.reason);
        }
        let (width, height) = (folder.background.width, folder.background.height);
        let grid = PadGrid { width, height };
        let background = grid.image(&folder.background.rgb);
        let press = |press: &tactile_optics::calibration::BallPress| {
            let radius = 0.5 * press.diameter;
            let ball = KnownBall { center: press.center, radius, contact: (press.radius * pixel).min(0.999 * radius) };
            CalibrationPress {
                camera: 0,
                image: grid.image(&press.photo.rgb),
                background: background.clone(),
                indentation: ball.on_grid(grid, pixel),
            }
        };
        Ok(Self { presses: folder.presses.iter().map(press).collect(), pixel: grid.pixel(pixel) })
    }

    /// Splits the presses into those at even and those at odd places.
    pub fn even_odd(self) -> [Vec<CalibrationPress>; 2] {
        let (mut even, mut odd) = (Vec::new(), Vec::new());
        for (n, press) in self.presses.into_iter().enumerate() {
            if n % 2 == 0 { even.push(press) } else { odd.push(press) }
        }
        [even, odd]
    }
}

/// Simulated counterpart of a calibrated sensor, into which anything can be pressed.
pub struct SimulatedSensor {
    sensor: CalibratedSensor,
    background: Arc<TactileImage>,
    photo: Vec<f32>,
    /// Size of a pixel on the pads' grid, m.
    pub pixel: (f64, f64),
}

impl SimulatedSensor {
    /// Reads a file of `optics calibrate`.
    pub fn read(file: &Path) -> Result<Self> {
        Ok(Self::from_sensor(CalibratedSensor::read(file)?))
    }

    /// Creates the counterpart of a sensor.
    pub fn from_sensor(sensor: CalibratedSensor) -> Self {
        let (width, height) = sensor.size();
        let grid = PadGrid { width, height };
        let photo = sensor.background().to_vec();
        let bytes: Vec<u8> = photo.iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect();
        let pixel = grid.pixel(1e-3 * sensor.calibration().pixel_mm);
        Self { background: grid.image(&bytes), photo, pixel, sensor }
    }

    /// Makes press `n` of a random sequence, with read-out noise of `noise` grey levels on every pixel of the camera.
    pub fn press(&self, reliefs: &[Relief], n: usize, noise: f64, seed: u64) -> Result<CalibrationPress> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(n as u64);
        let (width, height) = self.sensor.size();
        let grid = PadGrid { width, height };
        let (right, top) = self.sensor.pixel_center(width as f64 - 1.0, 0.0);
        let place = PressPlace::draw([2.0 * right, 2.0 * top], [0.0; 2], &mut rng);
        let relief = reliefs.get(rng.random_range(0..reliefs.len().max(1))).context("no shapes")?;
        let depth = rng.random_range(DEPTH_RANGE);
        let penetration: Vec<f32> = (0..width * height)
            .map(|i| {
                let (x, y) = self.sensor.pixel_center((i % width) as f64, (i / width) as f64);
                place.height(relief, x, y).map_or(f32::NEG_INFINITY, |z| (depth - z) as f32)
            })
            .collect();
        let gel = self.sensor.gel_depth(&penetration)?;
        let mut photo = self.sensor.render(&penetration)?;
        if photo.rgb.len() != self.photo.len() {
            bail!("a rendered image has {} values, expected {}", photo.rgb.len(), self.photo.len());
        }
        for value in &mut photo.rgb {
            *value = (f64::from(*value) + noise * rng.sample::<f64, _>(StandardNormal)).round().clamp(0.0, 255.0) as u8;
        }
        Ok(CalibrationPress {
            camera: 0,
            image: grid.image(&photo.rgb),
            background: self.background.clone(),
            indentation: grid.averaged(&gel, 1).into_iter().map(|h| if h > MIN_DEPTH { h } else { 0.0 }).collect(),
        })
    }
}
