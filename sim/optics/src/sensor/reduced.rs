//! Smaller images, as of a camera that adds neighbouring pixels up before it reads them out.
//!
//! Only the part of an image in which the gel is deformed or shadowed is formed pixel by pixel; the rest is the background, whose means over the
//! larger pixels are made once. A larger pixel's read-out noise is that of the mean of its pixels.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use rand::Rng;

use super::Sensor;
use crate::elastomer::DeformedGel;
use crate::error::OpticsError;
use crate::indentation::IndentationMap;
use crate::noise::quantise;
use crate::shading::SurfaceRow;
use crate::shadows::Shadow;
use crate::wide::widest;

/// A sensor at a smaller image size.
#[derive(Debug, Clone)]
pub struct ReducedSensor {
    side: usize,
    /// The larger pixel's row or column of each row or column.
    cells: [usize; IMAGE_SIZE],
    /// One over the number of rows or columns in each of the larger ones.
    shares: Vec<f32>,
    /// Mean grey levels of the background, row-major RGB.
    grey: Vec<f32>,
    /// Factor of the noise of each of these.
    quiet: Vec<f32>,
    background: Arc<TactileImage>,
}

impl ReducedSensor {
    /// `sensor` with images of `side` x `side` pixels: an error for none, or for more than it has.
    pub fn new(sensor: &Sensor, side: usize) -> Result<Self, OpticsError> {
        if side == 0 || side > IMAGE_SIZE {
            return Err(OpticsError::ReducedSize(side));
        }
        let start = |cell: usize| cell * IMAGE_SIZE / side;
        let mut cells = [0; IMAGE_SIZE];
        for cell in 0..side {
            cells[start(cell)..start(cell + 1)].fill(cell);
        }
        let shares: Vec<f32> = (0..side).map(|cell| 1.0 / (start(cell + 1) - start(cell)) as f32).collect();
        let mut grey = vec![0.0; 3 * side * side];
        for (at, value) in sensor.background_grey.iter().enumerate() {
            let (row, column, channel) = (cells[at / (3 * IMAGE_SIZE)], cells[at / 3 % IMAGE_SIZE], at % 3);
            grey[3 * (row * side + column) + channel] += value * shares[row] * shares[column];
        }
        let quiet = (0..grey.len()).map(|at| (shares[at / (3 * side)] * shares[at / 3 % side]).sqrt()).collect();
        let background = Arc::new(TactileImage { rgb: grey.iter().map(|grey| quantise(*grey)).collect() });
        Ok(Self { side, cells, shares, grey, quiet, background })
    }

    /// Image of the untouched gel without read-out noise; cheap to clone.
    pub fn background(&self) -> &Arc<TactileImage> {
        &self.background
    }

    /// As [`Sensor::render_at`] of the `sensor` that this one was made of.
    pub fn render_at(
        &self,
        sensor: &Sensor,
        indentation: &IndentationMap,
        brightness: f32,
        rng: &mut impl Rng,
    ) -> TactileImage {
        let reach = sensor.shadow_reach(f64::from(indentation.deepest()));
        let gel = sensor.model.elastomer.deform_over(&sensor.camera, indentation, reach);
        let shadows = gel.as_ref().map_or_else(Vec::new, |gel| sensor.shadows(gel));
        widest(
            #[inline(always)]
            || {
                let deformed = gel.as_ref().map(|gel| self.deformed(sensor, gel, &shadows));
                self.expose(sensor, deformed.as_ref().unwrap_or(&self.grey), brightness, rng)
            },
        )
    }

