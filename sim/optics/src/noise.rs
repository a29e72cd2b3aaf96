//! Random numbers of the sensor: read-out noise, the gel's texture, and the variation between units.

use hand_model::pads::IMAGE_SIZE;
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::indentation::PIXEL_COUNT;
use crate::wide::integer_part;

/// Read-out noise: independent normal samples of one standard deviation, added to every value of an image.
///
/// Generating 172,800 samples for each image would cost more than rendering it. Therefore a table is generated once,
/// and each row of an image starts at a random index in it. Rows of one image seldom overlap (about 2 % of pairs share
/// samples), and images practically never repeat.
#[derive(Debug, Clone)]
pub(crate) struct ReadOutNoise {
    table: Vec<f32>,
}

impl ReadOutNoise {
    const START_COUNT: usize = 1 << 16;
    /// Number of samples in the table.
    pub(crate) const TABLE_SIZE: usize = Self::START_COUNT + 3 * IMAGE_SIZE;

    pub(crate) fn new(deviation: f64, seed: u64) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Self {
            table: StandardNormal
                .sample_iter(rng)
                .take(Self::TABLE_SIZE)
                .map(|draw: f64| (deviation * draw) as f32)
                .collect(),
        }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn table(&self) -> &[f32] {
        &self.table
    }

    /// Picks the index in the table at which an image's next row starts.
    pub(crate) fn random_start(rng: &mut impl Rng) -> usize {
        rng.next_u32() as usize % Self::START_COUNT
    }

    /// Writes a row of grey levels as bytes, scaled by `brightness` and with noise.
    #[inline(always)]
    pub(crate) fn expose(&self, grey: &[f32], brightness: f32, bytes: &mut [u8], rng: &mut impl Rng) {
        let start = Self::random_start(rng);
        let draws = &self.table[start..start + grey.len()];
        for ((byte, grey), draw) in bytes.iter_mut().zip(grey).zip(draws) {
            *byte = quantise(grey * brightness + draw);
        }
    }

    /// Writes a row of mean grey levels as bytes; the noise has a factor for the row and one for each value.
    #[inline(always)]
    pub(crate) fn expose_means(
        &self,
        (means, quiet, row): (&[f32], &[f32], f32),
        brightness: f32,
        bytes: &mut [u8],
        rng: &mut impl Rng,
    ) {
        let start = Self::random_start(rng);
        let draws = &self.table[start..start + means.len()];
        for (byte, ((mean, quiet), draw)) in bytes.iter_mut().zip(means.iter().zip(quiet).zip(draws)) {
            *byte = quantise(mean * brightness + row * quiet * draw);
        }
    }
}

/// Rounds to the nearest of the 256 grey levels.
#[inline(always)]
pub(crate) fn quantise(grey: f32) -> u8 {
    integer_part((grey + 0.5).clamp(0.0, 255.0)) as u8
}

/// Generates the texture of a unit's background (grey levels, row-major RGB): blotches of a few millimetres and a fine
/// grain, both mostly common to all channels.
pub(crate) fn texture(blotches: f64, grain: f64, rng: &mut impl Rng) -> Vec<f32> {
    const KNOTS_PER_SIDE: usize = 9;
    let mut field = || -> Vec<f64> {
        (0..KNOTS_PER_SIDE * KNOTS_PER_SIDE).map(|_| blotches * rng.sample::<f64, _>(StandardNormal)).collect()
    };
    let (common, own) = (field(), [field(), field(), field()]);
    let mut texture = Vec::with_capacity(3 * PIXEL_COUNT);
    for row in 0..IMAGE_SIZE {
        for column in 0..IMAGE_SIZE {
            let place = |pixel: usize| {
                let at = (pixel as f64 + 0.5) / IMAGE_SIZE as f64 * (KNOTS_PER_SIDE - 1) as f64;
                let cell = (at as usize).min(KNOTS_PER_SIDE - 2);
                let part = at - cell as f64;
                (cell, part * part * (3.0 - 2.0 * part))
            };
            let ((i, u), (j, v)) = (place(column), place(row));
            let value = |f: &[f64]| {
                let knot = |j: usize, i: usize| f[j * KNOTS_PER_SIDE + i];
                (1.0 - v) * ((1.0 - u) * knot(j, i) + u * knot(j, i + 1))
                    + v * ((1.0 - u) * knot(j + 1, i) + u * knot(j + 1, i + 1))
            };
            let shared = value(&common) + grain * rng.sample::<f64, _>(StandardNormal);
            for own in &own {
                texture.push((shared + 0.3 * value(own)) as f32);
            }
        }
    }
    texture
}
