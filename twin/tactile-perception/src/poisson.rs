//! Gradient field to height map: a least-squares Poisson solver by discrete cosine transform.
//!
//! It finds the `h` that minimises the sum of squares of `(h[i+1] - h[i])/d - g` along both axes, with g the mean gradient
//! of the two pixels. Pixels need not be square. The boundary conditions are natural (Neumann).

use std::f64::consts::PI;
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use crate::IMAGE_SIZE as N;
use crate::PIXELS;
use crate::colour_change::Region;

/// A solver with planned transforms; cheap to clone.
#[derive(Clone)]
pub struct PoissonSolver {
    cosines: Cosines,
    /// 2 cos(pi k / N) - 2.
    eigenvalues: Arc<[f32]>,
}

impl std::fmt::Debug for PoissonSolver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PoissonSolver")
    }
}

impl Default for PoissonSolver {
    fn default() -> Self {
        Self::new()
    }
}

impl PoissonSolver {
    /// Plans the transforms.
    pub fn new() -> Self {
        Self {
            cosines: Cosines::new(),
            eigenvalues: (0..N).map(|k| (2.0 * (PI * k as f64 / N as f64).cos() - 2.0) as f32).collect(),
        }
    }

    /// Integrates the gradients `gx` = dh/dx and `gy` = dh/dy in the pad frame (y against the row order) to heights (m,
    /// zero mean), with pixels of `dx` by `dy` m.
    ///
    /// # Panics
    /// If a field does not have [`PIXELS`] elements.
    pub fn solve(&self, gx: &[f32], gy: &[f32], (dx, dy): (f64, f64)) -> Vec<f32> {
        assert!(gx.len() == PIXELS && gy.len() == PIXELS, "fields of {PIXELS} pixels");
        let (dx, dy) = (dx as f32, dy as f32);
        let mut field = divergence(gx, gy, (dx, dy));
        let mut work = Work::default();
        for lines in field.chunks_exact_mut(2 * N).filter(|lines| lines.iter().any(|value| *value != 0.0)) {
            self.cosines.forward(lines, &mut work);
        }
        let mut turned = vec![0.0f32; PIXELS];
        transpose(&field, &mut turned);
        let aspect = (dx / dy) * (dx / dy);
        let scale = 4.0 / (N * N) as f32;
        for (pair, lines) in turned.chunks_exact_mut(2 * N).enumerate() {
            self.cosines.forward(lines, &mut work);
            for (line, k) in lines.chunks_exact_mut(N).zip(2 * pair..) {
                for (value, eigenvalue) in line.iter_mut().zip(self.eigenvalues.iter()) {
                    *value *= scale / (self.eigenvalues[k] + aspect * eigenvalue);
                }
            }
            if pair == 0 {
                lines[0] = 0.0; // the mean, which gradients do not determine
            }
            self.cosines.backward(lines, &mut work);
        }
        transpose(&turned, &mut field);
        for lines in field.chunks_exact_mut(2 * N) {
            self.cosines.backward(lines, &mut work);
        }
        field
    }
}

/// Height of the untouched gel, because a Poisson solution is determined only up to a constant: the median along the
/// inner border of the changed region where that is not the image border, else a low quantile along the image border.
pub fn rest_level(height: &[f32], region: Region) -> f32 {
    let mut border: Vec<f32> = Vec::new();
    for row in region.row_begin..region.row_end {
        border.extend((region.column_begin > 0).then(|| height[row * N + region.column_begin]));
        border.extend((region.column_end < N).then(|| height[row * N + region.column_end - 1]));
    }
    for column in region.column_begin..region.column_end {
        border.extend((region.row_begin > 0).then(|| height[region.row_begin * N + column]));
        border.extend((region.row_end < N).then(|| height[(region.row_end - 1) * N + column]));
    }
    let mut quantile = 0.5;
    if border.len() < N / 4 {
        quantile = 0.1;
        border =
            (0..N).flat_map(|i| [height[i], height[(N - 1) * N + i], height[i * N], height[i * N + N - 1]]).collect();
    }
    let at = ((border.len() - 1) as f64 * quantile) as usize;
    *border.select_nth_unstable_by(at, f32::total_cmp).1
}

