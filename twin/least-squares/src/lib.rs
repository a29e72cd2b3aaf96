//! Nonlinear least squares: Levenberg-Marquardt with bounds and a robust loss.
//!
//! Minimises `sum rho(r_i(p))` with the pseudo-Huber loss `rho(r) = 2 s^2 (sqrt(1 + (r/s)^2) - 1)` by iteratively
//! re-weighted least squares. The loss is quadratic for residuals well below the scale s and linear well above it. A
//! parameter on a bound whose descent direction points out of the bounds is held for that step; steps are clipped to
//! the bounds.
//!
//! [`FitProblem`] holds residuals, Jacobian and bounds, [`FitProblem::minimise`] searches under [`SolverOptions`], and
//! [`FitResult`] states parameters and their standard deviations. [`forward_differences`] computes a Jacobian where
//! none is known in closed form. The crate has no units of its own: residuals and parameters are those of the caller.
//! For the loss to make sense, all residuals should be of one kind, or divided by their standard deviations.
//!
//! # Example
//! ```
//! use ftac_least_squares::{FitProblem, SolverOptions, forward_differences};
//!
//! // y = a exp(b x) at nine points, one of them an outlier.
//! let mut data: Vec<(f64, f64)> = (0..9).map(|i| f64::from(i) * 0.25).map(|x| (x, 2.0 * (-0.8 * x).exp())).collect();
//! data[4].1 += 5.0;
//! let residuals = |p: &[f64]| -> Vec<f64> { data.iter().map(|(x, y)| p[0] * (p[1] * x).exp() - y).collect() };
//! let bounds = vec![(0.0, 10.0), (-5.0, 0.0)];
//! let problem = FitProblem {
//!     residuals,
//!     jacobian: |p: &[f64], r: &[f64]| forward_differences(p, r, &[(0.0, 10.0), (-5.0, 0.0)], 1e-7, |q, _| residuals(q)),
//!     bounds,
//!     groups: Vec::new(),
//! };
//!
//! let options = SolverOptions { max_steps: 200, scale: 0.01, tolerance: 1e-12 };
//! let fit = problem.minimise(&[1.0, -0.1], &options);
//! assert!((fit.parameters[0] - 2.0).abs() < 0.02 && (fit.parameters[1] + 0.8).abs() < 0.02);
//! ```
//!
//! # Features
//! Both are off by default:
//! - `serde`: [`FittedParameter`] can be serialized.
//! - `schemars`: it has a JSON schema as well.

#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(missing_docs, unreachable_pub)]

use nalgebra::{DMatrix, DVector};

/// Vectors and matrices of this crate's interface.
pub use nalgebra;

/// Termination criteria and outlier scale.
///
/// ```
/// use ftac_least_squares::SolverOptions;
///
/// // A scale far above all residuals makes the loss quadratic: ordinary least squares.
/// let ordinary = SolverOptions { max_steps: 100, scale: 1e6, tolerance: 1e-12 };
/// # assert!(ordinary.scale > 1e5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverOptions {
    /// Greatest number of steps.
    pub max_steps: usize,
    /// Scale s of the loss, in units of the residuals.
    pub scale: f64,
    /// Relative decrease of the cost in a step below which the search stops.
    pub tolerance: f64,
}

/// Result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct FitResult {
    /// Parameters with the smallest cost found.
    pub parameters: Vec<f64>,
    /// Sum of the losses.
    pub cost: f64,
    /// Number of steps taken.
    pub steps: usize,
    /// Standard deviation of each parameter; `None` if it is on a bound or the data do not determine it.
    pub deviations: Vec<Option<f64>>,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct FittedParameter {
    /// Name with unit.
    pub name: String,
    /// Value at the end of the search.
    pub value: f64,
    /// Standard deviation, accounting for correlated errors within a group; `None` if the value is on a bound or the
    /// data do not determine it.
    pub deviation: Option<f64>,
    /// True if the value is on a bound of the search.
    pub on_bound: bool,
}

