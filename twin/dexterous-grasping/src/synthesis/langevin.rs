//! The Metropolis-adjusted Langevin algorithm with a diagonal preconditioner, for a density proportional to exp(-E / T).
//!
//! A proposal moves by -s2 g / (2 h) + s sqrt(T / h) z: half a Newton step down the gradient g for curvatures h, plus
//! noise scaled so that this is the Euler step of a diffusion with the desired density. The drift of each coordinate is
//! limited to a few noise widths (truncated drift, Roberts & Tweedie 1996), which keeps the chain stable at kinks of the
//! energy. The truncation is part of the proposal density, and the *proposal ratio* q(x | x') / q(x' | x) is part of the
//! acceptance; without it the samples do not follow exp(-E / T).
//!
//! For a rotation the displacement is a rotation vector in the fixed frame: the reverse move is the negated vector, and
//! the exponential map's volume factor depends on its length only, so it cancels in the ratio.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Limit of the drift, in noise widths.
const DRIFT_LIMIT: f64 = 2.0;
/// Decay of the running mean of squared gradients.
const GRADIENT_DECAY: f64 = 0.98;
/// Acceptance at which MALA mixes best in many dimensions (Roberts & Rosenthal 1998).
const TARGET_ACCEPTANCE: f64 = 0.574;

/// Step size and preconditioner of one chain.
#[derive(Debug, Clone)]
pub struct Langevin {
    /// Step s, dimensionless: near 1 if the curvatures are right.
    pub step: f64,
    /// Curvature h of each coordinate.
    pub curvature: Vec<f64>,
    /// Largest noise width at step 1: curvatures are at least temperature over its square.
    max_noise: Vec<f64>,
}

impl Langevin {
    /// Creates a kernel with the noise widths `widest`, times `step`, at `temperature`. They remain the upper limit of
    /// the noise at step 1.
    pub fn new(step: f64, widest: &[f64], temperature: f64) -> Self {
        let curvature = widest.iter().map(|width| temperature / (width * width)).collect();
        Self { step, curvature, max_noise: widest.to_vec() }
    }

    /// Returns the noise width and the drift of one coordinate.
    fn kernel(&self, n: usize, gradient: f64, temperature: f64) -> (f64, f64) {
        let width = self.step * (temperature / self.curvature[n]).sqrt();
        let drift = -0.5 * self.step * self.step * gradient / self.curvature[n];
        (width, drift.clamp(-DRIFT_LIMIT * width, DRIFT_LIMIT * width))
    }

    /// Draws a displacement at a state with `gradient`.
    pub fn propose(&self, gradient: &[f64], temperature: f64, rng: &mut impl Rng, displacement: &mut [f64]) {
        for (n, slope) in gradient.iter().enumerate() {
            let (width, drift) = self.kernel(n, *slope, temperature);
            displacement[n] = drift + width * rng.sample::<f64, _>(StandardNormal);
        }
    }

    /// Returns the logarithm of the Metropolis-Hastings ratio of moving by `displacement` from (energy, gradient)
    /// `from` to `to`.
    pub fn log_ratio(&self, from: (f64, &[f64]), to: (f64, &[f64]), displacement: &[f64], temperature: f64) -> f64 {
        let mut log = (from.0 - to.0) / temperature;
        for (n, moved) in displacement.iter().enumerate() {
            let (width, there) = self.kernel(n, from.1[n], temperature);
            let (_, back) = self.kernel(n, to.1[n], temperature);
            let (a, b) = ((moved - there) / width, (-moved - back) / width);
            log += 0.5 * (a * a - b * b);
        }
        log
    }

