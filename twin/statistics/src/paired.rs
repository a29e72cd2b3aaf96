//! Paired differences: effect sizes, their uncertainty, and the power of fewer pairs.

use std::collections::BTreeSet;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statrs::distribution::{Binomial, ContinuousCDF, DiscreteCDF, StudentsT};

use crate::distribution::{MeanSd, percentile};

/// Least number of independent samples for a test, an interval or a verdict. With four pairs that all differ in the
/// same direction, the sign test has p = 1/16 without any assumption on the distribution of differences: they are not
/// significant at the 5 % level.
pub const MIN_SAMPLES: usize = 5;

/// Standard deviation below which samples count as constant, because rates carry rounding errors.
pub const CONSTANT_SD_TOLERANCE: f64 = 1e-12;

/// Reason for a test without a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoTestReason {
    /// The two conditions have no combination in common.
    #[serde(alias = "not_played")]
    NotRun,
    /// There are fewer than [`MIN_SAMPLES`] pairs.
    TooFew,
    /// All differences are equal, which gives no information on the variation among combinations.
    NoSpread,
}

/// A paired, one-sided t-test.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct TTest {
    pub t: Option<f64>,
    /// Degrees of freedom: number of pairs less one.
    pub df: usize,
    /// Probability of a `t` at least this large if there were no difference.
    pub p: Option<f64>,
    /// Reason why there is neither `t` nor `p`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub untested: Option<NoTestReason>,
}

impl TTest {
    /// Returns the reason for a missing result, in words.
    pub fn reason(&self) -> Option<String> {
        let pairs = self.df + 1;
        self.untested.map(|untested| match untested {
            NoTestReason::NotRun => "not run".to_owned(),
            NoTestReason::TooFew => format!("{pairs} of at least {MIN_SAMPLES} combinations"),
            NoTestReason::NoSpread => format!("the differences of all {pairs} combinations are equal"),
        })
    }
}

/// Tests whether the first of each pair is larger than the second on average.
pub fn paired_t_test(pairs: &[(f64, f64)]) -> TTest {
    let differences: Vec<f64> = pairs.iter().map(|(a, b)| a - b).collect();
    let df = pairs.len().saturating_sub(1);
    let without = |reason: NoTestReason| TTest { df, untested: Some(reason), ..TTest::default() };
    match (pairs.len(), MeanSd::from_values(&differences)) {
        (0, _) => without(NoTestReason::NotRun),
        (MIN_SAMPLES.., MeanSd { mean: Some(mean), sd: Some(sd) }) => {
            if sd < CONSTANT_SD_TOLERANCE {
                return without(NoTestReason::NoSpread);
            }
            let t = mean / (sd / (pairs.len() as f64).sqrt());
            let p = StudentsT::new(0.0, 1.0, df as f64).ok().map(|students| students.sf(t));
            TTest { t: Some(t), df, p, untested: None }
        }
        _ => without(NoTestReason::TooFew),
    }
}

/// Number of bootstrap samples for an interval.
const RESAMPLE_COUNT: usize = 10_000;
/// Number of bootstrap samples for a power.
const POWER_RESAMPLE_COUNT: usize = 2_000;
/// Seed of the resampling, so that the same records give the same intervals.
const SEED: u64 = 0x0b00_7574_4a90;
/// Significance level.
const SIGNIFICANCE_LEVEL: f64 = 0.05;
/// Numbers of pairs for which the power is stated.
const POWER_PAIR_COUNTS: [usize; 5] = [5, 10, 20, 30, 60];

/// A value and its 95 % bootstrap interval (percentile method). There is no interval with fewer than [`MIN_SAMPLES`]
/// samples, or if all samples are equal.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ConfidenceInterval {
    /// Value of the sample itself.
    pub value: Option<f64>,
    /// 2.5th percentile over resamples.
    pub low: Option<f64>,
    /// 97.5th percentile over resamples.
    pub high: Option<f64>,
}

