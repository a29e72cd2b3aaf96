//! Smaller images, like those of a camera with pixel binning.
//!
//! The background is the mean of the full image's, computed once, and a pixel's read-out noise is that of the mean of
//! its pixels. Where the gel is deformed or shadowed, the image is formed on a grid coarser than the camera's own
//! ([`ReducedSensor::raster`], the one to press on), of at least 64 points a side. There it differs slightly
//! from the mean of the full image; the tests state by how much.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use rand::Rng;

use super::Sensor;
use crate::elastomer::DeformedGel;
use crate::error::OpticsError;
use crate::indentation::IndentationMap;
use crate::noise::quantise;
use crate::raster::Raster;
use crate::shading::SurfaceRow;
use crate::shadows::Shadow;
use crate::wide::widest;

/// Smallest number of points along an image's side, unless the camera has fewer.
const MIN_POINTS: usize = 64;

/// A sensor at a smaller image size.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use tactile_optics::hand_model::Hand;
/// use tactile_optics::indentation::press_rasters;
/// use tactile_optics::{GelFoundation, ReducedSensor, Sensor};
///
/// let hand = Hand::ftac();
/// let sensor = Sensor::nominal(&hand.pads[0], &hand.cameras[0]);
/// let small = ReducedSensor::new(&sensor, 60)?;
///
/// let gel = GelFoundation::winkler(&hand.parameters.gel);
/// let edge = |x: f64, _y: f64| Some(0.3 * x.abs());
/// let pressed = press_rasters(&hand.pads[0], &[*small.raster()], &gel, 2.0, edge)?;
/// let mut noise = ChaCha8Rng::seed_from_u64(1);
/// let image = small.render_with_brightness(&sensor, &pressed.maps[0], 1.0, &mut noise);
/// assert_eq!(image.rgb.len(), 3 * 60 * 60);
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ReducedSensor {
    side: usize,
    /// Number of points along a pixel's side.
    points: usize,
    raster: Raster,
    /// Mean grey levels of the background, row-major RGB.
    grey: Vec<f32>,
    /// Background grey level and correction of the sensor, averaged over the area of each point of the raster.
    fine: [Vec<f32>; 2],
    /// Factors of the noise of each row, and of each value of a row.
    quiet: [Vec<f32>; 2],
    background: Arc<TactileImage>,
}

impl ReducedSensor {
    /// Creates `sensor` with images of `side` x `side` pixels. Returns an error for 0, or for more than the sensor has.
    pub fn new(sensor: &Sensor, side: usize) -> Result<Self, OpticsError> {
        if side == 0 || side > IMAGE_SIZE {
            return Err(OpticsError::ReducedSize(side));
        }
        Ok(Self::with_points(sensor, side, MIN_POINTS.div_ceil(side).min(IMAGE_SIZE / side)))
    }

    fn with_points(sensor: &Sensor, side: usize, points: usize) -> Self {
        let grey = mean_pixels(&sensor.background_grey, side);
        let fine = [&sensor.background_grey, &sensor.correction].map(|values| mean_pixels(values, side * points));
        let share = |cell| 1.0 / (first_pixel(cell + 1, side) - first_pixel(cell, side)) as f32;
        let rows: Vec<f32> = (0..side).map(|row| share(row).sqrt()).collect();
        let values = (0..3 * side).map(|at| rows[at / 3]).collect();
        let background = Arc::new(TactileImage { rgb: grey.iter().map(|grey| quantise(*grey)).collect() });
        let raster = Raster::with_side(&sensor.camera, side * points);
        Self { side, points, raster, grey, fine, quiet: [rows, values], background }
    }

    /// Returns the grid on which its gel is to be pressed.
    pub fn raster(&self) -> &Raster {
        &self.raster
    }

    /// Returns the image of the untouched gel without read-out noise; cheap to clone.
    pub fn background(&self) -> &Arc<TactileImage> {
        &self.background
    }

    /// Like [`Sensor::render_with_brightness`] of the `sensor` from which this one was made, for an indentation on this one's
    /// [`Self::raster`].
    pub fn render_with_brightness(
        &self,
        sensor: &Sensor,
        indentation: &IndentationMap,
        brightness: f32,
        rng: &mut impl Rng,
    ) -> TactileImage {
        let reach = sensor.shadow_reach(f64::from(indentation.max_depth()));
        let gel = sensor.model.elastomer.deform_over(&sensor.camera, indentation, reach);
        let shadows = gel.as_ref().map_or_else(Vec::new, |gel| sensor.shadows_on(&self.raster, gel));
        widest(
            #[inline(always)]
            || {
                let deformed = gel.as_ref().map(|gel| self.deformed(sensor, gel, &shadows));
                self.expose(sensor, deformed.as_ref().unwrap_or(&self.grey), brightness, rng)
            },
        )
    }

