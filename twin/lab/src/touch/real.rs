//! Presses of a ball into a real sensor, and into its simulated likeness, on the grid of the pads' images.
//!
//! Photos of any size are averaged onto 240 x 240 pixels, so that photometric stereo runs on them as it does on a pad.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use optics::calibration::{CalibratedSensor, PressFolder, SensorCalibration};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use touch::CalibrationPress;

use super::shapes::{Place, Relief};

/// Stands for "the only sensor there is" where a pad's configuration is asked for.
pub const CONFIGURATION: char = 'a';
/// How deep things are pressed into a simulated sensor, m.
const DEPTHS: std::ops::Range<f64> = 0.15e-3..1.1e-3;

/// A gel that gives less than this is level, m.
const LEAST_DEPTH: f32 = 2e-6;

/// Presses with the size of a pixel (dx, dy; m).
pub struct RealPresses {
    /// The presses, by file name.
    pub presses: Vec<CalibrationPress>,
    /// Size of a pixel on the pads' grid, m.
    pub pixel: (f64, f64),
}

impl RealPresses {
    /// Reads a folder as `optics calibrate` does. `diameter` is the ball's, `pixel` the size of the photos' pixels, m.
    pub fn read(folder: &Path, diameter: f64, pixel: f64) -> Result<Self> {
        let folder = PressFolder::read(folder, diameter, false)?;
        let (width, height) = (folder.background.width, folder.background.height);
        let grid = Grid { width, height };
        let background = grid.image(&folder.background.rgb);
        let press = |press: &optics::calibration::BallPress| {
            let (radius, contact) = (0.5 * press.diameter, press.radius * pixel);
            let rim = (radius * radius - contact * contact).max(0.0).sqrt();
            let depth = |i: usize| {
                let (x, y) = grid.center(i);
                let off = ((x - press.center[0]).powi(2) + (y - press.center[1]).powi(2)) * pixel * pixel;
                if off < contact * contact { ((radius * radius - off).sqrt() - rim) as f32 } else { 0.0 }
            };
            CalibrationPress {
                camera: 0,
                image: grid.image(&press.photo.rgb),
                background: background.clone(),
                indentation: (0..N * N).map(depth).collect(),
            }
        };
        Ok(Self { presses: folder.presses.iter().map(press).collect(), pixel: grid.pixel(pixel) })
    }

    /// The presses at even and those at odd places.
    pub fn even_odd(self) -> [Vec<CalibrationPress>; 2] {
        let (mut even, mut odd) = (Vec::new(), Vec::new());
        for (n, press) in self.presses.into_iter().enumerate() {
            if n % 2 == 0 { even.push(press) } else { odd.push(press) }
        }
        [even, odd]
    }
}

/// A calibrated sensor into which anything is pressed.
pub struct Likeness {
    sensor: CalibratedSensor,
    background: Arc<TactileImage>,
    photo: Vec<f32>,
    /// Size of a pixel on the pads' grid, m.
    pub pixel: (f64, f64),
}

impl Likeness {
    /// From the file that `optics calibrate` wrote.
    pub fn read(file: &Path) -> Result<Self> {
        let (calibration, photo) = SensorCalibration::read(file)?;
        let grid = Grid { width: calibration.columns, height: calibration.rows };
        let pixel = grid.pixel(1e-3 * calibration.pixel_mm);
        let bytes: Vec<u8> = photo.iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect();
        let sensor = CalibratedSensor::new(calibration, photo.clone())?;
        Ok(Self { sensor, background: grid.image(&bytes), photo, pixel })
    }