/// Effect size and power of a paired comparison, beyond its t-test.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct PairedDifference {
    /// Mean of the differences.
    pub difference: ConfidenceInterval,
    /// Cohen's d of paired samples: the mean of the differences divided by their standard deviation. None if the
    /// differences do not vary, or with fewer than [`MIN_SAMPLES`].
    pub d_z: ConfidenceInterval,
    /// Pairs of (number of pairs, power). The power is the probability that this many pairs, drawn from the sample,
    /// show the difference at the 5 % level in the one-sided t-test.
    pub power: Vec<(usize, f64)>,
}

impl PairedDifference {
    /// Analyses `pairs` (first, second); differences are first less second.
    pub fn from_pairs(pairs: &[(f64, f64)]) -> Self {
        let differences: Vec<f64> = pairs.iter().map(|(a, b)| a - b).collect();
        if differences.is_empty() {
            return Self::default();
        }
        let all = MeanSd::from_values(&differences);
        if differences.len() < MIN_SAMPLES || d_z(all).is_none() {
            return Self {
                difference: ConfidenceInterval { value: all.mean, ..ConfidenceInterval::default() },
                ..Self::default()
            };
        }
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let (mut means, mut ds) = (Vec::with_capacity(RESAMPLE_COUNT), Vec::with_capacity(RESAMPLE_COUNT));
        for _ in 0..RESAMPLE_COUNT {
            let sample = MeanSd::from_values(&resample(&differences, differences.len(), &mut rng));
            means.extend(sample.mean);
            ds.extend(d_z(sample));
        }
        let interval = |value: Option<f64>, resampled: &[f64]| ConfidenceInterval {
            value,
            low: percentile(resampled, 2.5).filter(|_| value.is_some()),
            high: percentile(resampled, 97.5).filter(|_| value.is_some()),
        };
        let power = POWER_PAIR_COUNTS
            .into_iter()
            .filter(|n| *n <= pairs.len())
            .map(|n| {
                let shown = (0..POWER_RESAMPLE_COUNT).filter(|_| {
                    let sample: Vec<(f64, f64)> =
                        resample(&differences, n, &mut rng).into_iter().map(|difference| (difference, 0.0)).collect();
                    paired_t_test(&sample).p.is_some_and(|p| p < SIGNIFICANCE_LEVEL)
                });
                (n, shown.count() as f64 / POWER_RESAMPLE_COUNT as f64)
            })
            .collect();
        Self { difference: interval(all.mean, &means), d_z: interval(d_z(all), &ds), power }
    }
}

fn d_z(sample: MeanSd) -> Option<f64> {
    let (mean, sd) = (sample.mean?, sample.sd?);
    (sd > CONSTANT_SD_TOLERANCE).then(|| mean / sd)
}

fn resample(values: &[f64], n: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..n).map(|_| values[rng.random_range(0..values.len())]).collect()
}

/// McNemar's exact test on pairs of outcomes, each pair belonging to one cluster.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct McNemar {
    /// Number of pairs in which both succeeded.
    pub both: usize,
    /// Number of pairs in which only the first succeeded.
    pub first_only: usize,
    /// Number of pairs in which only the second succeeded.
    pub second_only: usize,
    /// Number of pairs in which neither succeeded.
    pub neither: usize,
    /// One-sided probability of at most this many pairs won by the second only, if both were equally likely. None with
    /// fewer than [`MIN_SAMPLES`] pairs that differ, or with fewer clusters.
    pub p: Option<f64>,
}

