//! Detection of the region in which a tactile image differs from the background of its untouched pad, and the relative
//! colour change.

mod drift;

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;

use crate::PIXELS;

/// Side of the blocks in which change is detected, pixels.
const BLOCK_SIDE: usize = 6;
const BLOCKS_PER_SIDE: usize = N / BLOCK_SIDE;

/// Thresholds for a pad to count as touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoOptions {
    /// Least mean change of a channel over a block of 6 x 6 pixels, grey levels of 255.
    pub block_threshold: f32,
    /// Least number of changed blocks.
    pub min_blocks: usize,
    /// Blocks added around the changed region.
    pub margin: usize,
    /// Largest uniform relative change of a channel's brightness between background and image that is attributed to
    /// drift of lamps or exposure and compensated. At 0, images are compared as they are.
    pub max_drift: f32,
}

impl Default for StereoOptions {
    fn default() -> Self {
        // Pixel noise of 2 grey levels gives block means a standard deviation of 0.33; 4800 means do not reach 6 times
        // that by chance.
        Self { block_threshold: 2.0, min_blocks: 3, margin: 2, max_drift: 0.0 }
    }
}

/// A half-open rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct Region {
    pub column_begin: usize,
    pub column_end: usize,
    pub row_begin: usize,
    pub row_end: usize,
}

impl Region {
    /// The whole image.
    pub const FULL: Self = Self { column_begin: 0, column_end: N, row_begin: 0, row_end: N };

    /// True if the pixel is in the region.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        (self.column_begin..self.column_end).contains(&column) && (self.row_begin..self.row_end).contains(&row)
    }
}

/// Difference between an image and its background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageChange {
    /// Smallest region of whole blocks that contains the change, with a margin.
    pub region: Region,
    /// Brightness of each channel of the untouched gel in the image relative to the background.
    pub gain: [f32; 3],
}

impl ImageChange {
    /// The whole image, at the brightness of the background.
    pub(crate) const WHOLE: Self = Self { region: Region::FULL, gain: [1.0; 3] };
}

/// Finds the region in which `image` differs from `background`; `None` if the pad is untouched.
pub fn find_change(image: &TactileImage, background: &TactileImage, options: &StereoOptions) -> Option<ImageChange> {
    if options.max_drift > 0.0 {
        return drift::find_change(image, background, options);
    }
    changed_region(image, background, options).map(|region| ImageChange { region, gain: [1.0; 3] })
}

/// Finds the region in which `image` differs from `background` without drift compensation; `None` if the pad is
/// untouched.
fn changed_region(image: &TactileImage, background: &TactileImage, options: &StereoOptions) -> Option<Region> {
    if image.rgb == background.rgb {
        return None;
    }
    let limit = (options.block_threshold * (BLOCK_SIDE * BLOCK_SIDE) as f32) as i32;
    let (mut count, mut low, mut high) = (0, (BLOCKS_PER_SIDE, BLOCKS_PER_SIDE), (0, 0));
    const STRIP_BYTES: usize = 3 * N * BLOCK_SIDE;
    let strips = image.rgb.chunks_exact(STRIP_BYTES).zip(background.rgb.chunks_exact(STRIP_BYTES));
    for (block_row, (now, before)) in strips.enumerate() {
        let mut sums = [0i16; 3 * N];
        for (now, before) in now.chunks_exact(3 * N).zip(before.chunks_exact(3 * N)) {
            for (sum, (now, before)) in sums.iter_mut().zip(now.iter().zip(before)) {
                *sum += i16::from(*now) - i16::from(*before);
            }
        }
        for (block_column, sums) in sums.chunks_exact(3 * BLOCK_SIDE).enumerate() {
            let of = |channel: usize| sums[channel..].iter().step_by(3).map(|sum| i32::from(*sum)).sum::<i32>();
            if (0..3).any(|channel| of(channel).abs() > limit) {
                count += 1;
                low = (low.0.min(block_column), low.1.min(block_row));
                high = (high.0.max(block_column), high.1.max(block_row));
            }
        }
    }
    (count >= options.min_blocks.max(1)).then(|| region_around(low, high, options.margin))
}

