//! Circles of presses without labels, corrected by the model that was fitted to the reliable ones.
//!
//! A circle found where an image changes most is biased by cast shadows and by drift. The fitted model accounts for
//! both: the true circle is the one whose rendering comes closest to the image, with each channel's mean difference
//! (drift) removed. Positions all over the image are tried with the typical radius, then the best one is refined step
//! by step.

use crate::calibration::fit::BallFit;
use crate::calibration::folder::{BallPress, PressFolder};
use crate::calibration::samples::{FitSamples, PixelSample, PressCircle};
use crate::calibration::scene::CalibrationScene;

/// Approximate number of pixels of an image that are compared.
const COMPARED_PIXELS: usize = 1800;
/// Spacing of the positions that are tried, in typical radii.
const RASTER_SPACING: f64 = 0.5;
/// Smallest step of the refinement, pixels.
const MIN_STEP: f64 = 0.25;
/// Factor within which a radius must agree with the typical one to count as reliable.
const RADIUS_AGREEMENT: f64 = 1.2;
/// Permitted range of a refined radius relative to the typical one.
const RADIUS_RATIO_RANGE: std::ops::RangeInclusive<f64> = 0.6..=1.6;

/// Computes the median radius of the presses, pixels.
fn typical_radius(folder: &PressFolder) -> f64 {
    let mut radii: Vec<f64> = folder.presses.iter().map(|press| press.radius).collect();
    radii.sort_by(f64::total_cmp);
    radii.get(radii.len() / 2).copied().unwrap_or(1.0)
}

/// Returns the presses that have a label or a typical radius.
pub fn reliable_presses(folder: &PressFolder) -> PressFolder {
    let typical = typical_radius(folder);
    let alike = |press: &BallPress| (typical / RADIUS_AGREEMENT..=typical * RADIUS_AGREEMENT).contains(&press.radius);
    folder.split(|_, press| press.labelled || alike(press)).0
}

impl BallFit {
    /// Returns the same presses, with the circles of those without a label corrected.
    pub fn relocated(&self, folder: &PressFolder) -> PressFolder {
        let typical = typical_radius(folder);
        let mut folder = folder.clone();
        for press in folder.presses.iter_mut().filter(|press| !press.labelled) {
            (press.center, press.radius) = self.fit_circle(press, typical);
        }
        folder
    }

    /// Finds the centre and radius of the circle whose rendering is closest to the image.
    fn fit_circle(&self, press: &BallPress, typical: f64) -> ([f64; 2], f64) {
        let [width, height] = self.size.map(|size| size as f64);
        let mut candidates = vec![(press.center, press.radius), (press.center, typical)];
        let step = (RASTER_SPACING * typical).max(1.0);
        let count = |size: f64| (size / step).ceil() as usize;
        for row in 0..count(height) {
            for column in 0..count(width) {
                candidates.push(([(column as f64 + 0.5) * step, (row as f64 + 0.5) * step], typical));
            }
        }
        let errors = self.errors(press, &candidates);
        let best = (0..candidates.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
        let (mut circle, mut error) = (candidates[best], errors[best]);
        let mut step = 0.5 * step;
        while step > MIN_STEP {
            let ([x, y], radius) = circle;
            let mut around = vec![
                ([x + step, y], radius),
                ([x - step, y], radius),
                ([x, y + step], radius),
                ([x, y - step], radius),
            ];
            around.extend([([x, y], radius + 0.5 * step), ([x, y], radius - 0.5 * step)]);
            around.retain(|([x, y], radius)| {
                (0.0..width).contains(x)
                    && (0.0..height).contains(y)
                    && RADIUS_RATIO_RANGE.contains(&(radius / typical))
            });
            let errors = self.errors(press, &around);
            match (0..around.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])) {
                Some(best) if errors[best] < error => (circle, error) = (around[best], errors[best]),
                _ => step *= 0.5,
            }
        }
        circle
    }

    /// Computes the sum of squared differences between the image and its rendering with each circle, on a raster of
    /// pixels.
    fn errors(&self, press: &BallPress, circles: &[([f64; 2], f64)]) -> Vec<f64> {
        let [width, height] = self.size;
        let stride = ((width * height) as f64 / COMPARED_PIXELS as f64).sqrt().ceil().max(1.0) as usize;
        let place = |column: usize, row: usize| [column as f64, row as f64];
        let places: Vec<[f64; 2]> = (stride / 2..height)
            .step_by(stride)
            .flat_map(|row| (stride / 2..width).step_by(stride).map(move |column| place(column, row)))
            .collect();
        let sample = |n: usize, place: [f64; 2]| {
            let (column, row) = (place[0] as usize, place[1] as usize);
            let background =
                std::array::from_fn(|c| f64::from(self.background[3 * (row * width + column) + c]) / 255.0);
            let seen = press.photo.pixel(column, row).map(|grey| f64::from(grey) / 255.0);
            PixelSample { press: n, place, value: seen, background }
        };
        let marks = circles.iter().map(|&(center, radius)| PressCircle { center, radius, ball: 0.5 * press.diameter });
        let touched = (0..circles.len()).flat_map(|n| places.iter().map(move |&place| (n, place)));
        let samples = FitSamples {
            size: self.size,
            marks: marks.collect(),
            touched: touched.map(|(n, place)| sample(n, place)).collect(),
            flat: Vec::new(),
            single_lamp_values: Vec::new(),
        };
        let scene = CalibrationScene { samples: &samples, assumptions: &self.assumptions };
        let found = scene.predict(self.vector());
        let of_one = |(found, seen): (&[[f64; 3]], &[PixelSample])| {
            (0..3)
                .map(|c| {
                    let off = || found.iter().zip(seen).map(|(found, sample)| found[c] - sample.value[c]);
                    let mean = off().sum::<f64>() / found.len().max(1) as f64;
                    off().map(|off| (off - mean).powi(2)).sum::<f64>()
                })
                .sum()
        };
        found.chunks(places.len()).zip(samples.touched.chunks(places.len())).map(of_one).collect()
    }
}
