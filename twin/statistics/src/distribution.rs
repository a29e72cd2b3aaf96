//! Means, percentiles, box plots and densities of samples.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Mean and sample standard deviation (n - 1).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct MeanSd {
    /// Mean; none if there are no values.
    pub mean: Option<f64>,
    /// Standard deviation; none if there are fewer than two values.
    pub sd: Option<f64>,
}

impl MeanSd {
    /// Computes mean and standard deviation of a sample.
    pub fn from_values(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = (!values.is_empty()).then(|| values.iter().sum::<f64>() / n);
        let sd = mean
            .filter(|_| values.len() > 1)
            .map(|mean| (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt());
        Self { mean, sd }
    }
}

/// Returns the `percent`-th percentile by linear interpolation between neighbours (NumPy's default); none if there are
/// no values. NaNs are ignored.
pub fn percentile(values: &[f64], percent: f64) -> Option<f64> {
    percentile_of_sorted(&sorted(values), percent)
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

fn percentile_of_sorted(sorted: &[f64], percent: f64) -> Option<f64> {
    let rank = (percent / 100.0).clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    let below = rank.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    let part = rank - below as f64;
    // Equal neighbours may be infinite, so their difference is not computed.
    Some(if part == 0.0 { sorted[below] } else { sorted[below] + (sorted[above] - sorted[below]) * part })
}

/// Tukey's box plot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxPlot {
    /// Lowest value within 1.5 interquartile ranges of the box.
    pub low: f64,
    /// First quartile.
    pub q1: f64,
    pub median: f64,
    /// Third quartile.
    pub q3: f64,
    /// Highest value within 1.5 interquartile ranges of the box.
    pub high: f64,
    /// Values beyond the whiskers, in rising order.
    pub outliers: Vec<f64>,
}

/// Computes the box plot of a sample; none if there are no values.
pub fn box_plot(values: &[f64]) -> Option<BoxPlot> {
    let sorted = sorted(values);
    let quartile = |percent: f64| percentile_of_sorted(&sorted, percent);
    let (q1, median, q3) = (quartile(25.0)?, quartile(50.0)?, quartile(75.0)?);
    let reach = 1.5 * (q3 - q1);
    let (inside, outliers): (Vec<f64>, Vec<f64>) =
        sorted.iter().partition(|&&value| value >= q1 - reach && value <= q3 + reach);
    Some(BoxPlot { low: *inside.first()?, q1, median, q3, high: *inside.last()?, outliers })
}

/// Returns the bandwidth of a Gaussian kernel by Silverman's rule, in the values' unit. It is at least `floor`, which
/// constant samples need.
pub fn silverman_bandwidth(values: &[f64], floor: f64) -> f64 {
    let sorted = sorted(values);
    let sd = MeanSd::from_values(&sorted).sd.unwrap_or(0.0);
    let quartile = |percent: f64| percentile_of_sorted(&sorted, percent).unwrap_or(0.0);
    let range = (quartile(75.0) - quartile(25.0)) / 1.34;
    let spread = if range > 0.0 { sd.min(range) } else { sd };
    (0.9 * spread * (sorted.len().max(1) as f64).powf(-0.2)).max(floor)
}

/// Computes the Gaussian kernel density of a sample at each of `at`; its integral is 1. Returns zeros if there are no
/// values.
pub fn density(values: &[f64], bandwidth: f64, at: &[f64]) -> Vec<f64> {
    let scale = (bandwidth * (std::f64::consts::TAU).sqrt() * values.len().max(1) as f64).recip();
    let kernel = |x: f64, value: f64| (-0.5 * ((x - value) / bandwidth).powi(2)).exp();
    at.iter().map(|&x| scale * values.iter().map(|&value| kernel(x, value)).sum::<f64>()).collect()
}
