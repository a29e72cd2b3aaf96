//! How surely a fit's parameters are known, in spite of what the fit does not search.
//!
//! The covariance of least squares takes all else to be as drawn. What is not searched is not: it spreads, too, and an estimate pays for it.
//! Such quantities are those that estimation calls considered (S. F. Schmidt, 1966): each moves the estimate by what the fit would make of
//! its effect, and counts with its spread.

use nalgebra::{DMatrix, DVector};

/// Below this share of its spread a parameter's standard deviation says that the session taught something.
pub const TAUGHT: f64 = 0.8;

/// Rows of a fit's slopes with their residuals.
pub type Piece = Vec<(usize, f64)>;

/// Covariance of the parameters of a fit whose residuals have these `slopes` at its minimum: a row a residual, the prior's last, a column a
/// parameter. `unsearched` has the changes of the samples' residuals, a column a quantity, by its spread. `clusters` are the samples' residuals
/// in pieces that err alike, as what the model leaves out is alike within them: where their gradients scatter by more than independent
/// samples' would, deviations are wider by that (the sandwich of Liang and Zeger 1986).
pub fn covariance(slopes: &DMatrix<f64>, unsearched: &DMatrix<f64>, clusters: &[Piece]) -> DMatrix<f64> {
    let n = slopes.ncols();
    // Positive definite: the prior's rows are a unit matrix.
    let known = slopes.tr_mul(slopes).cholesky().map_or_else(|| DMatrix::identity(n, n), |found| found.inverse());
    let widened = match clusters.len() {
        0 | 1 => known.clone(),
        count => {
            let mut scatter = DMatrix::zeros(n, n);
            for cluster in clusters {
                let gradient = cluster
                    .iter()
                    .fold(DVector::zeros(n), |sum, (row, residual)| sum + slopes.row(*row).transpose() * *residual);
                scatter += &gradient * gradient.transpose();
            }
            let sandwich = &known * scatter * &known * (count as f64 / (count - 1) as f64);
            let wider = |i: usize| (sandwich[(i, i)] / known[(i, i)]).max(1.0).sqrt();
            DMatrix::from_fn(n, n, |i, j| known[(i, j)] * wider(i) * wider(j))
        }
    };
    let moved = &known * slopes.rows(0, unsearched.nrows()).tr_mul(unsearched);
    widened + &moved * moved.transpose()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;

    /// Samples of the line; noise on each has a standard deviation of one.
    const SAMPLES: usize = 50;

    fn x(n: usize) -> f64 {
        (n as f64 + 0.5) / SAMPLES as f64
    }

    /// A line through the origin is fitted to samples whose other term, a square, nobody searches.
    fn line() -> (DMatrix<f64>, DMatrix<f64>) {
        let slopes = DMatrix::from_fn(SAMPLES + 1, 1, |n, _| if n < SAMPLES { x(n) } else { 1.0 });
        (slopes, DMatrix::from_fn(SAMPLES, 1, |n, _| x(n).powi(2)))
    }

    /// Of mean zero and variance one, nearly normal.
    fn normal(rng: &mut rand_chacha::ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random_range(-0.5..0.5)).sum()
    }

    #[test]
    fn what_is_not_searched_adds_what_it_moves() {
        let (slopes, square) = line();
        let information: f64 = 1.0 + (0..SAMPLES).map(|n| x(n).powi(2)).sum::<f64>();
        let moved = (0..SAMPLES).map(|n| x(n).powi(3)).sum::<f64>() / information;
        let found = covariance(&slopes, &square, &[])[(0, 0)];
        assert!((found - (1.0 / information + moved * moved)).abs() < 1e-12, "{found}");
        let alone = covariance(&slopes, &DMatrix::zeros(SAMPLES, 0), &[])[(0, 0)];
        assert!((alone - 1.0 / information).abs() < 1e-12, "{alone}");
    }

    /// Of 4000 lines 95 % have their slope in its interval, and far fewer in that of a fit which takes its model to be true.
    #[test]
    fn intervals_hold_in_spite_of_what_is_not_searched() {
        let (slopes, square) = line();
        let none = DMatrix::zeros(SAMPLES, 0);
        let half = [&square, &none].map(|unsearched| 1.959_964 * covariance(&slopes, unsearched, &[])[(0, 0)].sqrt());
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut inside = [0; 2];
        for _ in 0..4000 {
            let [slope, other] = [(); 2].map(|()| normal(&mut rng));
            let sample = |n: usize| (slope * x(n) + other * x(n).powi(2) + normal(&mut rng)) * x(n);
            let found = (0..SAMPLES).map(sample).sum::<f64>() / slopes.tr_mul(&slopes)[(0, 0)];
            for (inside, half) in inside.iter_mut().zip(half) {
                *inside += usize::from((found - slope).abs() < half);
            }
        }
        let [considered, plain] = inside.map(|inside| f64::from(inside as u32) / 4000.0);
        assert!((considered - 0.95).abs() < 0.015, "{considered}");
        assert!(plain < 0.6, "{plain}");
    }

    /// Samples of a piece that are off together widen the interval; the same errors spread evenly do not.
    #[test]
    fn pieces_that_err_alike_widen_an_interval() {
        let (slopes, _) = line();
        let none = DMatrix::zeros(SAMPLES, 0);
        let pieces = |residual: fn(usize) -> f64| -> Vec<Piece> {
            (0..5).map(|piece| (0..10).map(|n| (10 * piece + n, residual(10 * piece + n))).collect()).collect()
        };
        let alone = covariance(&slopes, &none, &[])[(0, 0)];
        let together = covariance(&slopes, &none, &pieces(|n| if n / 10 % 2 == 0 { 1.0 } else { -1.0 }))[(0, 0)];
        let evenly = covariance(&slopes, &none, &pieces(|n| if n % 2 == 0 { 1.0 } else { -1.0 }))[(0, 0)];
        assert!(together > 2.0 * alone && evenly < 1.01 * alone, "{alone} {together} {evenly}");
    }
}