impl FitResult {
    /// Describes the first parameters, as many as there are `names`; `bounds` are those of the search.
    ///
    /// # Panics
    /// If there are more names than parameters or bounds.
    ///
    /// ```
    /// use ftac_least_squares::FitResult;
    ///
    /// let fit = FitResult { parameters: vec![0.5, 1.0], cost: 0.1, steps: 7, deviations: vec![Some(0.02), None] };
    /// let names = ["friction", "gain"].map(str::to_owned);
    /// let described = fit.describe_parameters(names, &[(0.0, 2.0), (0.0, 1.0)]);
    /// assert!(!described[0].on_bound && described[1].on_bound);
    /// ```
    pub fn describe_parameters(
        &self,
        names: impl IntoIterator<Item = String>,
        bounds: &[(f64, f64)],
    ) -> Vec<FittedParameter> {
        let describe = |(i, name): (usize, String)| {
            let ((low, high), value) = (bounds[i], self.parameters[i]);
            let near = 1e-6 * (high - low);
            let on_bound = value <= low + near || value >= high - near;
            FittedParameter { name, value, deviation: self.deviations[i], on_bound }
        };
        names.into_iter().enumerate().map(describe).collect()
    }
}

/// Residuals and their Jacobian (one row per residual, one column per parameter).
///
/// ```
/// use ftac_least_squares::nalgebra::DMatrix;
/// use ftac_least_squares::{FitProblem, SolverOptions};
///
/// // A line through points, with its Jacobian in closed form; the slope is bounded.
/// let data = [(0.0, 1.0), (1.0, 3.1), (2.0, 4.9)];
/// let problem = FitProblem {
///     residuals: |p: &[f64]| data.iter().map(|(x, y)| p[0] * x + p[1] - y).collect(),
///     jacobian: |_: &[f64], r: &[f64]| DMatrix::from_fn(r.len(), 2, |row, column| [data[row].0, 1.0][column]),
///     bounds: vec![(0.0, 1.5), (-10.0, 10.0)],
///     groups: Vec::new(),
/// };
/// let fit = problem.minimise(&[0.0, 0.0], &SolverOptions { max_steps: 50, scale: 1e6, tolerance: 1e-14 });
/// // On its bound, the slope has no standard deviation.
/// assert!((fit.parameters[0] - 1.5).abs() < 1e-9 && fit.deviations[0].is_none() && fit.deviations[1].is_some());
/// ```
pub struct FitProblem<R, J> {
    /// Residual function `r(p)`.
    pub residuals: R,
    /// Jacobian `dr/dp` as a function of p and `r(p)`.
    pub jacobian: J,
    /// Lower and upper bound of each parameter.
    pub bounds: Vec<(f64, f64)>,
    /// Index of the first residual of each group within which errors may be correlated (all pixels of one image); the
    /// standard deviations account for that. Empty if all residuals are independent.
    pub groups: Vec<usize>,
}

impl<R, J> std::fmt::Debug for FitProblem<R, J> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FitProblem").field("bounds", &self.bounds).field("groups", &self.groups).finish_non_exhaustive()
    }
}

