//! The surface of the gel from an image.

use std::sync::Arc;

use anyhow::{Result, bail};
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use optics::calibration::{CalibratedSensor, Photo};
use touch::network::PreparedNetwork;
use touch::photometric_stereo::gradients;
use touch::poisson::{PoissonSolver, rest_level};
use touch::{Gradients, StereoOptions};

use super::photometry::{CONFIGURATION, Method, Photometry};
use crate::optics::grid::Grid;

/// Largest drift of a channel's brightness between background and image that is compensated, as a share.
const MOST_DRIFT: f32 = 0.15;

/// The network's slopes are taken where the look-up finds more than this share of the largest indentation.
const NETWORK_SHARE: f32 = 0.15;

/// What an image shows, on the pads' grid.
#[derive(Debug, Clone)]
pub struct GridSurface {
    pub gradients: Gradients,
    /// Indentation, m.
    pub height: Vec<f32>,
}

impl GridSurface {
    /// Largest indentation, m: that of a square of 3 x 3 pixels, so that no single pixel decides.
    pub fn peak(&self) -> f64 {
        let inner = |i: &usize| (1..N - 1).contains(&(i % N)) && (1..N - 1).contains(&(i / N));
        let mean = |i: usize| {
            let rows = [i - N, i, i + N];
            rows.iter().flat_map(|at| &self.height[at - 1..=at + 1]).map(|h| f64::from(*h)).sum::<f64>() / 9.0
        };
        (0..N * N).filter(inner).map(mean).fold(0.0, f64::max)
    }
}

/// What an image shows, pixel by pixel of the photo. Frame: x right, y up, z out of the gel; origin in the image's middle.
#[derive(Debug, Clone)]
pub struct Surface {
    pub width: usize,
    pub height: usize,
    /// Size of a pixel, m.
    pub pixel: f64,
    /// Indentation, m.
    pub depth: Vec<f32>,
    /// dh/dx and dh/dy of the indentation.
    pub slopes: Vec<[f32; 2]>,
    /// Expected error of each normal (root mean square), degrees.
    pub normal_error: Vec<f32>,
    /// Where the gel lies on what presses.
    pub contact: Vec<bool>,
    /// Largest indentation and its expected error (root mean square), m.
    pub deepest: [f64; 2],
}

impl Surface {
    /// Position of a pixel's middle on the untouched gel, m.
    pub fn place(&self, i: usize) -> [f64; 2] {
        let (column, row) = ((i % self.width) as f64, (i / self.width) as f64);
        [(column - 0.5 * (self.width as f64 - 1.0)) * self.pixel, (0.5 * (self.height as f64 - 1.0) - row) * self.pixel]
    }

    /// Unit normal out of the gel.
    pub fn normal(&self, i: usize) -> [f32; 3] {
        let [gx, gy] = self.slopes[i];
        let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
        [gx * nz, gy * nz, nz]
    }

    /// Area of the contact, m2.
    pub fn area(&self) -> f64 {
        self.contact.iter().filter(|inside| **inside).count() as f64 * self.pixel * self.pixel
    }
}

/// Turns images of one sensor into surfaces.
pub struct Reconstructor {
    grid: Grid,
    /// Size of a photo's pixel, m.
    pixel: f64,
    /// Standard deviation of that size over the size: heights are uncertain by as much.
    pixel_uncertainty: f64,
    background: Arc<TactileImage>,
    grey: bool,
    photometry: Photometry,
    network: PreparedNetwork,
    method: Method,
    options: StereoOptions,
    poisson: PoissonSolver,
}

impl Reconstructor {
    /// For images against this background, by `method`.
    pub fn new(sensor: &CalibratedSensor, photometry: &Photometry, background: &Photo, method: Method) -> Self {
        let (width, height) = sensor.size();
        let grid = Grid { width, height };
        Self {
            grid,
            pixel: 1e-3 * sensor.calibration().pixel_mm,
            pixel_uncertainty: sensor
                .calibration()
                .pixel_interval_mm
                .map_or(0.0, |[low, high]| (high - low) / (2.0 * 1.96 * sensor.calibration().pixel_mm)),
            background: grid.image(&background.rgb),
            grey: background.is_grey(),
            photometry: photometry.clone(),
            network: photometry.network.prepare(),
            method,
            options: StereoOptions { most_drift: MOST_DRIFT, ..StereoOptions::default() },
            poisson: PoissonSolver::new(),
        }
    }

    /// The surface on the pads' grid; `None` where the image shows an untouched gel.
    pub fn on_grid(&self, image: &TactileImage) -> Option<GridSurface> {
        let model = &self.photometry.look_up;
        let looked_up = gradients(image, &self.background, model, &self.options)?;
        let (mut found, mut height) = self.integrated(looked_up);
        if self.method == Method::Network
            && let Some(learned) =
                self.network.gradients(image, &self.background, (CONFIGURATION, model), &self.options)
        {
            // The network saw colours in and around contacts only: elsewhere it knows less than the look-up.
            let least = NETWORK_SHARE * height.iter().copied().fold(0.0, f32::max);
            for i in (0..N * N).filter(|&i| height[i] > least) {
                (found.gx[i], found.gy[i]) = (learned.gx[i], learned.gy[i]);
            }
            (found, height) = self.integrated(found);
        }
        let gain = self.photometry.gain(self.method);
        height.iter_mut().for_each(|value| *value *= gain);
        Some(GridSurface { gradients: found, height })
    }

    /// Heights above the untouched gel from slopes, m.
    fn integrated(&self, gradients: Gradients) -> (Gradients, Vec<f32>) {
        let mut height = self.poisson.solve(&gradients.gx, &gradients.gy, self.grid.pixel(self.pixel));
        let level = rest_level(&height, gradients.region);
        height.iter_mut().for_each(|value| *value -= level);
        (gradients, height)
    }

    /// The surface that a photo shows; `None` where it shows an untouched gel.
    pub fn surface(&self, photo: &Photo) -> Result<Option<Surface>> {
        let Grid { width, height } = self.grid;
        if (photo.width, photo.height) != (width, height) {
            bail!("found {} x {} pixels; expected {width} x {height}, by the calibration", photo.width, photo.height);
        }
        if photo.is_grey() && !self.grey {
            bail!("found a grey image; expected colours, as in the background");
        }
        let Some(found) = self.on_grid(&self.grid.image(&photo.rgb)) else { return Ok(None) };
        let accuracy = self.photometry.accuracy(self.method);
        let peak = found.peak();
        let depth = self.grid.spread(&found.height);
        let (gx, gy) = (self.grid.spread(&found.gradients.gx), self.grid.spread(&found.gradients.gy));
        let slopes: Vec<[f32; 2]> = gx.into_iter().zip(gy).map(|(gx, gy)| [gx, gy]).collect();
        let limit = self.photometry.contact_share * peak as f32;
        Ok(Some(Surface {
            width,
            height,
            pixel: self.pixel,
            normal_error: slopes.iter().map(|slope| accuracy.normal_error(*slope)).collect(),
            contact: depth.iter().map(|depth| *depth > limit).collect(),
            deepest: [peak, accuracy.depth_error(peak).hypot(self.pixel_uncertainty * peak)],
            depth,
            slopes,
        }))
    }
}