impl McNemar {
    /// Tests pairs (cluster, success of the first, success of the second).
    pub fn from_pairs(pairs: impl IntoIterator<Item = (usize, bool, bool)>) -> Self {
        let (mut table, mut clusters) = (Self::default(), BTreeSet::new());
        for (cluster, first, second) in pairs {
            clusters.insert(cluster);
            match (first, second) {
                (true, true) => table.both += 1,
                (true, false) => table.first_only += 1,
                (false, true) => table.second_only += 1,
                (false, false) => table.neither += 1,
            }
        }
        let differ = table.first_only + table.second_only;
        let enough = differ.min(clusters.len()) >= MIN_SAMPLES;
        let either = enough.then(|| Binomial::new(0.5, differ as u64).ok()).flatten();
        table.p = either.map(|either| either.cdf(table.second_only as u64));
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten pairs differ, nine of them one way: (1 + 10) / 1024.
    #[test]
    fn mcnemar_counts_the_pairs_that_differ() {
        let outcomes = |n: usize| match n {
            0..9 => (true, false),
            9 => (false, true),
            10..15 => (true, true),
            _ => (false, false),
        };
        let pairs: Vec<_> = (0..20).map(|n| (n % 5, outcomes(n).0, outcomes(n).1)).collect();
        let table = McNemar::from_pairs(pairs.iter().copied());
        assert_eq!((table.both, table.first_only, table.second_only, table.neither), (5, 9, 1, 5));
        assert!((table.p.unwrap() - 11.0 / 1024.0).abs() < 1e-12);
        // Pairs from a single cluster, or only four that differ, are too few.
        let alike: Vec<_> = pairs.iter().map(|(_, first, second)| (0, *first, *second)).collect();
        for few in [&alike[..], &pairs[..4], &[]] {
            assert_eq!(McNemar::from_pairs(few.iter().copied()).p, None);
        }
    }

    #[test]
    fn effects_have_intervals_around_them() {
        let pairs: Vec<(f64, f64)> = (0..60).map(|n| (0.1 * f64::from(n % 5), 0.1)).collect();
        let effect = PairedDifference::from_pairs(&pairs);
        assert!((effect.difference.value.unwrap() - 0.1).abs() < 1e-12);
        // The standard error is sd / sqrt(60); the interval reaches 1.96 of them to both sides.
        let sd = MeanSd::from_values(&pairs.iter().map(|(a, b)| a - b).collect::<Vec<_>>()).sd.unwrap();
        let reach = 1.96 * sd / 60f64.sqrt();
        assert!((effect.difference.low.unwrap() - (0.1 - reach)).abs() < 0.1 * reach);
        assert!((effect.difference.high.unwrap() - (0.1 + reach)).abs() < 0.1 * reach);
        assert!((effect.d_z.value.unwrap() - 0.1 / sd).abs() < 1e-12);
        let powers: Vec<f64> = effect.power.iter().map(|(_, power)| *power).collect();
        assert!(powers.windows(2).all(|pair| pair[0] <= pair[1]) && powers[4] > 0.99, "{powers:?}");
        assert_eq!(effect, PairedDifference::from_pairs(&pairs));
    }

    /// Four pairs, and sixty constant ones, have a mean, but no interval, effect size or power.
    #[test]
    fn no_interval_comes_out_of_nothing() {
        for (pairs, mean) in [(vec![(1.0, 0.0), (0.5, 0.0), (0.0, 0.0), (0.5, 0.0)], 0.5), (vec![(1.0, 0.0); 60], 1.0)]
        {
            let difference = ConfidenceInterval { value: Some(mean), low: None, high: None };
            assert_eq!(
                PairedDifference::from_pairs(&pairs),
                PairedDifference { difference, ..PairedDifference::default() }
            );
        }
    }

    /// Without an effect, the power is roughly the level of the test.
    #[test]
    fn without_an_effect_there_is_no_power() {
        let pairs: Vec<(f64, f64)> = (0..60).map(|n| (if n % 2 == 0 { 0.1 } else { -0.1 }, 0.0)).collect();
        let effect = PairedDifference::from_pairs(&pairs);
        assert!(effect.power.iter().all(|(n, power)| *n < 10 || *power < 0.09), "{:?}", effect.power);
        assert_eq!(PairedDifference::from_pairs(&[]), PairedDifference::default());
    }
}
