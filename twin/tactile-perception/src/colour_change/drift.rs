//! Change detection against an older background: lamps and exposure may have drifted since, and both images have
//! read-out noise.
//!
//! Drift changes the brightness of a channel by the same factor everywhere; a touch changes it only in some places and
//! by various factors. The factor shared by the most blocks of the image, within [`GAIN_BAND_WIDTH`], is therefore attributed to
//! drift. The threshold for the change of a block follows from the noise. The noise is measured in the pair of images
//! itself, because neighbouring pixels of their difference differ by little else.

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;

use super::{BLOCK_SIDE, BLOCKS_PER_SIDE, ImageChange, StereoOptions, region_around};

/// Width of the band of factors that count as equal. Noise of 0.7 grey levels in both images gives the factor of a
/// block of 36 pixels of 60 to 120 grey levels a standard deviation of 0.0014 to 0.003.
const GAIN_BAND_WIDTH: f32 = 0.008;
/// Least share of all blocks that must agree on a factor; below it, no drift is assumed.
const MIN_AGREEING_SHARE: f32 = 0.1;
/// Grey level below which blocks are too dark to be used.
const MIN_BLOCK_LEVEL: u32 = 12;
/// Threshold of a block's mean change, in standard deviations of its noise.
const CHANGE_THRESHOLD_SIGMAS: f32 = 6.0;

/// Sums over the blocks, row by row, of one channel.
type Sums = Vec<u32>;

/// [`super::find_change`] with drift compensation.
pub(super) fn find_change(
    image: &TactileImage,
    background: &TactileImage,
    options: &StereoOptions,
) -> Option<ImageChange> {
    let (now, before) = (block_sums(image), block_sums(background));
    let gain: [f32; 3] = std::array::from_fn(|channel| shared_gain(&now[channel], &before[channel], options.max_drift));
    let area = (BLOCK_SIDE * BLOCK_SIDE) as f32;
    let noise = noise(image, background) / BLOCK_SIDE as f32;
    let limit = area * options.block_threshold.max(CHANGE_THRESHOLD_SIGMAS * noise);
    let (mut count, mut low, mut high) = (0, (BLOCKS_PER_SIDE, BLOCKS_PER_SIDE), (0, 0));
    for block in 0..BLOCKS_PER_SIDE * BLOCKS_PER_SIDE {
        let changed =
            |channel: usize| (now[channel][block] as f32 - gain[channel] * before[channel][block] as f32).abs() > limit;
        if (0..3).any(changed) {
            let (column, row) = (block % BLOCKS_PER_SIDE, block / BLOCKS_PER_SIDE);
            count += 1;
            low = (low.0.min(column), low.1.min(row));
            high = (high.0.max(column), high.1.max(row));
        }
    }
    let region = (count >= options.min_blocks.max(1)).then(|| region_around(low, high, options.margin));
    region.map(|region| ImageChange { region, gain })
}

fn block_sums(image: &TactileImage) -> [Sums; 3] {
    let mut sums: [Sums; 3] = std::array::from_fn(|_| Vec::with_capacity(BLOCKS_PER_SIDE * BLOCKS_PER_SIDE));
    for strip in image.rgb.chunks_exact(3 * N * BLOCK_SIDE) {
        let mut lines = [0u16; 3 * N];
        for line in strip.chunks_exact(3 * N) {
            for (sum, value) in lines.iter_mut().zip(line) {
                *sum += u16::from(*value);
            }
        }
        for block in lines.chunks_exact(3 * BLOCK_SIDE) {
            for (channel, sums) in sums.iter_mut().enumerate() {
                sums.push(block[channel..].iter().step_by(3).map(|sum| u32::from(*sum)).sum());
            }
        }
    }
    sums
}

/// Finds the factor between two images' blocks that the most blocks share, within `most` of 1; 1 if too few share any.
fn shared_gain(now: &[u32], before: &[u32], most: f32) -> f32 {
    let bright = MIN_BLOCK_LEVEL * (BLOCK_SIDE * BLOCK_SIDE) as u32;
    let pairs = now.iter().zip(before).filter(|(_, before)| **before > bright);
    let mut ratios: Vec<f32> = pairs.map(|(now, before)| *now as f32 / *before as f32).collect();
    ratios.retain(|ratio| (ratio - 1.0).abs() < most + GAIN_BAND_WIDTH);
    ratios.sort_unstable_by(f32::total_cmp);
    let (mut best, mut end) = (0..0, 0);
    for begin in 0..ratios.len() {
        while end < ratios.len() && ratios[end] - ratios[begin] < GAIN_BAND_WIDTH {
            end += 1;
        }
        if end - begin > best.len() {
            best = begin..end;
        }
    }
    if (best.len() as f32) < MIN_AGREEING_SHARE * now.len() as f32 {
        return 1.0;
    }
    let count = best.len() as f32;
    let gain = ratios[best].iter().sum::<f32>() / count;
    gain.clamp(1.0 - most, 1.0 + most)
}

