//! Mixed model of paired trials within combinations: a linear model with one random effect.
//!
//! The difference of trial j in combination i is `d_ij = mu + b_i + e_ij`, with `b_i` between combinations and `e_ij`
//! between the trials of one. The variances are those of the one-way analysis of variance with unequal groups (method
//! of moments, negative estimates set to 0), and `mu` is the generalised least-squares mean with them (Searle, Casella
//! and McCulloch, *Variance Components*, ch. 3). Outcomes are 0 or 1, so this is a linear probability model: `mu` is a
//! difference of probabilities.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::paired::{ConfidenceInterval, MIN_SAMPLES};

/// Variation of a difference between two conditions, between combinations and between the trials of one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct MixedEffects {
    /// Number of pairs of trials.
    pub trials: usize,
    /// Mean `mu` with its 95 % interval: Student's t with one degree of freedom less than combinations, within the
    /// possible range of -1 to 1. There is no interval with fewer than [`MIN_SAMPLES`] combinations.
    pub difference: ConfidenceInterval,
    /// Standard deviation of `b_i`; none unless there are two combinations, and one of them has two trials.
    pub between_sd: Option<f64>,
    /// Standard deviation of `e_ij`.
    pub within_sd: Option<f64>,
    /// Intraclass correlation: share of the variance that lies between combinations, 0 to 1.
    pub intraclass: Option<f64>,
}

impl MixedEffects {
    /// Fits pairs (cluster, outcome of the first, outcome of the second); the difference is the first less the second.
    pub fn from_pairs(pairs: impl IntoIterator<Item = (usize, bool, bool)>) -> Self {
        let mut groups: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (cluster, first, second) in pairs {
            groups.entry(cluster).or_default().push(f64::from(u8::from(first)) - f64::from(u8::from(second)));
        }
        Self::from_groups(&groups.into_values().collect::<Vec<_>>())
    }

    /// Fits differences, one group per cluster; no group may be empty.
    fn from_groups(groups: &[Vec<f64>]) -> Self {
        let trials: usize = groups.iter().map(Vec::len).sum();
        let (n, k) = (trials as f64, groups.len() as f64);
        if groups.len() < 2 || trials == groups.len() {
            return Self { trials, ..Self::default() };
        }
        let means: Vec<f64> = groups.iter().map(|group| group.iter().sum::<f64>() / group.len() as f64).collect();
        let grand = groups.iter().flatten().sum::<f64>() / n;
        let each = || groups.iter().zip(&means);
        let within =
            each().map(|(group, mean)| group.iter().map(|value| (value - mean).powi(2)).sum::<f64>()).sum::<f64>()
                / (n - k);
        let between_square =
            each().map(|(group, mean)| group.len() as f64 * (mean - grand).powi(2)).sum::<f64>() / (k - 1.0);
        let squares: f64 = groups.iter().map(|group| (group.len() as f64).powi(2)).sum();
        let typical = (n - squares / n) / (k - 1.0);
        let between = ((between_square - within) / typical).max(0.0);
        let total = between + within;
        let variances = Self {
            trials,
            between_sd: Some(between.sqrt()),
            within_sd: Some(within.sqrt()),
            intraclass: (total > 0.0).then(|| between / total),
            ..Self::default()
        };
        if total <= 0.0 {
            return Self { difference: ConfidenceInterval { value: Some(grand), low: None, high: None }, ..variances };
        }
        let weights: Vec<f64> = groups.iter().map(|group| 1.0 / (between + within / group.len() as f64)).collect();
        let sum: f64 = weights.iter().sum();
        let mu = weights.iter().zip(&means).map(|(weight, mean)| weight * mean).sum::<f64>() / sum;
        let students = StudentsT::new(0.0, 1.0, k - 1.0).ok().filter(|_| groups.len() >= MIN_SAMPLES);
        let reach = students.map(|students| students.inverse_cdf(0.975) / sum.sqrt());
        let [low, high] = [-1.0, 1.0].map(|side| reach.map(|reach| (mu + side * reach).clamp(-1.0, 1.0)));
        let difference = ConfidenceInterval { value: Some(mu), low, high };
        Self { difference, ..variances }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: balanced groups of four with means 1/2 and 0 in turn.
    #[test]
    fn a_balanced_table_by_hand() {
        let groups = [vec![1.0, 1.0, 0.0, 0.0], vec![1.0, 0.0, 0.0, -1.0]];
        let mixed = MixedEffects::from_groups(&groups);
        // Within: (4 x 1/4 + 2) / 6 = 1/2. Between: 4 x 2 x 1/16 / 1 = 1/2.
        assert!((mixed.within_sd.unwrap() - 0.5f64.sqrt()).abs() < 1e-12);
        assert_eq!(mixed.between_sd, Some(0.0));
        assert_eq!(mixed.intraclass, Some(0.0));
        assert_eq!(
            mixed.difference,
            ConfidenceInterval { value: Some(0.25), low: None, high: None },
            "of two combinations"
        );
        // Six of them: between 4 x 6 x 1/16 / 5 = 0.3, less than within, so that the standard error is that of 24
        // independent trials; t(5) is 2.571.
        let six = MixedEffects::from_groups(&[&groups[..], &groups, &groups].concat());
        assert!((six.difference.high.unwrap() - 0.25 - 2.571 * (0.5f64 / 24.0).sqrt()).abs() < 1e-3);
    }

    /// In five combinations, nearly all trials differ: the interval is cut at the greatest possible difference.
    #[test]
    fn an_interval_stays_in_the_possible_range() {
        let groups: Vec<Vec<f64>> = (0..5).map(|group| vec![1.0, if group == 0 { 0.0 } else { 1.0 }]).collect();
        let found = MixedEffects::from_groups(&groups).difference;
        assert!(found.low.unwrap() < found.value.unwrap() && found.high == Some(1.0), "{found:?}");
        let lost: Vec<Vec<f64>> = groups.iter().map(|group| group.iter().map(|value| -value).collect()).collect();
        assert_eq!(MixedEffects::from_groups(&lost).difference.low, Some(-1.0));
    }

    /// If the trials of a combination agree, only combinations count: the interval is that of their means.
    #[test]
    fn trials_that_agree_add_nothing() {
        let groups: Vec<Vec<f64>> = (0..10).map(|group| vec![f64::from(group % 2); 5]).collect();
        let mixed = MixedEffects::from_groups(&groups);
        assert_eq!(mixed.within_sd, Some(0.0));
        assert_eq!(mixed.intraclass, Some(1.0));
        let sd = (10.0f64 * 0.25 / 9.0).sqrt();
        let reach = 2.262 * sd / 10f64.sqrt();
        assert!((mixed.difference.high.unwrap() - 0.5 - reach).abs() < 1e-3);
    }

    #[test]
    fn outcomes_are_grouped_by_their_cluster() {
        let pairs = [(0, true, true), (0, true, false), (1, true, false), (1, true, false)];
        let mixed = MixedEffects::from_pairs(pairs);
        assert_eq!((mixed.trials, mixed.difference.value), (4, Some(0.75)));
        let single = MixedEffects::from_pairs([pairs[0]]);
        assert_eq!((single.trials, single.difference.value), (1, None));
    }
}
