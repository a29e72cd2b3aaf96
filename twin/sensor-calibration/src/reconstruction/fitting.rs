//! Fitting of the photometry, the mapping from colours to slopes, to presses of a ball, and its evaluation on others.

use std::sync::Arc;

use anyhow::Result;
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tactile_optics::calibration::{CalibratedSensor, PressFolder};
use tactile_perception::colour_change::whole_change;
use tactile_perception::{CalibrationPress, PIXELS, PhotometricModel};

use super::errors::{ReconstructionErrors, contact_share};
use super::known_ball::{KnownBall, KnownPresses};
use super::learning::{EPOCHS, LabelledPixel, train};
use super::photometry::{CONFIGURATION, Photometry, SlopeMethod, VERSION};
use super::range::{CalibrationRange, drift_free};
use super::surface::Reconstructor;
use super::synthetic;
use crate::grid::PadGrid;

/// Number of synthetic presses, and approximate number of training pixels of each.
const SYNTHETIC_PRESSES: usize = 48;
const SYNTHETIC_PIXELS: usize = 700;
/// Approximate number of training pixels of all real presses.
const REAL_PIXELS: usize = 60_000;
/// Equivalent sample size of the prior: with this many presses, a pixel of a synthetic press has the weight of a real
/// one. The weight falls with the square of the number of presses: the more there are, the less the model's errors may
/// count. Tuned on the even presses of Taxim's sensor (recordings/log/own-sensor.md).
const PRIOR_SAMPLE_SIZE: f32 = 2.3;
/// Weight of a pixel of untouched gel, relative to one in contact.
const LEVEL_WEIGHT: f32 = 0.3;
/// Number of untouched training pixels, relative to those in contact.
const LEVEL_SHARE: f64 = 0.15;
/// Distance from a ball's centre beyond which the gel is level, contact radii. Nearer, the depth to which it sinks is
/// unknown.
const LEVEL_DISTANCE: f64 = 2.0;

impl Photometry {
    /// Learns from presses into `sensor`, with synthetic presses of its model as the prior. `step` is called after each
    /// of [`Self::EPOCH_COUNT`] epochs. The accuracy of the result is not set yet.
    pub fn learn(
        presses: &PressFolder,
        sensor: &CalibratedSensor,
        seed: u64,
        step: &(dyn Fn() + Sync),
    ) -> Result<Self> {
        let (width, height) = sensor.size();
        let grid = PadGrid { width, height };
        let photo_pixel = 1e-3 * sensor.calibration().pixel_mm;
        let pixel = grid.pixel(photo_pixel);
        let background: Arc<TactileImage> = grid.image(&presses.background.rgb);
        let known = KnownPresses::new(presses, sensor, &background);
        let radius = known.balls.iter().map(|ball| ball.radius).sum::<f64>() / known.balls.len().max(1) as f64;
        let synthetic = synthetic::presses(sensor, radius, SYNTHETIC_PRESSES, seed ^ 0x696d_6167)?;
        let with_pixel = |presses| -> Vec<(&CalibrationPress, (f64, f64))> {
            let presses: &[CalibrationPress] = presses;
            presses.iter().map(|press| (press, pixel)).collect()
        };
        let prior = PhotometricModel::fit(CONFIGURATION, &with_pixel(&synthetic))?;
        let look_up = PhotometricModel::corrected(Some(&prior), CONFIGURATION, &with_pixel(&known.presses))?;
        let mut pixels = real_pixels(&known, (grid, photo_pixel), seed);
        let weight = (PRIOR_SAMPLE_SIZE / known.presses.len().max(1) as f32).powi(2).min(1.0);
        pixels.extend(synthetic_pixels(&synthetic, pixel, weight, seed));
        let recipe = format!("ftac optics calibrate, {} presses, --seed {seed}", presses.presses.len());
        let mut photometry = Self {
            version: VERSION,
            columns: width,
            rows: height,
            pixel_mm: sensor.calibration().pixel_mm,
            presses: presses.presses.len(),
            look_up,
            network: train(&pixels, seed, recipe, step)?,
            range: CalibrationRange::from_presses(&known, grid, photo_pixel),
            contact_share: 0.35,
            gains: [1.0; 2],
            accuracy: [(); 2].map(|()| ReconstructionErrors::default().accuracy()),
        };
        let reader = |photometry: &Self, method| Reconstructor::new(sensor, photometry, &presses.background, method);
        photometry.gains = SlopeMethod::ALL.map(|method| {
            let mut errors = ReconstructionErrors::default();
            errors.add(&reader(&photometry, method), &known, (grid, photo_pixel), 0.35);
            let ratio = errors.accuracy().depth_ratio;
            if ratio.is_finite() && ratio > 0.0 { (1.0 / ratio) as f32 } else { 1.0 }
        });
        photometry.contact_share = contact_share(&reader(&photometry, SlopeMethod::Network), &known, grid, photo_pixel);
        Ok(photometry)
    }

