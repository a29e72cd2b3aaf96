//! Gradient field to height map: a least-squares Poisson solver by discrete cosine transform.
//!
//! It finds the `h` that minimises the sum of squares of (h[i+1] - h[i])/d - g, with g the mean gradient of the two pixels,
//! along both axes, with pixels that need not be square. Nothing is assumed at the border (natural, i.e. Neumann conditions).

use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};

use crate::IMAGE_SIZE as N;
use crate::PIXELS;

/// A planned solver; cheap to clone, shared between threads.
#[derive(Clone)]
pub struct PoissonSolver {
    dct: Arc<dyn TransformType2And3<f32>>,
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
            dct: DctPlanner::new().plan_dct2(N),
            eigenvalues: (0..N)
                .map(|k| (2.0 * (std::f64::consts::PI * k as f64 / N as f64).cos() - 2.0) as f32)
                .collect(),
        }
    }

    /// Height (m, of zero mean) from gradients `gx` = dh/dx and `gy` = dh/dy in the pad frame (y against the row order), with
    /// pixels of `dx` by `dy` m.
    ///
    /// # Panics
    /// If a field has not [`PIXELS`] elements.
    pub fn solve(&self, gx: &[f32], gy: &[f32], (dx, dy): (f64, f64)) -> Vec<f32> {
        assert!(gx.len() == PIXELS && gy.len() == PIXELS, "fields of {PIXELS} pixels");
        let (dx, dy) = (dx as f32, dy as f32);
        // Divergence, times dx^2: half-pixel gradients are means of neighbours.
        let mut field = vec![0.0f32; PIXELS];
        let (ax, ay) = (0.5 * dx, -0.5 * dx * dx / dy);
        for row in 0..N {
            let line = row * N;
            for i in line..line + N - 1 {
                let flux = ax * (gx[i] + gx[i + 1]);
                field[i] += flux;
                field[i + 1] -= flux;
            }
            if row + 1 < N {
                for i in line..line + N {
                    let flux = ay * (gy[i] + gy[i + N]);
                    field[i] += flux;
                    field[i + N] -= flux;
                }
            }
        }
        let mut scratch = vec![0.0f32; self.dct.get_scratch_len()];
        let mut turned = vec![0.0f32; PIXELS];
        let is_zero = |line: &[f32]| line.iter().all(|&value| value == 0.0);
        for line in field.chunks_exact_mut(N).filter(|line| !is_zero(line)) {
            self.dct.process_dct2_with_scratch(line, &mut scratch);
        }
        transpose(&field, &mut turned);
        let aspect = (dx / dy) * (dx / dy);
        let scale = 4.0 / (N * N) as f32;
        for (k, line) in turned.chunks_exact_mut(N).enumerate() {
            self.dct.process_dct2_with_scratch(line, &mut scratch);
            for (l, value) in line.iter_mut().enumerate() {
                let eigenvalue = self.eigenvalues[k] + aspect * self.eigenvalues[l];
                *value = if k + l == 0 { 0.0 } else { *value * scale / eigenvalue };
            }
            self.dct.process_dct3_with_scratch(line, &mut scratch);
        }
        transpose(&turned, &mut field);
        for line in field.chunks_exact_mut(N) {
            self.dct.process_dct3_with_scratch(line, &mut scratch);
        }
        field
    }
}

/// Transposes in tiles, which stay in the cache.
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

    /// A plane rises across the whole image: no border condition may flatten it.
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

    /// A cap with a sharp rim, as a ball leaves it: the slope jumps, so that the error is bounded by a pixel's worth of it.
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

    /// Two milliseconds are the budget; the bound leaves room for a busy machine.
    #[test]
    fn solves_within_time() {
        let solver = PoissonSolver::new();
        let g: Vec<f32> = (0..PIXELS).map(|i| ((i * 7919) % 101) as f32 * 1e-3).collect();
        let mut best = f64::MAX;
        for _ in 0..20 {
            let start = std::time::Instant::now();
            std::hint::black_box(solver.solve(&g, &g, (1e-4, 1.4e-4)));
            best = best.min(start.elapsed().as_secs_f64());
        }
        println!("poisson {:.3} ms", best * 1e3);
        if !cfg!(debug_assertions) {
            assert!(best < 0.004, "{best} s");
        }
    }
}