/// Standard deviation of the noise in the difference of two images, grey levels: from its mean change between
/// neighbouring pixels, in the calmer rows.
fn noise(image: &TactileImage, background: &TactileImage) -> f32 {
    let row = |row: usize| {
        let line = 3 * N * row..3 * N * (row + 1);
        let difference = |at: usize| i32::from(image.rgb[at]) - i32::from(background.rgb[at]);
        line.clone().zip(line.skip(3)).map(|(at, next)| difference(next).abs_diff(difference(at))).sum::<u32>()
    };
    let mut rows: Vec<u32> = (0..BLOCKS_PER_SIDE).map(|strip| row(strip * BLOCK_SIDE + BLOCK_SIDE / 2)).collect();
    let calm = *rows.select_nth_unstable(BLOCKS_PER_SIDE / 4).1 as f32 / (3 * (N - 1)) as f32;
    // The difference of two normal samples of standard deviation s has the mean absolute value 2 s / sqrt(pi).
    0.5 * std::f32::consts::PI.sqrt() * calm
}

#[cfg(test)]
mod tests {
    use rand::{Rng, RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::PIXELS;

    const OPTIONS: StereoOptions = StereoOptions { block_threshold: 2.0, min_blocks: 3, margin: 2, max_drift: 0.1 };

    /// An unevenly lit image, `gain` times as bright, with noise of standard deviation `noise`, changed by `touch` (column, row,
    /// grey levels).
    fn exposed(gain: f32, noise: f32, touch: impl Fn(usize, usize) -> f32, rng: &mut impl Rng) -> TactileImage {
        let mut value = |at: usize| {
            let (pixel, channel) = (at / 3, at % 3);
            let (column, row) = (pixel % N, pixel / N);
            let lit = 60.0 + 0.3 * column as f32 + 20.0 * channel as f32;
            // The sum of twelve uniform samples is nearly normal.
            let draw: f32 = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
            (gain * (lit + touch(column, row)) + noise * draw).round().clamp(0.0, 255.0) as u8
        };
        TactileImage { rgb: (0..3 * PIXELS).map(&mut value).collect() }
    }

    #[test]
    fn drift_is_no_touch_and_is_measured() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        let background = exposed(1.0, 0.7, |_, _| 0.0, rng);
        for gain in [0.93, 0.98, 1.0, 1.01, 1.06] {
            let image = exposed(gain, 0.7, |_, _| 0.0, rng);
            assert_eq!(find_change(&image, &background, &OPTIONS), None, "{gain}");
            let (now, before) = (block_sums(&image), block_sums(&background));
            for channel in 0..3 {
                let found = shared_gain(&now[channel], &before[channel], 0.1);
                assert!((found - gain).abs() < 5e-4, "{found} {gain}");
            }
            let found = noise(&image, &background);
            // Noise and rounding of both images.
            assert!((found / (2.0f32 * (0.49 + 1.0 / 12.0)).sqrt() - 1.0).abs() < 0.1, "{found}");
        }
    }

    /// With two thirds of the pad touched, the rest determines the drift.
    #[test]
    fn a_wide_touch_is_found_where_it_is() {
        let rng = &mut ChaCha8Rng::seed_from_u64(2);
        let background = exposed(1.0, 0.7, |_, _| 0.0, rng);
        let touch = |column: usize, row: usize| {
            if row < 160 { 12.0 + 25.0 * (0.05 * column as f32).sin() + 0.1 * row as f32 } else { 0.0 }
        };
        let image = exposed(1.05, 0.7, touch, rng);
        let ImageChange { region, gain } = find_change(&image, &background, &OPTIONS).unwrap();
        assert!(gain.iter().all(|gain| (gain - 1.05).abs() < 1e-3), "{gain:?}");
        assert!(region.row_begin == 0 && (160..=174).contains(&region.row_end), "{region:?}");
    }

    /// A faint touch counts if the cameras are quiet; the same change in noise of many grey levels does not.
    #[test]
    fn the_threshold_follows_the_noise() {
        let rng = &mut ChaCha8Rng::seed_from_u64(3);
        let faint = |column: usize, row: usize| if column < 60 && row < 60 { 4.0 } else { 0.0 };
        for (level, seen) in [(0.7, true), (8.0, false)] {
            let background = exposed(1.0, level, |_, _| 0.0, rng);
            let image = exposed(1.02, level, faint, rng);
            assert_eq!(find_change(&image, &background, &OPTIONS).is_some(), seen, "{level}");
        }
    }
}