    /// Number of training epochs.
    pub const EPOCH_COUNT: u64 = EPOCHS as u64;

    /// Computes the errors of each method on held-out presses into `sensor`.
    pub fn errors(&self, presses: &PressFolder, sensor: &CalibratedSensor) -> [ReconstructionErrors; 2] {
        let grid = PadGrid { width: self.columns, height: self.rows };
        let known = KnownPresses::new(presses, sensor, &grid.image(&presses.background.rgb));
        SlopeMethod::ALL.map(|method| {
            let reader = Reconstructor::new(sensor, self, &presses.background, method);
            let mut errors = ReconstructionErrors::default();
            errors.add(&reader, &known, (grid, 1e-3 * self.pixel_mm), self.contact_share);
            errors
        })
    }
}

/// Samples pixels of presses of a ball: in contact, where the gel lies on the ball, and far from it.
fn real_pixels(known: &KnownPresses, (grid, pixel): (PadGrid, f64), seed: u64) -> Vec<LabelledPixel> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7265_616c);
    let inside = |ball: &KnownBall, i: usize| ball.at(ball.offset(grid, pixel, i));
    let contact = known.balls.iter().map(|ball| (0..PIXELS).filter(|&i| inside(ball, i).is_some()).count());
    let total: usize = contact.sum();
    let share = (REAL_PIXELS as f64 / total.max(1) as f64).min(1.0);
    let level_share = share * LEVEL_SHARE * total as f64 / (PIXELS * known.balls.len().max(1)) as f64;
    let mut pixels = Vec::new();
    for (press, ball) in known.presses.iter().zip(&known.balls) {
        let change = drift_free(press, ball, grid, pixel);
        for (i, change) in change.into_iter().enumerate() {
            let [x, y] = ball.offset(grid, pixel, i);
            match ball.at([x, y]) {
                Some((_, slopes)) if rng.random_bool(share) => pixels.push(LabelledPixel::new(i, change, slopes, 1.0)),
                None if x.hypot(y) > LEVEL_DISTANCE * ball.contact && rng.random_bool(level_share) => {
                    pixels.push(LabelledPixel::new(i, change, [0.0; 2], LEVEL_WEIGHT));
                }
                _ => {}
            }
        }
    }
    pixels
}

/// Samples pixels of synthetic presses, for which the gel is known everywhere; `pixel` is the grid's pixel size, m.
fn synthetic_pixels(presses: &[CalibrationPress], (dx, dy): (f64, f64), weight: f32, seed: u64) -> Vec<LabelledPixel> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x696d_6167);
    let mut pixels = Vec::new();
    for press in presses {
        let (change, gel) = (whole_change(&press.image, &press.background), &press.indentation);
        let inner = |i: &usize| (1..N - 1).contains(&(i % N)) && (1..N - 1).contains(&(i / N));
        let touched = gel.iter().filter(|depth| **depth > 0.0).count();
        let share = (SYNTHETIC_PIXELS as f64 / touched.max(1) as f64).min(1.0);
        let level_share = (LEVEL_SHARE * SYNTHETIC_PIXELS as f64 / (PIXELS - touched).max(1) as f64).min(1.0);
        for i in (0..PIXELS).filter(inner) {
            if rng.random_bool(if gel[i] > 0.0 { share } else { level_share }) {
                let slopes =
                    [f64::from(gel[i + 1] - gel[i - 1]) / (2.0 * dx), f64::from(gel[i - N] - gel[i + N]) / (2.0 * dy)];
                let share = if gel[i] > 0.0 { 1.0 } else { LEVEL_WEIGHT };
                pixels.push(LabelledPixel::new(i, change[i], slopes, weight * share));
            }
        }
    }
    pixels
}