impl<R, J> FitProblem<R, J>
where
    R: Fn(&[f64]) -> Vec<f64>,
    J: Fn(&[f64], &[f64]) -> DMatrix<f64>,
{
    /// Searches from `start`, clipped to the bounds.
    ///
    /// # Panics
    /// If `start` and the bounds have different lengths, a lower bound is above its upper bound or not a number, or the
    /// Jacobian has another shape than residuals by parameters.
    pub fn minimise(&self, start: &[f64], options: &SolverOptions) -> FitResult {
        let mut p: Vec<f64> = start.iter().zip(&self.bounds).map(|(p, (low, high))| p.clamp(*low, *high)).collect();
        let mut residuals = (self.residuals)(&p);
        let mut cost = loss(&residuals, options.scale);
        let mut damping = 1e-3;
        let mut steps = 0;
        'search: while steps < options.max_steps {
            let jacobian = (self.jacobian)(&p, &residuals);
            let (normal, gradient) = weighted(&jacobian, &residuals, options.scale);
            let free: Vec<usize> = (0..p.len()).filter(|&i| !self.is_held_on_bound(i, p[i], gradient[i])).collect();
            loop {
                let Some(step) = damped_step(&normal, &gradient, &free, damping) else { break 'search };
                let mut next = p.clone();
                for (&i, step) in free.iter().zip(step.iter()) {
                    next[i] = (p[i] + step).clamp(self.bounds[i].0, self.bounds[i].1);
                }
                let trial = (self.residuals)(&next);
                let found = loss(&trial, options.scale);
                if found < cost {
                    let gain = (cost - found) / cost.max(f64::MIN_POSITIVE);
                    (p, residuals, cost) = (next, trial, found);
                    damping = (damping * 0.2).max(1e-12);
                    steps += 1;
                    if gain < options.tolerance {
                        break 'search;
                    }
                    break;
                }
                damping *= 6.0;
                if damping > 1e9 {
                    break 'search;
                }
            }
        }
        let deviations = self.deviations(&p, &residuals, options.scale);
        FitResult { parameters: p, cost, steps, deviations }
    }

    /// True if a parameter is on a bound and the descent direction points out of the bounds.
    fn is_held_on_bound(&self, index: usize, value: f64, gradient: f64) -> bool {
        let (low, high) = self.bounds[index];
        let near = 1e-9 * (high - low);
        low == high || (value <= low + near && gradient > 0.0) || (value >= high - near && gradient < 0.0)
    }

    /// Computes standard deviations from the sandwich `A^-1 B A^-1`. A is the weighted normal matrix; B is the scatter
    /// of the groups' gradients, which is `A` times the variance if every residual is its own group. Parameters on a
    /// bound are left out.
    fn deviations(&self, p: &[f64], residuals: &[f64], scale: f64) -> Vec<Option<f64>> {
        let jacobian = (self.jacobian)(p, residuals);
        let (normal, _) = weighted(&jacobian, residuals, scale);
        let free: Vec<usize> = (0..p.len())
            .filter(|&i| {
                let (low, high) = self.bounds[i];
                let near = 1e-6 * (high - low);
                p[i] > low + near && p[i] < high - near
            })
            .collect();
        let mut deviations = vec![None; p.len()];
        // Scaled to a unit diagonal, so that the threshold for "not determined" is dimensionless.
        let unit: Vec<f64> = free.iter().map(|&i| normal[(i, i)].sqrt().max(f64::MIN_POSITIVE)).collect();
        let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| normal[(free[i], free[j])] / unit[i] / unit[j]);
        let eigen = scaled.symmetric_eigen();
        let inverse = |i: usize, j: usize| -> f64 {
            (0..free.len())
                .filter(|&k| eigen.eigenvalues[k] > 1e-9)
                .map(|k| eigen.eigenvectors[(i, k)] * eigen.eigenvectors[(j, k)] / eigen.eigenvalues[k])
                .sum()
        };
        let inverse = DMatrix::from_fn(free.len(), free.len(), inverse);
        let undetermined = |i: usize| -> f64 {
            (0..free.len()).filter(|&k| eigen.eigenvalues[k] <= 1e-9).map(|k| eigen.eigenvectors[(i, k)].powi(2)).sum()
        };
        let scatter = self.gradient_scatter(&jacobian, residuals, scale, &free, &unit);
        let covariance = &inverse * scatter * &inverse;
        for (at, &i) in free.iter().enumerate() {
            if undetermined(at) < 0.01 {
                deviations[i] = Some(covariance[(at, at)].max(0.0).sqrt() / unit[at]);
            }
        }
        deviations
    }

    fn gradient_scatter(
        &self,
        jacobian: &DMatrix<f64>,
        residuals: &[f64],
        scale: f64,
        free: &[usize],
        unit: &[f64],
    ) -> DMatrix<f64> {
        let own: Vec<usize>;
        let starts = if self.groups.is_empty() {
            own = (0..residuals.len()).collect();
            &own
        } else {
            &self.groups
        };
        let mut scatter = DMatrix::zeros(free.len(), free.len());
        for (g, &start) in starts.iter().enumerate() {
            let end = starts.get(g + 1).copied().unwrap_or(residuals.len());
            let gradient = DVector::from_iterator(
                free.len(),
                free.iter().zip(unit).map(|(&i, unit)| {
                    (start..end).map(|r| weight(residuals[r], scale) * residuals[r] * jacobian[(r, i)]).sum::<f64>()
                        / unit
                }),
            );
            scatter.ger(1.0, &gradient, &gradient, 1.0);
        }
        scatter
    }
}

