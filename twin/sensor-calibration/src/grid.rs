//! Photos of any size on the grid of the pads' images, and back.
//!
//! A photo is averaged onto 240 x 240 pixels, so that photometric stereo runs on it as it does on a pad; what it finds is
//! interpolated between those pixels' middles.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;

/// A photo's size, which the pads' grid covers.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Columns of the photo.
    pub width: usize,
    /// Rows of the photo.
    pub height: usize,
}

impl Grid {
    /// Size of a pixel of the pads' grid, given the photo's.
    pub fn pixel(self, pixel: f64) -> (f64, f64) {
        (pixel * self.width as f64 / N as f64, pixel * self.height as f64 / N as f64)
    }

    /// Column and row of the photo in the middle of pixel `i` of the pads' grid.
    pub fn center(self, i: usize) -> (f64, f64) {
        let at = |k: usize, size: usize| (k as f64 + 0.5) * size as f64 / N as f64 - 0.5;
        (at(i % N, self.width), at(i / N, self.height))
    }

    pub fn image(self, rgb: &[u8]) -> Arc<TactileImage> {
        let values: Vec<f32> = rgb.iter().map(|&value| f32::from(value)).collect();
        let rgb = self.averaged(&values, 3).into_iter().map(|value| value.round() as u8).collect();
        Arc::new(TactileImage { rgb })
    }

    /// Means over the pixels of the pads' grid, by the area that each pixel of the photo covers of them.
    pub fn averaged(self, values: &[f32], channels: usize) -> Vec<f32> {
        let (columns, rows) = (shares(self.width), shares(self.height));
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

    /// Values on the pads' grid, interpolated at the photo's pixels; beyond the outermost middles they are those at the border.
    pub fn spread(self, values: &[f32]) -> Vec<f32> {
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

/// For each of the grid's columns, which of `size` columns it covers, and how much of it each is.
fn shares(size: usize) -> Vec<Vec<(usize, f32)>> {
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
        let grid = Grid { width: 640, height: 480 };
        let ramp: Vec<f32> = (0..640 * 480).map(|i| (i % 640) as f32 + 10.0 * (i / 640) as f32).collect();
        let small = grid.averaged(&ramp, 1);
        for i in [0, 239, 1234, N * N - 1] {
            let (column, row) = grid.center(i);
            // A photo's pixel that is covered in part counts with its own place.
            assert!((f64::from(small[i]) - column - 10.0 * row).abs() < 0.1, "{i}: {} {column} {row}", small[i]);
        }
        // Interpolated back, the ramp is where it was, but for the outermost pixels.
        let back = grid.spread(&small);
        for (column, row) in [(5, 7), (320, 240), (633, 471)] {
            let found = f64::from(back[row * 640 + column]);
            assert!((found - column as f64 - 10.0 * row as f64).abs() < 0.2, "{column} {row}: {found}");
        }
        let (dx, dy) = grid.pixel(0.0295e-3);
        assert!((dx / dy - 4.0 / 3.0).abs() < 1e-12);
    }
}