/// Region from block (column, row) `low` to `high`, both included, with `margin` blocks around it.
fn region_around(low: (usize, usize), high: (usize, usize), margin: usize) -> Region {
    Region {
        column_begin: low.0.saturating_sub(margin) * BLOCK_SIDE,
        column_end: (high.0 + 1 + margin).min(BLOCKS_PER_SIDE) * BLOCK_SIDE,
        row_begin: low.1.saturating_sub(margin) * BLOCK_SIDE,
        row_end: (high.1 + 1 + margin).min(BLOCKS_PER_SIDE) * BLOCK_SIDE,
    }
}

/// Changed region of an image and the relative colour change of its pixels (0 elsewhere), which is the input of the
/// photometric stereo methods. `None` if the pad is untouched.
pub fn relative_change(
    image: &TactileImage,
    background: &TactileImage,
    options: &StereoOptions,
) -> Option<(Region, Vec<[f32; 3]>)> {
    let change = find_change(image, background, options)?;
    Some((change.region, colour_change(image, background, change)))
}

/// Relative colour change of every pixel of an image that has the brightness of its background.
pub fn whole_change(image: &TactileImage, background: &TactileImage) -> Vec<[f32; 3]> {
    colour_change(image, background, ImageChange::WHOLE)
}

/// Relative colour change of every pixel of the changed region (0 elsewhere), smoothed by a 3 x 3 binomial filter.
/// Dividing by the background's brightness, with drift applied, compensates for uneven lighting. The floor limits the
/// gain in dark corners.
#[allow(clippy::needless_range_loop)] // three arrays share the index
pub(crate) fn colour_change(image: &TactileImage, background: &TactileImage, change: ImageChange) -> Vec<[f32; 3]> {
    const MIN_BACKGROUND_LEVEL: f32 = 40.0;
    let ImageChange { region, gain } = change;
    let expected: [[f32; 256]; 3] = gain.map(|gain| std::array::from_fn(|before| gain * before as f32));
    let scale = expected.map(|expected| expected.map(|before| 1.0 / (before + MIN_BACKGROUND_LEVEL)));
    let mut change = vec![[0.0f32; 3]; PIXELS];
    let mut raw = vec![[0.0f32; 3]; PIXELS];
    for row in region.row_begin..region.row_end {
        for i in row * N + region.column_begin..row * N + region.column_end {
            for channel in 0..3 {
                let before = usize::from(background.rgb[3 * i + channel]);
                raw[i][channel] =
                    (f32::from(image.rgb[3 * i + channel]) - expected[channel][before]) * scale[channel][before];
            }
        }
    }
    let mut line = [[0.0f32; 3]; N];
    for row in region.row_begin..region.row_end {
        let above = row.max(region.row_begin + 1) - 1;
        let below = (row + 1).min(region.row_end - 1);
        for column in region.column_begin..region.column_end {
            for channel in 0..3 {
                line[column][channel] = 0.25 * (raw[above * N + column][channel] + raw[below * N + column][channel])
                    + 0.5 * raw[row * N + column][channel];
            }
        }
        for column in region.column_begin..region.column_end {
            let left = column.max(region.column_begin + 1) - 1;
            let right = (column + 1).min(region.column_end - 1);
            for channel in 0..3 {
                change[row * N + column][channel] =
                    0.25 * (line[left][channel] + line[right][channel]) + 0.5 * line[column][channel];
            }
        }
    }
    change
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: u8) -> TactileImage {
        TactileImage { rgb: vec![value; 3 * PIXELS] }
    }

    #[test]
    fn noise_is_not_a_touch() {
        let background = flat(120);
        let mut image = background.clone();
        let mut state = 1u32;
        for byte in &mut image.rgb {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            *byte = byte.wrapping_add((state >> 24) as u8 % 7).wrapping_sub(3); // sd 2
        }
        assert_eq!(changed_region(&image, &background, &StereoOptions::default()), None);
        assert_eq!(changed_region(&background, &background, &StereoOptions::default()), None);
    }

    #[test]
    fn region_surrounds_the_change() {
        let background = flat(120);
        let mut image = background.clone();
        for row in 100..130 {
            for column in 60..80 {
                image.rgb[3 * (row * N + column)] = 150;
            }
        }
        let region = changed_region(&image, &background, &StereoOptions::default()).expect("a touch");
        assert!(region.contains(60, 100) && region.contains(79, 129));
        assert!(!region.contains(30, 100) && !region.contains(70, 160));
    }
}