/// Computes the Jacobian by forward differences: parameter j is moved by `step` times the distance between its bounds,
/// towards the inside. `moved` computes the residuals at the parameters that it is given; its second argument is j.
/// Columns of parameters whose bounds coincide are zero.
///
/// ```
/// use ftac_least_squares::forward_differences;
///
/// let residuals = |p: &[f64]| vec![p[0] * p[0], p[0] * p[1]];
/// let p = [3.0, 2.0];
/// let jacobian = forward_differences(&p, &residuals(&p), &[(0.0, 10.0); 2], 1e-7, |q, _| residuals(q));
/// assert!((jacobian[(0, 0)] - 6.0).abs() < 1e-4 && (jacobian[(1, 1)] - 3.0).abs() < 1e-4);
/// ```
pub fn forward_differences(
    p: &[f64],
    at_p: &[f64],
    bounds: &[(f64, f64)],
    step: f64,
    mut moved: impl FnMut(&[f64], usize) -> Vec<f64>,
) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(at_p.len(), p.len());
    let mut q = p.to_vec();
    for (j, (low, high)) in bounds.iter().enumerate() {
        let span = high - low;
        if span <= 0.0 {
            continue;
        }
        let h = if p[j] + step * span <= *high { step * span } else { -step * span };
        q[j] = p[j] + h;
        let residuals = moved(&q, j);
        q[j] = p[j];
        for ((slot, moved), at) in jacobian.column_mut(j).iter_mut().zip(residuals).zip(at_p) {
            *slot = (moved - at) / h;
        }
    }
    jacobian
}

fn loss(residuals: &[f64], scale: f64) -> f64 {
    let square = scale * scale;
    // Equal to the formula above, but without its cancellation for small residuals.
    residuals.iter().map(|r| 2.0 * r * r / ((1.0 + r * r / square).sqrt() + 1.0)).sum()
}

fn weight(residual: f64, scale: f64) -> f64 {
    1.0 / (1.0 + (residual / scale).powi(2)).sqrt()
}

/// Returns `J^T W J` and `J^T W r`.
fn weighted(jacobian: &DMatrix<f64>, residuals: &[f64], scale: f64) -> (DMatrix<f64>, DVector<f64>) {
    let weights: Vec<f64> = residuals.iter().map(|&r| weight(r, scale)).collect();
    let mut heavy = jacobian.clone();
    for mut column in heavy.column_iter_mut() {
        column.iter_mut().zip(&weights).for_each(|(value, weight)| *value *= weight);
    }
    let normal = heavy.tr_mul(jacobian);
    let gradient = heavy.tr_mul(&DVector::from_column_slice(residuals));
    (normal, gradient)
}

