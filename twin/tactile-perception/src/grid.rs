//! Resampling of photos of any size to the grid of the pads' images, and back.
//!
//! A photo is averaged onto 240 x 240 pixels, so that photometric stereo runs on it as on a pad. The results are
//! interpolated between the centres of those pixels.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;

/// Size of a photo that the pads' grid covers.
///
/// ```
/// use tactile_perception::grid::PadGrid;
///
/// let grid = PadGrid { width: 320, height: 180 };
/// let image = grid.image(&vec![120; 3 * 320 * 180]);
/// assert_eq!(image.rgb.len(), 3 * 240 * 240);
/// assert_eq!(grid.interpolated(&vec![1e-3; 240 * 240]).len(), 320 * 180);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PadGrid {
    /// Columns of the photo.
    pub width: usize,
    /// Rows of the photo.
    pub height: usize,
}

impl PadGrid {
    /// Converts the photo's pixel size to that of the pads' grid (dx, dy).
    pub fn pixel(self, pixel: f64) -> (f64, f64) {
        (pixel * self.width as f64 / N as f64, pixel * self.height as f64 / N as f64)
    }

    /// Returns column and row of the photo at the centre of pixel `i` of the pads' grid.
    pub fn center(self, i: usize) -> (f64, f64) {
        let at = |k: usize, size: usize| (k as f64 + 0.5) * size as f64 / N as f64 - 0.5;
        (at(i % N, self.width), at(i / N, self.height))
    }

    /// Averages a photo (row-major RGB) onto the pads' grid.
    ///
    /// # Panics
    /// If `rgb` has fewer than `3 * width * height` values.
    pub fn image(self, rgb: &[u8]) -> Arc<TactileImage> {
        let values: Vec<f32> = rgb.iter().map(|&value| f32::from(value)).collect();
        let rgb = self.averaged(&values, 3).into_iter().map(|value| value.round() as u8).collect();
        Arc::new(TactileImage { rgb })
    }

    /// Averages over each pixel of the pads' grid, weighted by the area that each of the photo's pixels covers of it.
    /// `values` are row-major, `channels` a pixel.
    ///
    /// # Panics
    /// If `values` has fewer than `channels * width * height` values.
    pub fn averaged(self, values: &[f32], channels: usize) -> Vec<f32> {
        let (columns, rows) = (overlap_shares(self.width), overlap_shares(self.height));
        let mut sums = vec![0.0f32; self.height * N * channels];
        for row in 0..self.height {
            for (column, shares) in columns.iter().enumerate() {
                for &(at, share) in shares {
                    for channel in 0..channels {
                        sums[(row * N + column) * channels + channel] +=
                            share * values[(row * self.width + at) * channels + channel];
                    }
                }
            }
        }
        let mut means = vec![0.0f32; N * N * channels];
        for (row, shares) in rows.iter().enumerate() {
            for &(at, share) in shares {
                let from = &sums[at * N * channels..(at + 1) * N * channels];
                for (mean, value) in means[row * N * channels..].iter_mut().zip(from) {
                    *mean += share * value;
                }
            }
        }
        means
    }

    /// Interpolates values on the pads' grid at the photo's pixels. Beyond the outermost pixel centres the border
    /// values are kept.
    ///
    /// # Panics
    /// If `values` has fewer than 240 x 240 values.
    pub fn interpolated(self, values: &[f32]) -> Vec<f32> {
        let at = |k: usize, size: usize| {
            let place = ((k as f64 + 0.5) * N as f64 / size as f64 - 0.5).clamp(0.0, (N - 1) as f64);
            let cell = (place as usize).min(N - 2);
            (cell, (place - cell as f64) as f32)
        };
        let columns: Vec<(usize, f32)> = (0..self.width).map(|column| at(column, self.width)).collect();
        let mut spread = Vec::with_capacity(self.width * self.height);
        for row in 0..self.height {
            let (r, v) = at(row, self.height);
            let (upper, lower) = (&values[r * N..(r + 1) * N], &values[(r + 1) * N..(r + 2) * N]);
            spread.extend(columns.iter().map(|&(c, u)| {
                (1.0 - v) * ((1.0 - u) * upper[c] + u * upper[c + 1]) + v * ((1.0 - u) * lower[c] + u * lower[c + 1])
            }));
        }
        spread
    }
}

/// Returns for each column of the grid the covered ones of `size` columns, with the share of each.
fn overlap_shares(size: usize) -> Vec<Vec<(usize, f32)>> {
    let step = size as f64 / N as f64;
    (0..N)
        .map(|n| {
            let (begin, end) = (n as f64 * step, (n + 1) as f64 * step);
            let part = |k: usize| (end.min(k as f64 + 1.0) - begin.max(k as f64)) / step;
            let last = (end.ceil() as usize).min(size);
            (begin as usize..last).map(|k| (k, part(k) as f32)).filter(|(_, part)| *part > 0.0).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaging_keeps_means_and_places() {
        let grid = PadGrid { width: 640, height: 480 };
        let ramp: Vec<f32> = (0..640 * 480).map(|i| (i % 640) as f32 + 10.0 * (i / 640) as f32).collect();
        let small = grid.averaged(&ramp, 1);
        for i in [0, 239, 1234, N * N - 1] {
            let (column, row) = grid.center(i);
            // A partly covered pixel of the photo counts with its own position.
            assert!((f64::from(small[i]) - column - 10.0 * row).abs() < 0.1, "{i}: {} {column} {row}", small[i]);
        }
        // After interpolation back, the ramp is unchanged except for the outermost pixels.
        let back = grid.interpolated(&small);
        for (column, row) in [(5, 7), (320, 240), (633, 471)] {
            let found = f64::from(back[row * 640 + column]);
            assert!((found - column as f64 - 10.0 * row as f64).abs() < 0.2, "{column} {row}: {found}");
        }
        let (dx, dy) = grid.pixel(0.0295e-3);
        assert!((dx / dy - 4.0 / 3.0).abs() < 1e-12);
    }
}