    /// Computes the mean grey levels over a deformed gel: the background's plus the change at each deformed or shadowed
    /// point.
    #[inline(always)]
    fn deformed(&self, sensor: &Sensor, gel: &DeformedGel, shadows: &[Option<Shadow>]) -> Vec<f32> {
        let (mut means, mut row) = (self.grey.clone(), SurfaceRow::new());
        let share = 1.0 / (self.points * self.points) as f32;
        let [lit, correction] = &self.fine;
        for index in gel.rectangle.top..gel.rectangle.bottom {
            let span = sensor.shade_row(&self.raster, gel, shadows, index, &mut row);
            let Some((left, right)) = span else { continue };
            let line = &mut means[3 * self.side * (index / self.points)..][..3 * self.side];
            let first = 3 * (self.raster.side() * index + left);
            let points = lit[first..].chunks_exact(3).zip(correction[first..].chunks_exact(3));
            for (n, (lit, correction)) in points.take(right - left).enumerate() {
                let pixel = &mut line[3 * ((left + n) / self.points)..][..3];
                for channel in 0..3 {
                    let grey = sensor.response[channel].grey(row.radiance[channel][n] + correction[channel]);
                    pixel[channel] += share * (grey - lit[channel]);
                }
            }
        }
        means
    }

    #[inline(always)]
    fn expose(&self, sensor: &Sensor, means: &[f32], brightness: f32, rng: &mut impl Rng) -> TactileImage {
        let width = 3 * self.side;
        let mut rgb = vec![0; means.len()];
        let [rows, values] = &self.quiet;
        for ((bytes, means), quiet) in rgb.chunks_exact_mut(width).zip(means.chunks_exact(width)).zip(rows) {
            sensor.noise.expose_means((means, values, *quiet), brightness, bytes, rng);
        }
        TactileImage { rgb }
    }
}

/// Returns the first row or column of the full image that belongs to the larger pixel `cell` of `side`.
fn first_pixel(cell: usize, side: usize) -> usize {
    cell * IMAGE_SIZE / side
}

