//! Detection of images that are mirrored, rotated, or have two channels exchanged relative to the image of the
//! untouched gel.
//!
//! The lamps light the gel unevenly, from different sides, and most of the gel is untouched. Therefore the block-wise
//! brightness of a correct image fits the background best as it is. If it fits a rearranged background far better, the
//! image is rearranged. A background that is lit evenly gives no information.

use crate::calibration::photo::Photo;

/// Number of blocks across and down.
const BLOCK_COUNTS: [usize; 2] = [16, 12];
/// Fraction of the blocks that are compared, those that fit best: the others may be touched.
const COMPARED_SHARE: f64 = 0.6;
/// Smallest difference (root mean square, relative to the brightness) of an image from its background that is not
/// noise.
const MIN_DIFFERENCE: f64 = 0.03;
/// Largest ratio of the mean square difference from a rearranged background to that from the background as it is.
const MAX_ERROR_RATIO: f64 = 0.25;

/// Brightness of the channels over the blocks, relative to their mean.
type Blocks = Vec<[f64; 3]>;

/// Describes the way in which `photo` is rearranged relative to a background of the same size; `None` if it is not.
pub fn describe_rearrangement(photo: &Photo, background: &Photo) -> Option<&'static str> {
    if photo.width < 2 * BLOCK_COUNTS[0] || photo.height < 2 * BLOCK_COUNTS[1] {
        return None;
    }
    let (now, before) = (blocks(photo), blocks(background));
    let as_it_is = difference(&now, &before);
    if as_it_is < MIN_DIFFERENCE * MIN_DIFFERENCE {
        return None;
    }
    let [w, h] = BLOCK_COUNTS;
    let moved = |from: &dyn Fn(usize, usize) -> usize| -> Blocks {
        (0..w * h).map(|at| before[from(at % w, at / w)]).collect()
    };
    let ways = [
        ("mirrored left to right", moved(&|x, y| y * w + w - 1 - x)),
        ("mirrored top to bottom", moved(&|x, y| (h - 1 - y) * w + x)),
        ("turned by 180 degrees", moved(&|x, y| (h - 1 - y) * w + w - 1 - x)),
        ("as if red and blue were exchanged", before.iter().map(|[r, g, b]| [*b, *g, *r]).collect()),
    ];
    let tried = ways.map(|(way, blocks)| (difference(&now, &blocks), way));
    let best = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 < MAX_ERROR_RATIO * as_it_is).then_some(best.1)
}

fn blocks(photo: &Photo) -> Blocks {
    let [w, h] = BLOCK_COUNTS;
    let mut sums = vec![[0.0; 3]; w * h];
    let mut counts = vec![0.0; w * h];
    for (at, pixel) in photo.rgb.chunks_exact(3).enumerate() {
        let (column, row) = (at % photo.width * w / photo.width, at / photo.width * h / photo.height);
        for c in 0..3 {
            sums[row * w + column][c] += f64::from(pixel[c]);
        }
        counts[row * w + column] += 1.0;
    }
    // Use one factor for all channels, because an exchange changes their balance.
    let mean = sums.iter().flatten().sum::<f64>() / (3.0 * counts.iter().sum::<f64>()).max(1.0);
    let relative = |(sum, count): ([f64; 3], f64)| sum.map(|sum| sum / (f64::max(count, 1.0) * mean.max(1e-9)));
    sums.into_iter().zip(counts).map(relative).collect()
}

/// Computes the mean square difference over the blocks that fit best.
fn difference(a: &Blocks, b: &Blocks) -> f64 {
    let of_block = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>() / 3.0;
    let mut all: Vec<f64> = a.iter().zip(b).map(of_block).collect();
    all.sort_by(f64::total_cmp);
    all.truncate(((COMPARED_SHARE * all.len() as f64) as usize).max(1));
    all.iter().sum::<f64>() / all.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gel lit in red from the left, green from the top and blue from the lower right, with a press.
    fn photo(way: impl Fn(usize, usize) -> (usize, usize), exchanged: bool, press: bool) -> Photo {
        let (width, height) = (160, 120);
        let mut rgb = Vec::new();
        for at in 0..width * height {
            let (x, y) = way(at % width, at / width);
            let (u, v) = (x as f64 / width as f64, y as f64 / height as f64);
            let touched = press && (x as f64 - 60.0).hypot(y as f64 - 50.0) < 20.0;
            let more = if touched { 40.0 * (u - 0.4) } else { 0.0 };
            let mut pixel = [130.0 - 60.0 * u + more, 120.0 - 50.0 * v, 40.0 + 60.0 * u * v - more];
            if exchanged {
                pixel.reverse();
            }
            rgb.extend(pixel.map(|value| value as u8));
        }
        Photo { width, height, rgb }
    }

    #[test]
    fn a_mirrored_image_is_told_and_a_press_is_not() {
        let background = photo(|x, y| (x, y), false, false);
        let found = |photo: &Photo| describe_rearrangement(photo, &background);
        assert_eq!(found(&photo(|x, y| (x, y), false, true)), None);
        assert_eq!(found(&photo(|x, y| (159 - x, y), false, true)), Some("mirrored left to right"));
        assert_eq!(found(&photo(|x, y| (x, 119 - y), false, true)), Some("mirrored top to bottom"));
        assert_eq!(found(&photo(|x, y| (159 - x, 119 - y), false, true)), Some("turned by 180 degrees"));
        assert_eq!(found(&photo(|x, y| (x, y), true, true)), Some("as if red and blue were exchanged"));
        // Half as bright, and evenly lit.
        let mut dim = photo(|x, y| (x, y), false, true);
        dim.rgb.iter_mut().for_each(|value| *value /= 2);
        assert_eq!(found(&dim), None);
        let even = Photo { width: 160, height: 120, rgb: vec![90; 3 * 160 * 120] };
        assert_eq!(describe_rearrangement(&even, &even), None);
    }
}