/// Divergence of the gradients, times dx^2. Half-pixel gradients are means of neighbours; there is zero flux at the
/// border.
fn divergence(gx: &[f32], gy: &[f32], (dx, dy): (f32, f32)) -> Vec<f32> {
    let mut field = vec![0.0f32; PIXELS];
    let (ax, ay) = (0.5 * dx, -0.5 * dx * dx / dy);
    for (row, line) in field.chunks_exact_mut(N).enumerate() {
        let at = row * N;
        let g = &gx[at..at + N];
        line[0] = ax * (g[0] + g[1]);
        line[N - 1] = -ax * (g[N - 2] + g[N - 1]);
        for (value, around) in line[1..N - 1].iter_mut().zip(g.windows(3)) {
            *value = ax * (around[2] - around[0]);
        }
        let g = &gy[at..at + N];
        if row + 1 < N {
            line.iter_mut().zip(g.iter().zip(&gy[at + N..])).for_each(|(value, (a, b))| *value += ay * (a + b));
        }
        if row > 0 {
            line.iter_mut().zip(g.iter().zip(&gy[at - N..])).for_each(|(value, (a, b))| *value -= ay * (a + b));
        }
    }
    field
}

/// Cosine transforms (type 2 and inverse) of two real lines at a time by one complex Fourier transform (Makhoul 1980).
#[derive(Clone)]
struct Cosines {
    fft: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    /// exp(-i pi k / 2N) / 2.
    twiddles: Arc<[Complex<f32>]>,
}

/// Working space of the transforms.
#[derive(Default)]
struct Work {
    buffer: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
}

impl Cosines {
    fn new() -> Self {
        let mut planner = FftPlanner::new();
        let turn = |k: usize| Complex::from_polar(0.5, -PI * k as f64 / (2 * N) as f64);
        Self {
            fft: planner.plan_fft_forward(N),
            inverse: planner.plan_fft_inverse(N),
            twiddles: (0..N).map(turn).map(|turn| Complex::new(turn.re as f32, turn.im as f32)).collect(),
        }
    }

    fn run(fft: &dyn Fft<f32>, work: &mut Work) {
        work.scratch.resize(fft.get_inplace_scratch_len(), Complex::default());
        fft.process_with_scratch(&mut work.buffer, &mut work.scratch);
    }

    /// X[k] = sum over n of x[n] cos(pi k (2n + 1) / 2N), for both of the two `lines`.
    fn forward(&self, lines: &mut [f32], work: &mut Work) {
        let (a, b) = lines.split_at_mut(N);
        // Even elements in order, then odd ones in reverse.
        work.buffer.clear();
        let pairs = || a.chunks_exact(2).zip(b.chunks_exact(2));
        work.buffer.extend(pairs().map(|(a, b)| Complex::new(a[0], b[0])));
        work.buffer.extend(pairs().rev().map(|(a, b)| Complex::new(a[1], b[1])));
        Self::run(&*self.fft, work);
        let z = &work.buffer;
        (a[0], b[0]) = (z[0].re, z[0].im);
        // The spectra of real lines are conjugate symmetric: sum and difference separate the two.
        let mirrored = z[1..].iter().zip(z[1..].iter().rev()).zip(&self.twiddles[1..]);
        for ((a, b), ((p, q), turn)) in a[1..].iter_mut().zip(&mut b[1..]).zip(mirrored) {
            *a = (p.re + q.re) * turn.re - (p.im - q.im) * turn.im;
            *b = (p.im + q.im) * turn.re + (p.re - q.re) * turn.im;
        }
    }

