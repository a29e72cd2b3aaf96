//! Touch detection in an image, pixel by pixel.
//!
//! Noise and uneven drift give slopes to untouched gel, and these add up to hills far from any contact. A pixel counts
//! as touched if its colour change, averaged over its neighbourhood, stands out of the noise, and if it is connected to
//! one whose change is unmistakable (hysteresis thresholding).

use hand_model::pads::IMAGE_SIZE as N;

/// Half-width of the averaging window, pixels.
const WINDOW_HALF_WIDTH: usize = 2;
/// Thresholds on the mean change, in standard deviations of the noise: a pixel may be touched (faint), or surely is
/// (plain).
const FAINT_THRESHOLD: f32 = 2.5;
const SURE_THRESHOLD: f32 = 7.0;
/// Minimum number of connected pixels.
const MIN_CONNECTED_PIXELS: usize = 40;

/// Returns the touched pixels, from relative colour changes and the standard deviation of their noise.
pub fn touched_pixels(change: &[[f32; 3]], noise: f32) -> Vec<bool> {
    let mean = averaged(change);
    let mut touched = vec![false; N * N];
    let mut seen = vec![false; N * N];
    for start in 0..N * N {
        if seen[start] || mean[start] < SURE_THRESHOLD * noise {
            continue;
        }
        seen[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            for beside in neighbours(at) {
                if !seen[beside] && mean[beside] > FAINT_THRESHOLD * noise {
                    seen[beside] = true;
                    patch.push(beside);
                }
            }
        }
        if patch.len() >= MIN_CONNECTED_PIXELS {
            patch.into_iter().for_each(|at| touched[at] = true);
        }
    }
    touched
}

/// Returns the touched share of the image's border.
pub fn border_share(touched: &[bool]) -> f64 {
    let border = |i: &usize| i.is_multiple_of(N) || i % N == N - 1 || i / N == 0 || i / N == N - 1;
    let (mut count, mut all) = (0usize, 0usize);
    for i in (0..N * N).filter(border) {
        count += usize::from(touched[i]);
        all += 1;
    }
    count as f64 / all as f64
}

/// Returns the four neighbours of a pixel.
fn neighbours(at: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (at % N, at / N);
    let beside = [
        (column > 0).then(|| at - 1),
        (column + 1 < N).then_some(at + 1),
        (row > 0).then(|| at - N),
        (row + 1 < N).then_some(at + N),
    ];
    beside.into_iter().flatten()
}

/// Returns the mean absolute change around each pixel, of the largest channel.
fn averaged(change: &[[f32; 3]]) -> Vec<f32> {
    let mut largest = vec![0.0f32; N * N];
    // Integral image: sums over all pixels above and to the left.
    let mut sums = vec![0.0f64; (N + 1) * (N + 1)];
    let channels: [fn(&[f32; 3]) -> f32; 3] = [|color| color[0], |color| color[1], |color| color[2]];
    for channel in channels {
        for row in 0..N {
            let mut line = 0.0;
            for column in 0..N {
                line += f64::from(channel(&change[row * N + column]).abs());
                sums[(row + 1) * (N + 1) + column + 1] = sums[row * (N + 1) + column + 1] + line;
            }
        }
        let at = |row: usize, column: usize| sums[row * (N + 1) + column];
        for row in 0..N {
            let (top, bottom) = (row.saturating_sub(WINDOW_HALF_WIDTH), (row + WINDOW_HALF_WIDTH + 1).min(N));
            for column in 0..N {
                let (left, right) = (column.saturating_sub(WINDOW_HALF_WIDTH), (column + WINDOW_HALF_WIDTH + 1).min(N));
                let sum = at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left);
                let mean = (sum / ((bottom - top) * (right - left)) as f64) as f32;
                largest[row * N + column] = largest[row * N + column].max(mean);
            }
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hill_that_is_noise_is_no_touch() {
        let mut state = 5u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        // Uniform noise of standard deviation 0.01.
        let mut change: Vec<[f32; 3]> = (0..N * N).map(|_| [(); 3].map(|()| 0.0346 * draw())).collect();
        assert!(touched_pixels(&change, 0.01).iter().all(|touched| !touched));
        for (i, change) in change.iter_mut().enumerate() {
            let r = (i as f32 % N as f32 - 60.0).hypot((i / N) as f32 - 70.0);
            if r < 25.0 {
                change[1] += 0.3 * (r / 25.0);
            }
        }
        let found = touched_pixels(&change, 0.01);
        let count = found.iter().filter(|touched| **touched).count();
        assert!((1800..2400).contains(&count), "{count}");
        assert!(found[70 * N + 80] && !found[200 * N + 200]);
        assert_eq!(border_share(&found), 0.0);
        assert!((border_share(&[true; N * N]) - 1.0).abs() < 1e-12);
    }
}
