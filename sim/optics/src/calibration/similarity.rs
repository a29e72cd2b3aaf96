//! Similarity of two images: mean absolute error, structural similarity and peak signal-to-noise ratio.
//!
//! Grey levels are scaled to 0..1. SSIM is that of Wang et al. (2004) with a flat 7 x 7 window, unbiased variances, `C1
//! = 0.01^2`, `C2 = 0.03^2`, averaged over channels and over the windows that lie wholly inside, as in scikit-image.

use serde::{Deserialize, Serialize};

/// Similarity of two images, over all channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct Similarity {
    /// Mean absolute error of grey levels from 0 to 1.
    pub l1: f64,
    /// Structural similarity; 1 for identical images.
    pub ssim: f64,
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
}

impl Similarity {
    /// Averages each measure; `None` for an empty slice.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let n = all.len() as f64;
        let mean = |value: fn(&Self) -> f64| all.iter().map(value).sum::<f64>() / n;
        (!all.is_empty()).then(|| Self { l1: mean(|s| s.l1), ssim: mean(|s| s.ssim), psnr: mean(|s| s.psnr) })
    }
}

/// Side of SSIM's window, pixels.
const WINDOW_SIZE: usize = 7;

/// Compares two images of the same size (row-major RGB, grey levels 0 to 255) over a rectangle: columns and rows, half open.
/// SSIM needs at least 7 pixels each way; a smaller rectangle has an SSIM of NaN.
pub fn compare(
    a: &[f32],
    b: &[f32],
    width: usize,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
) -> Similarity {
    let (w, h) = (columns.len(), rows.len());
    let (mut absolute, mut square, mut ssim) = (0.0, 0.0, 0.0);
    for channel in 0..3 {
        let cut = |image: &[f32]| -> Vec<f64> {
            rows.clone()
                .flat_map(|row| columns.clone().map(move |column| 3 * (row * width + column) + channel))
                .map(|at| f64::from(image[at]) / 255.0)
                .collect()
        };
        let (a, b) = (cut(a), cut(b));
        for (a, b) in a.iter().zip(&b) {
            absolute += (a - b).abs();
            square += (a - b) * (a - b);
        }
        ssim += channel_ssim(&a, &b, w, h) / 3.0;
    }
    let n = (3 * w * h) as f64;
    Similarity { l1: absolute / n, ssim, psnr: -10.0 * (square / n).log10() }
}

fn channel_ssim(a: &[f64], b: &[f64], w: usize, h: usize) -> f64 {
    const WINDOW_PIXELS: f64 = (WINDOW_SIZE * WINDOW_SIZE) as f64;
    let (c1, c2) = (1e-4, 9e-4);
    let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let mean =
        |values: &[f64]| window_sums(values, w, h).into_iter().map(|sum| sum / WINDOW_PIXELS).collect::<Vec<f64>>();
    let (ma, mb) = (mean(a), mean(b));
    let (aa, bb, ab) = (mean(&product(a, a)), mean(&product(b, b)), mean(&product(a, b)));
    let unbiased = WINDOW_PIXELS / (WINDOW_PIXELS - 1.0);
    let mut sum = 0.0;
    for i in 0..ma.len() {
        let (x, y) = (ma[i], mb[i]);
        let (vx, vy) = (unbiased * (aa[i] - x * x), unbiased * (bb[i] - y * y));
        let vxy = unbiased * (ab[i] - x * y);
        sum += (2.0 * x * y + c1) * (2.0 * vxy + c2) / ((x * x + y * y + c1) * (vx + vy + c2));
    }
    if ma.is_empty() { f64::NAN } else { sum / ma.len() as f64 }
}

/// Sums the values over each window that lies wholly inside.
fn window_sums(values: &[f64], w: usize, h: usize) -> Vec<f64> {
    if w < WINDOW_SIZE || h < WINDOW_SIZE {
        return Vec::new();
    }
    let along = w - WINDOW_SIZE + 1;
    let mut lines = vec![0.0; along * h];
    for (line, out) in values.chunks_exact(w).zip(lines.chunks_exact_mut(along)) {
        let mut sum: f64 = line[..WINDOW_SIZE].iter().sum();
        out[0] = sum;
        for i in 1..along {
            sum += line[i + WINDOW_SIZE - 1] - line[i - 1];
            out[i] = sum;
        }
    }
    let mut sums = vec![0.0; along * (h - WINDOW_SIZE + 1)];
    let mut column = vec![0.0; along];
    for row in 0..h {
        column.iter_mut().zip(&lines[row * along..]).for_each(|(sum, value)| *sum += value);
        if row + 1 >= WINDOW_SIZE {
            let top = row + 1 - WINDOW_SIZE;
            sums[top * along..(top + 1) * along].copy_from_slice(&column);
            column.iter_mut().zip(&lines[top * along..]).for_each(|(sum, value)| *sum -= value);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_like_itself() {
        let image: Vec<f32> = (0..3 * 20 * 15).map(|i| (i * 37 % 251) as f32).collect();
        let same = compare(&image, &image, 20, 0..20, 0..15);
        assert!(same.l1 == 0.0 && (same.ssim - 1.0).abs() < 1e-12 && same.psnr.is_infinite());
    }

    #[test]
    fn a_constant_offset_by_hand() {
        let (a, b) = (vec![51.0f32; 3 * 100], vec![102.0f32; 3 * 100]);
        let found = compare(&a, &b, 10, 0..10, 0..10);
        assert!((found.l1 - 0.2).abs() < 1e-9 && (found.psnr - 13.979_400_086_72).abs() < 1e-6);
        // No structure: only the luminance term is left, (2 . 0.2 . 0.4 + C1) / (0.2^2 + 0.4^2 + C1).
        assert!((found.ssim - 0.1601 / 0.2001).abs() < 1e-6, "{}", found.ssim);
    }

    #[test]
    fn windows_are_summed_as_if_one_by_one() {
        let (w, h) = (13, 9);
        let values: Vec<f64> = (0..w * h).map(|i| ((i * i) % 17) as f64).collect();
        let sums = window_sums(&values, w, h);
        for top in 0..h - 6 {
            for left in 0..w - 6 {
                let slow: f64 = (0..49).map(|k| values[(top + k / 7) * w + left + k % 7]).sum();
                assert!((sums[top * (w - 6) + left] - slow).abs() < 1e-9);
            }
        }
    }
}