    /// x[n] = X[0] / 2 + sum over k > 0 of X[k] cos(pi k (2n + 1) / 2N), for both of the two `lines`.
    fn backward(&self, lines: &mut [f32], work: &mut Work) {
        let (a, b) = lines.split_at_mut(N);
        work.buffer.clear();
        work.buffer.push(Complex::new(0.5 * a[0], 0.5 * b[0]));
        // (A[k] - i A[N - k]) conj(turn) of both lines, the second times i.
        let (ends_a, ends_b) = (a[1..].iter().zip(a[1..].iter().rev()), b[1..].iter().zip(b[1..].iter().rev()));
        work.buffer.extend(ends_a.zip(ends_b).zip(&self.twiddles[1..]).map(|(((a, far_a), (b, far_b)), turn)| {
            let (re, im) = (a + far_b, b - far_a);
            Complex::new(re * turn.re + im * turn.im, im * turn.re - re * turn.im)
        }));
        Self::run(&*self.inverse, work);
        let (even, odd) = work.buffer.split_at(N / 2);
        let pairs = a.chunks_exact_mut(2).zip(b.chunks_exact_mut(2)).zip(even.iter().zip(odd.iter().rev()));
        for ((a, b), (even, odd)) in pairs {
            (a[0], a[1]) = (even.re, odd.re);
            (b[0], b[1]) = (even.im, odd.im);
        }
    }
}

/// Transposes in tiles that fit into the cache.
fn transpose(from: &[f32], to: &mut [f32]) {
    const TILE: usize = 16;
    for row0 in (0..N).step_by(TILE) {
        for column0 in (0..N).step_by(TILE) {
            for row in row0..row0 + TILE {
                for column in column0..column0 + TILE {
                    to[column * N + row] = from[row * N + column];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solves from analytic gradients and returns the largest error against `h` after removing the mean, and the range of h.
    fn recover(h: impl Fn(f64, f64) -> (f64, f64, f64), w: f64, height: f64) -> (f64, f64) {
        let (dx, dy) = (w / N as f64, height / N as f64);
        let (mut truth, mut gx, mut gy) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..N {
            for column in 0..N {
                let (x, y) = ((column as f64 + 0.5) * dx - 0.5 * w, 0.5 * height - (row as f64 + 0.5) * dy);
                let (value, a, b) = h(x, y);
                truth.push(value);
                gx.push(a as f32);
                gy.push(b as f32);
            }
        }
        let found = PoissonSolver::new().solve(&gx, &gy, (dx, dy));
        let mean = truth.iter().sum::<f64>() / PIXELS as f64;
        let error = truth.iter().zip(&found).map(|(t, f)| (t - mean - f64::from(*f)).abs()).fold(0.0, f64::max);
        let (low, high) = truth.iter().fold((f64::MAX, f64::MIN), |(low, high), &t| (low.min(t), high.max(t)));
        (error, high - low)
    }

    #[test]
    fn recovers_gaussian() {
        let (s, a) = (0.003, 0.001);
        let (error, range) = recover(
            |x, y| {
                let h = a * (-((x - 0.002).powi(2) + (y + 0.004).powi(2)) / (2.0 * s * s)).exp();
                (h, -h * (x - 0.002) / (s * s), -h * (y + 0.004) / (s * s))
            },
            0.020,
            0.033,
        );
        assert!(error < 2e-3 * range, "{error} of {range}");
    }

    /// A plane across the whole image: the boundary conditions must not flatten it.
    #[test]
    fn recovers_tilted_plane() {
        let (error, range) = recover(|x, y| (0.05 * x - 0.08 * y, 0.05, -0.08), 0.025, 0.045);
        assert!(error < 1e-4 * range, "{error} of {range}");
    }

    #[test]
    fn recovers_tilted_paraboloid() {
        let k = 60.0;
        let (error, range) =
            recover(|x, y| (k * x * x + 0.3 * k * y * y + 0.1 * x, 2.0 * k * x + 0.1, 0.6 * k * y), 0.029, 0.048);
        assert!(error < 1e-3 * range, "{error} of {range}");
    }

    /// A cap with a sharp rim, like a ball's: the slope is discontinuous there, so the error is up to one pixel times the
    /// jump.
    #[test]
    fn recovers_paraboloid_cap() {
        let (error, range) = recover(
            |x, y| {
                let h = 0.001 - 100.0 * (x * x + y * y);
                if h > 0.0 { (h, -200.0 * x, -200.0 * y) } else { (0.0, 0.0, 0.0) }
            },
            0.020,
            0.033,
        );
        assert!(error < 0.02 * range, "{error} of {range}");
    }
}
