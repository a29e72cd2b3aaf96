//! Evaluation of a fitted sensor: similarity of rendered and real held-out presses.

use serde::{Deserialize, Serialize};

use crate::calibration::fit::BallFit;
use crate::calibration::folder::{BallPress, PressFolder};
use crate::calibration::samples::{FitSamples, PressCircle};
use crate::calibration::scene::CalibrationScene;
use crate::calibration::similarity::{Similarity, compare};

/// Similarity over whole images, and over a square that reaches 1.5 visible radii to each side of the press.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct ViewSimilarity {
    /// The whole image.
    pub full: Similarity,
    /// The square around the contact.
    pub crop: Similarity,
}

/// Means over presses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldOutSimilarity {
    /// Images rendered by the fitted model.
    pub rendered: ViewSimilarity,
    /// The folder's background image in place of a rendered one.
    pub floor: ViewSimilarity,
    /// Real images compared with real ones, as an upper bound: the background estimated from the calibration presses,
    /// against untouched regions of the held-out presses of the same sizes. No renderer on this background can score
    /// higher.
    pub ceiling: ViewSimilarity,
}

/// Half the side of a crop, visible radii.
const CROP_RADII: f64 = 1.5;
/// Radius within which a press is rendered, visible radii; beyond it, the image is the background.
const RENDER_RADII: f64 = 3.0;

impl BallFit {
    /// Renders the image that the model predicts for a press: row-major RGB, grey levels rounded to whole numbers.
    pub fn render_press(&self, press: &BallPress) -> Vec<f32> {
        let mark = PressCircle { center: press.center, radius: press.radius, ball: 0.5 * press.diameter };
        let samples = FitSamples::around(mark, self.size, &self.background, RENDER_RADII);
        let scene = CalibrationScene { samples: &samples, assumptions: &self.assumptions };
        let mut image: Vec<f32> = self.background.iter().map(|grey| grey.round()).collect();
        for (sample, grey) in samples.touched.iter().zip(scene.predict(self.vector())) {
            let at = 3 * (sample.place[1] as usize * self.size[0] + sample.place[0] as usize);
            for c in 0..3 {
                image[at + c] = (255.0 * grey[c]).round().clamp(0.0, 255.0) as f32;
            }
        }
        image
    }

    /// Computes the model error of each press: root mean square difference between rendered and real image within 1.5
    /// visible radii, grey levels, after subtraction of each channel's mean difference, which is drift.
    pub fn press_errors(&self, folder: &PressFolder) -> Vec<f64> {
        let error = |press: &BallPress| {
            let image = self.render_press(press);
            let (mut sums, mut squares, mut count) = ([0.0; 3], 0.0, 0.0);
            for pixel in 0..self.size[0] * self.size[1] {
                let (column, row) = ((pixel % self.size[0]) as f64, (pixel / self.size[0]) as f64);
                if (column - press.center[0]).hypot(row - press.center[1]) < CROP_RADII * press.radius {
                    for c in 0..3 {
                        let off = f64::from(image[3 * pixel + c]) - f64::from(press.photo.rgb[3 * pixel + c]);
                        sums[c] += off;
                        squares += off * off;
                    }
                    count += 1.0;
                }
            }
            let drift: f64 = sums.iter().map(|sum| sum * sum / f64::max(count, 1.0)).sum();
            ((squares - drift).max(0.0) / (3.0 * f64::max(count, 1.0))).sqrt()
        };
        folder.presses.iter().map(error).collect()
    }

    /// Compares rendered with real images; `None` without presses.
    pub fn evaluate(&self, held_out: &PressFolder) -> Option<HeldOutSimilarity> {
        self.evaluate_with(held_out, |press| self.render_press(press))
    }

    /// Like [`Self::evaluate`], with another renderer.
    pub fn evaluate_with(
        &self,
        held_out: &PressFolder,
        render: impl Fn(&BallPress) -> Vec<f32>,
    ) -> Option<HeldOutSimilarity> {
        let single = |rgb: &[u8]| -> Vec<f32> { rgb.iter().map(|&value| f32::from(value)).collect() };
        let nothing = single(&held_out.background.rgb);
        let (mut rendered, mut floor, mut ceiling) = (Vec::new(), Vec::new(), Vec::new());
        for press in &held_out.presses {
            let real = single(&press.photo.rgb);
            rendered.push(self.compare_views(&render(press), &real, press.center, press.radius));
            floor.push(self.compare_views(&nothing, &real, press.center, press.radius));
            // Replace the press by the background, and take a crop of its size as far from it as possible.
            let mut untouched = real.clone();
            for (at, value) in untouched.iter_mut().enumerate() {
                let (column, row) = ((at / 3 % self.size[0]) as f64, (at / 3 / self.size[0]) as f64);
                if (column - press.center[0]).hypot(row - press.center[1]) < RENDER_RADII * press.radius {
                    *value = self.background[at];
                }
            }
            let away: [f64; 2] = std::array::from_fn(|axis| {
                let (size, margin) = (self.size[axis] as f64, CROP_RADII * press.radius + 1.0);
                if press.center[axis] < 0.5 * size { size - margin } else { margin }
            });
            ceiling.push(self.compare_views(&self.background, &untouched, away, press.radius));
        }
        let mean = |all: &[ViewSimilarity]| {
            let part =
                |part: fn(&ViewSimilarity) -> Similarity| Similarity::mean(&all.iter().map(part).collect::<Vec<_>>());
            Some(ViewSimilarity { full: part(|views| views.full)?, crop: part(|views| views.crop)? })
        };
        Some(HeldOutSimilarity { rendered: mean(&rendered)?, floor: mean(&floor)?, ceiling: mean(&ceiling)? })
    }

    fn compare_views(&self, a: &[f32], b: &[f32], center: [f64; 2], radius: f64) -> ViewSimilarity {
        let [w, h] = self.size;
        let range = |middle: f64, size: usize| {
            let end = |value: f64| value.round().clamp(0.0, size as f64) as usize;
            end(middle - CROP_RADII * radius)
                ..end(middle + CROP_RADII * radius) + usize::from(middle + CROP_RADII * radius < size as f64)
        };
        ViewSimilarity {
            full: compare(a, b, w, 0..w, 0..h),
            crop: compare(a, b, w, range(center[0], w), range(center[1], h)),
        }
    }
}