    /// Adapts the kernel by one step, from the current gradient and the acceptance probability of the last proposal.
    /// For burn-in only, because an adaptive kernel is not reversible.
    pub fn adapt(&mut self, gradient: &[f64], acceptance: f64, temperature: f64) {
        for (n, slope) in gradient.iter().enumerate() {
            // In a quadratic bowl of curvature h the mean squared gradient is h T.
            let seen = slope * slope / temperature;
            let flattest = temperature / (self.max_noise[n] * self.max_noise[n]);
            self.curvature[n] = (GRADIENT_DECAY * self.curvature[n] + (1.0 - GRADIENT_DECAY) * seen).max(flattest);
        }
        self.step = (self.step * (0.05 * (acceptance - TARGET_ACCEPTANCE)).exp()).clamp(1e-3, 2.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Returns the matrix A of E = x' A x / 2, which at temperature T has covariance T A^-1.
    fn bowl() -> Matrix3<f64> {
        Matrix3::new(4.0, 1.5, 0.0, 1.5, 1.0, 0.2, 0.0, 0.2, 9.0)
    }

    /// Runs a chain on the bowl and returns mean, covariance and acceptance.
    fn sample(ratio: bool, step: f64, temperature: f64, seed: u64) -> (Vector3<f64>, Matrix3<f64>, f64) {
        let matrix = bowl();
        let energy = |x: &Vector3<f64>| 0.5 * x.dot(&(matrix * x));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut kernel = Langevin::new(step, &[10.0; 3], temperature);
        kernel.curvature = vec![4.0, 1.0, 9.0];
        let (mut x, mut mean, mut second, mut accepted) = (Vector3::zeros(), Vector3::zeros(), Matrix3::zeros(), 0);
        let steps = 400_000;
        for _ in 0..steps {
            let from = matrix * x;
            let mut by = Vector3::zeros();
            kernel.propose(from.as_slice(), temperature, &mut rng, by.as_mut_slice());
            let next = x + by;
            let to = matrix * next;
            let log = if ratio {
                kernel.log_ratio(
                    (energy(&x), from.as_slice()),
                    (energy(&next), to.as_slice()),
                    by.as_slice(),
                    temperature,
                )
            } else {
                (energy(&x) - energy(&next)) / temperature
            };
            if rng.random::<f64>().ln() < log {
                x = next;
                accepted += 1;
            }
            mean += x;
            second += x * x.transpose();
        }
        let n = f64::from(steps);
        (mean / n, second / n, f64::from(accepted) / n)
    }

    /// Samples of a correlated Gaussian have its moments; without the proposal ratio, as in the published code, they do not.
    #[test]
    fn moments_of_a_correlated_gaussian() {
        let temperature = 0.7;
        let wanted = bowl().try_inverse().expect("regular") * temperature;
        let (mean, second, acceptance) = sample(true, 0.9, temperature, 3);
        assert!((0.2..0.95).contains(&acceptance), "{acceptance}");
        assert!(mean.norm() < 0.03, "{mean}");
        assert!((second - wanted).norm() < 0.03 * wanted.norm(), "{second} {wanted}");
        let (_, wrong, _) = sample(false, 0.9, temperature, 3);
        assert!((wrong - wanted).norm() > 0.15 * wanted.norm(), "{wrong} {wanted}");
    }

    /// Detailed balance: pi(x) q(y | x) a(x, y) = pi(y) q(x | y) a(y, x), that is, the log ratios of a move and of its
    /// reverse are opposite, at any step, cut drifts included.
    #[test]
    fn a_move_and_its_reverse_balance() {
        let matrix = bowl();
        let energy = |x: &Vector3<f64>| 0.5 * x.dot(&(matrix * x));
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut cut = 0;
        for _ in 0..200 {
            let kernel = Langevin::new(2.0 * rng.random::<f64>() + 0.1, &[0.7, 2.0, 0.3], 0.4);
            let mut draw = || Vector3::from_fn(|_, _| 2.0 * rng.sample::<f64, _>(StandardNormal));
            let (x, y) = (draw(), draw());
            let (gx, gy) = (matrix * x, matrix * y);
            let by = y - x;
            cut += usize::from(
                (0..3).any(|n| kernel.kernel(n, gx[n], 0.4).1.abs() > 1.99 * kernel.kernel(n, gx[n], 0.4).0),
            );
            let forth = kernel.log_ratio((energy(&x), gx.as_slice()), (energy(&y), gy.as_slice()), by.as_slice(), 0.4);
            let back =
                kernel.log_ratio((energy(&y), gy.as_slice()), (energy(&x), gx.as_slice()), (-by).as_slice(), 0.4);
            assert!((forth + back).abs() < 1e-9 * (1.0 + forth.abs()), "{forth} {back}");
        }
        assert!(cut > 20, "cut drifts are among the cases: {cut}");
    }
}