    /// Mean grey levels over a deformed gel: the background's, and what each deformed or shadowed pixel differs by.
    #[inline(always)]
    fn deformed(&self, sensor: &Sensor, gel: &DeformedGel, shadows: &[Option<Shadow>]) -> Vec<f32> {
        let (mut means, mut row) = (self.grey.clone(), SurfaceRow::new());
        for index in gel.rectangle.top..gel.rectangle.bottom {
            let Some((left, right)) = sensor.shade_row(gel, shadows, index, &mut row) else { continue };
            let cell = self.cells[index];
            let line = &mut means[3 * self.side * cell..3 * self.side * (cell + 1)];
            let first = 3 * (IMAGE_SIZE * index + left);
            let pixels =
                sensor.background_grey[first..].chunks_exact(3).zip(sensor.correction[first..].chunks_exact(3));
            for (n, (background, correction)) in pixels.take(right - left).enumerate() {
                let column = self.cells[left + n];
                let share = self.shares[cell] * self.shares[column];
                for channel in 0..3 {
                    let grey = sensor.response[channel].grey(row.radiance[channel][n] + correction[channel]);
                    line[3 * column + channel] += share * (grey - background[channel]);
                }
            }
        }
        means
    }

    #[inline(always)]
    fn expose(&self, sensor: &Sensor, means: &[f32], brightness: f32, rng: &mut impl Rng) -> TactileImage {
        let width = 3 * self.side;
        let mut rgb = vec![0; means.len()];
        let lines = means.chunks_exact(width).zip(self.quiet.chunks_exact(width));
        for (bytes, (means, quiet)) in rgb.chunks_exact_mut(width).zip(lines) {
            sensor.noise.expose_means((means, quiet), brightness, bytes, rng);
        }
        TactileImage { rgb }
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Hand;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::*;
    use crate::indentation::press;

    const SIDE: usize = 64;

    /// Means of an image's blocks.
    fn means(image: &TactileImage) -> Vec<f64> {
        let start = |cell: usize| cell * IMAGE_SIZE / SIDE;
        let mut found = Vec::new();
        for (row, column, channel) in (0..SIDE)
            .flat_map(|row| (0..SIDE).flat_map(move |column| (0..3).map(move |channel| (row, column, channel))))
        {
            let (rows, columns) = (start(row)..start(row + 1), start(column)..start(column + 1));
            let count = rows.len() * columns.len();
            let pixels =
                rows.flat_map(|row| columns.clone().map(move |column| 3 * (row * IMAGE_SIZE + column) + channel));
            found.push(pixels.map(|at| f64::from(image.rgb[at])).sum::<f64>() / count as f64);
        }
        found
    }

    /// A smaller image is the mean of the full one, and its noise that of a mean.
    #[test]
    fn a_smaller_image_is_the_mean_of_the_full_one() {
        let hand = Hand::ftac();
        let pad = &hand.pads[hand.pad("index_distal").unwrap()];
        let camera = &hand.cameras[pad.cameras[0]];
        let sensor = Sensor::unit(pad, camera, 7);
        let reduced = ReducedSensor::new(&sensor, SIDE).unwrap();
        let ball = |x: f64, y: f64| {
            let inside = 1e-4 - x * x - y * y;
            (inside > 0.0).then(|| 0.01 - inside.sqrt())
        };
        let pressed = press(pad, &[camera], &hand.gel(), 2.0, ball).unwrap();
        for (indentation, brightness) in
            [(&pressed.maps[0], 1.0), (&pressed.maps[0], 1.03), (&IndentationMap::idle(), 1.0)]
        {
            let rng = || ChaCha8Rng::seed_from_u64(3);
            let full = means(&sensor.render_at(indentation, brightness, &mut rng()));
            let small = reduced.render_at(&sensor, indentation, brightness, &mut rng());
            assert_eq!(small.rgb.len(), full.len());
            let apart = full.iter().zip(&small.rgb).map(|(full, small)| (full - f64::from(*small)).abs());
            let (worst, sum) = apart.fold((0.0_f64, 0.0), |(worst, sum), apart| (worst.max(apart), sum + apart));
            assert!(worst < 4.0 && sum / (full.len() as f64) < 0.6, "{worst} {}", sum / full.len() as f64);
        }
        assert_ne!(
            reduced.render_at(&sensor, &pressed.maps[0], 1.0, &mut ChaCha8Rng::seed_from_u64(3)),
            **reduced.background()
        );
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