/// Solves `(A + damping diag A) step = -g` over the free parameters.
fn damped_step(normal: &DMatrix<f64>, gradient: &DVector<f64>, free: &[usize], damping: f64) -> Option<DVector<f64>> {
    if free.is_empty() {
        return None;
    }
    let largest = free.iter().map(|&i| normal[(i, i)]).fold(0.0, f64::max);
    let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        let value = normal[(free[i], free[j])];
        if i == j { value + damping * value.max(1e-12 * largest) } else { value }
    });
    let right = DVector::from_iterator(free.len(), free.iter().map(|&i| -gradient[i]));
    let step = matrix.cholesky()?.solve(&right);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    use super::*;

    fn numeric(
        bounds: Vec<(f64, f64)>,
        f: impl Fn(&[f64]) -> Vec<f64> + Clone,
        start: &[f64],
        scale: f64,
    ) -> FitResult {
        let (again, limits) = (f.clone(), bounds.clone());
        let jacobian = move |p: &[f64], r: &[f64]| forward_differences(p, r, &limits, 1e-7, |q, _| again(q));
        let problem = FitProblem { residuals: f, jacobian, bounds, groups: Vec::new() };
        problem.minimise(start, &SolverOptions { max_steps: 200, scale, tolerance: 1e-14 })
    }

    #[test]
    fn rosenbrocks_valley() {
        let valley = |p: &[f64]| vec![1.0 - p[0], 10.0 * (p[1] - p[0] * p[0])];
        let found = numeric(vec![(-5.0, 5.0); 2], valley, &[-1.2, 1.0], 1e6);
        assert!((found.parameters[0] - 1.0).abs() < 1e-4 && (found.parameters[1] - 1.0).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn a_bound_holds() {
        let valley = |p: &[f64]| vec![1.0 - p[0], 10.0 * (p[1] - p[0] * p[0])];
        let found = numeric(vec![(-5.0, 0.5), (-5.0, 5.0)], valley, &[-1.2, 1.0], 1e6);
        assert!((found.parameters[0] - 0.5).abs() < 1e-9 && (found.parameters[1] - 0.25).abs() < 1e-4, "{found:?}");
        assert_eq!(found.deviations[0], None);
    }

    #[test]
    fn outliers_pull_little_and_deviations_are_those_of_a_line() {
        // y = 2 x + 1 with alternating errors of 0.1, and one point far off.
        let data: Vec<(f64, f64)> = (0..100)
            .map(|i| (f64::from(i) / 100.0, i))
            .map(|(x, i)| (x, 2.0 * x + 1.0 + if i % 2 == 0 { 0.1 } else { -0.1 }))
            .collect();
        let line = |data: Vec<(f64, f64)>| move |p: &[f64]| data.iter().map(|(x, y)| p[0] * x + p[1] - y).collect();
        let clean = numeric(vec![(-10.0, 10.0); 2], line(data.clone()), &[0.0, 0.0], 1e6);
        let middle: f64 = data.iter().map(|(x, _)| x).sum::<f64>() / 100.0;
        let spread: f64 = data.iter().map(|(x, _)| (x - middle).powi(2)).sum();
        let expected = 0.1 / spread.sqrt();
        assert!((clean.deviations[0].unwrap() / expected - 1.0).abs() < 0.05, "{clean:?} {expected}");
        let mut spoilt = data;
        spoilt[50].1 = 1000.0;
        let robust = numeric(vec![(-10.0, 10.0); 2], line(spoilt), &[0.0, 0.0], 0.2);
        assert!((robust.parameters[0] - 2.0).abs() < 0.05 && (robust.parameters[1] - 1.0).abs() < 0.05, "{robust:?}");
    }

    #[test]
    fn undetermined_parameters_have_no_deviation() {
        let sum = |p: &[f64]| vec![p[0] + p[1] - 1.0, 2.0 * (p[0] + p[1]) - 2.1];
        let found = numeric(vec![(-5.0, 5.0); 2], sum, &[0.3, 0.1], 1e6);
        assert_eq!(found.deviations, vec![None, None]);
    }
}