/// Averages full-size values, row-major RGB, over `side` x `side` larger pixels.
fn mean_pixels(values: &[f32], side: usize) -> Vec<f32> {
    let mut means = vec![0.0; 3 * side * side];
    let mut sums = vec![0.0; 3 * IMAGE_SIZE];
    for (row, line) in means.chunks_exact_mut(3 * side).enumerate() {
        let rows = first_pixel(row, side)..first_pixel(row + 1, side);
        sums.fill(0.0);
        for full in values[3 * IMAGE_SIZE * rows.start..3 * IMAGE_SIZE * rows.end].chunks_exact(3 * IMAGE_SIZE) {
            sums.iter_mut().zip(full).for_each(|(sum, value)| *sum += value);
        }
        for (column, pixel) in line.chunks_exact_mut(3).enumerate() {
            let columns = first_pixel(column, side)..first_pixel(column + 1, side);
            let share = 1.0 / (rows.len() * columns.len()) as f32;
            for sum in sums[3 * columns.start..3 * columns.end].chunks_exact(3) {
                pixel.iter_mut().zip(sum).for_each(|(mean, sum)| *mean += share * sum);
            }
        }
    }
    means
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;
    use hand_model::pads::{Pad, PadCamera};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::foundation::GelFoundation;
    use crate::indentation::press_rasters;
    use crate::model::SensorModel;

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(3)
    }

    const SIDE: usize = 64;

    /// Lowest point (m) of a body over a pad.
    type Surface = fn(f64, f64) -> Option<f64>;

    fn ball(x: f64, y: f64) -> Option<f64> {
        let inside = 1e-4 - x * x - y * y;
        (inside > 0.0).then(|| 0.01 - inside.sqrt())
    }

    /// The flat end of a tilted post, 8 x 5 mm.
    fn post(x: f64, y: f64) -> Option<f64> {
        let (u, v) = (0.9 * x - 0.436 * y, 0.436 * x + 0.9 * y);
        (u.abs() < 0.004 && v.abs() < 0.0025).then_some(0.05 * u)
    }

    /// A rod across the pad.
    fn rod(x: f64, y: f64) -> Option<f64> {
        let inside = 9e-6 - (y - 0.3 * x).powi(2) / 1.09;
        (inside > 0.0).then(|| 0.003 - inside.sqrt())
    }

    fn pressed(pad: &Pad, camera: &PadCamera, raster: &Raster, (force, surface): (f64, Surface)) -> IndentationMap {
        let gel = GelFoundation::winkler(&Hand::ftac().gel());
        let mut press = press_rasters(pad, &[*raster], &gel, force, surface).unwrap();
        assert!((press.force - force).abs() < 1e-3 * force, "{} on {}", press.force, camera.name);
        press.maps.remove(0)
    }

    /// Compares an image with the means of a full one, in grey levels: mean difference over the values that the gel
    /// changes by more than a level in the full one, largest difference overall, and the number of the former values.
    fn apart(full: &TactileImage, untouched: &TactileImage, small: &TactileImage) -> (f64, f64, usize) {
        let [full, untouched] = [full, untouched].map(|image| {
            let values: Vec<f32> = image.rgb.iter().map(|value| f32::from(*value)).collect();
            mean_pixels(&values, SIDE)
        });
        let (mut sum, mut worst, mut count) = (0.0, 0.0_f64, 0);
        for ((full, untouched), small) in full.iter().zip(&untouched).zip(&small.rgb) {
            let apart = f64::from((full - f32::from(*small)).abs());
            worst = worst.max(apart);
            if (full - untouched).abs() > 1.0 {
                (sum, count) = (sum + apart, count + 1);
            }
        }
        (sum / f64::from(count).max(1.0), worst, count as usize)
    }

    /// With one point a pixel, the mean error is half a grey level under a ball, one under a rod, and four under a post
    /// with sharp edges, of 256.
    #[test]
    fn a_smaller_image_is_nearly_the_mean_of_the_full_one() {
        let hand = Hand::ftac();
        let presses: [(f64, Surface, f64, f64); 4] =
            [(2.0, ball, 0.7, 6.0), (4.0, rod, 1.3, 10.0), (0.3, rod, 0.9, 5.0), (2.0, post, 4.6, 55.0)];
        for name in ["index_distal", "index_middle", "palm_radial"] {
            let pad = &hand.pads[hand.find_pad(name).unwrap()];
            let camera = &hand.cameras[pad.cameras[0]];
            let model = SensorModel { noise: 0.0, ..SensorModel::unit(pad, camera, 7) };
            let sensor = Sensor::with_model(pad, camera, model, 7).unwrap();
            let reduced = ReducedSensor::new(&sensor, SIDE).unwrap();
            for (force, surface, mean, worst) in presses {
                let map = |raster: &Raster| pressed(pad, camera, raster, (force, surface));
                let full = sensor.render(&map(&Raster::full(camera)), &mut rng());
                let small = reduced.render_with_brightness(&sensor, &map(reduced.raster()), 1.0, &mut rng());
                let found = apart(&full, sensor.background(), &small);
                assert!(found.0 < mean && found.1 < worst && found.2 > 300, "{name}, {force} N: {found:?}");
            }
        }
    }

    /// Noise is that of a mean, and `brightness` scales the whole image.
    #[test]
    fn an_untouched_image_is_the_mean_of_the_full_one() {
        let hand = Hand::ftac();
        let sensor = Sensor::unit(&hand.pads[0], &hand.cameras[0], 7);
        let idle = IndentationMap::idle();
        for (side, brightness) in [(SIDE, 1.0), (SIDE, 1.03), (16, 1.0), (239, 1.0)] {
            let reduced = ReducedSensor::new(&sensor, side).unwrap();
            let full = sensor.render_with_brightness(&idle, brightness, &mut rng());
            let values: Vec<f32> = full.rgb.iter().map(|value| f32::from(*value)).collect();
            let small = reduced.render_with_brightness(&sensor, &idle, brightness, &mut rng());
            assert_eq!(small.rgb.len(), 3 * side * side);
            let apart = mean_pixels(&values, side).into_iter().zip(&small.rgb);
            let apart: Vec<f64> = apart.map(|(full, small)| f64::from(full - f32::from(*small)).abs()).collect();
            // Two samples of the noise of a mean of `count` pixels, and rounding.
            let count = (IMAGE_SIZE / side).pow(2) as f64;
            let expected = 0.8 * (2.0 * sensor.model.noise.powi(2) / count + 1.0 / 12.0).sqrt();
            let mean = apart.iter().sum::<f64>() / apart.len() as f64;
            assert!(mean < 1.15 * expected, "{side}, {brightness}: {mean}, expected {expected}");
            assert_ne!(small, **reduced.background());
        }
    }

    #[test]
    fn other_sizes_are_refused() {
        let hand = Hand::ftac();
        let sensor = Sensor::nominal(&hand.pads[0], &hand.cameras[0]);
        for side in [0, IMAGE_SIZE + 1] {
            assert_eq!(ReducedSensor::new(&sensor, side).unwrap_err(), OpticsError::ReducedSize(side));
        }
    }
}