    /// Press `n` of many, with read-out noise of `noise` grey levels on every pixel of the camera.
    pub fn press(&self, reliefs: &[Relief], n: usize, noise: f64, seed: u64) -> Result<CalibrationPress> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(n as u64);
        let (width, height) = self.sensor.size();
        let grid = Grid { width, height };
        let (right, top) = self.sensor.pixel_center(width as f64 - 1.0, 0.0);
        let place = Place::draw([2.0 * right, 2.0 * top], [0.0; 2], &mut rng);
        let relief = reliefs.get(rng.random_range(0..reliefs.len().max(1))).context("no shapes")?;
        let depth = rng.random_range(DEPTHS);
        let penetration: Vec<f32> = (0..width * height)
            .map(|i| {
                let (x, y) = self.sensor.pixel_center((i % width) as f64, (i / width) as f64);
                place.height(relief, x, y).map_or(f32::NEG_INFINITY, |z| (depth - z) as f32)
            })
            .collect();
        let gel = self.sensor.gel(&penetration)?;
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
            indentation: grid.averaged(&gel, 1).into_iter().map(|h| if h > LEAST_DEPTH { h } else { 0.0 }).collect(),
        })
    }
}

#[derive(Clone, Copy)]
struct Grid {
    width: usize,
    height: usize,
}

impl Grid {
    /// Size of a pixel of the pads' grid, given the photo's.
    fn pixel(self, pixel: f64) -> (f64, f64) {
        (pixel * self.width as f64 / N as f64, pixel * self.height as f64 / N as f64)
    }

    /// Column and row of the photo in the middle of pixel `i` of the pads' grid.
    fn center(self, i: usize) -> (f64, f64) {
        let at = |k: usize, size: usize| (k as f64 + 0.5) * size as f64 / N as f64 - 0.5;
        (at(i % N, self.width), at(i / N, self.height))
    }

    fn image(self, rgb: &[u8]) -> Arc<TactileImage> {
        let values: Vec<f32> = rgb.iter().map(|&value| f32::from(value)).collect();
        let rgb = self.averaged(&values, 3).into_iter().map(|value| value.round() as u8).collect();
        Arc::new(TactileImage { rgb })
    }

    /// Means over the pixels of the pads' grid, by the area that each pixel of the photo covers of them.
    fn averaged(self, values: &[f32], channels: usize) -> Vec<f32> {
        let (columns, rows) = (shares(self.width), shares(self.height));
        let mut sums = vec![0.0f32; self.height * N * channels];
        for row in 0..self.height {
            for (column, shares) in columns.iter().enumerate() {
                for &(at, share) in shares {
                    for channel in 0..channels {
                        sums[(row * N + column) * channels + channel] +=
                            share * values[(row * self.width + at) * channels + channel];
                    }
                }
            }
        }
        let mut means = vec![0.0f32; N * N * channels];
        for (row, shares) in rows.iter().enumerate() {
            for &(at, share) in shares {
                let from = &sums[at * N * channels..(at + 1) * N * channels];
                for (mean, value) in means[row * N * channels..].iter_mut().zip(from) {
                    *mean += share * value;
                }
            }
        }
        means
    }
}

/// For each of the grid's columns, which of `size` columns it covers, and how much of it each is.
fn shares(size: usize) -> Vec<Vec<(usize, f32)>> {
    let step = size as f64 / N as f64;
    (0..N)
        .map(|n| {
            let (begin, end) = (n as f64 * step, (n + 1) as f64 * step);
            let part = |k: usize| (end.min(k as f64 + 1.0) - begin.max(k as f64)) / step;
            let last = (end.ceil() as usize).min(size);
            (begin as usize..last).map(|k| (k, part(k) as f32)).filter(|(_, part)| *part > 0.0).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaging_keeps_means_and_places() {
        let grid = Grid { width: 640, height: 480 };
        let ramp: Vec<f32> = (0..640 * 480).map(|i| (i % 640) as f32 + 10.0 * (i / 640) as f32).collect();
        let small = grid.averaged(&ramp, 1);
        for i in [0, 239, 1234, N * N - 1] {
            let (column, row) = grid.center(i);
            // A photo's pixel that is covered in part counts with its own place.
            assert!((f64::from(small[i]) - column - 10.0 * row).abs() < 0.1, "{i}: {} {column} {row}", small[i]);
        }
        let (dx, dy) = grid.pixel(0.0295e-3);
        assert!((dx / dy - 4.0 / 3.0).abs() < 1e-12);
    }
}
