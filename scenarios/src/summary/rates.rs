//! Rates of contact and success per combination.

use std::collections::{BTreeMap, HashMap};

use serde::{Deserialize, Serialize};
use statistics::MeanSd;

use crate::record::{Condition, TrialRecord};

/// Rates of one combination under one condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CombinationRates {
    /// Number of the combination, [`crate::Combination::id`].
    pub combination: usize,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object.
    pub second: String,
    /// Number of trials.
    pub trials: usize,
    /// Fraction of trials with an unwanted contact, 0 to 1.
    pub contact_rate: f64,
    /// Fraction of successful trials, 0 to 1.
    pub success_rate: f64,
    /// Fraction of trials that succeeded without an unwanted contact, 0 to 1.
    pub clean_success_rate: f64,
    /// Mean predicted risk of the planned second grasp, over the trials that have a prediction.
    pub risk_rate: Option<f64>,
    /// Mean duration of a trial, s.
    pub trial_s: f64,
}

/// Computes the rates of every combination under `condition`, in order of increasing id.
pub fn combination_rates(records: &[TrialRecord], condition: Condition) -> Vec<CombinationRates> {
    let mut groups: BTreeMap<usize, Vec<&TrialRecord>> = BTreeMap::new();
    for record in records.iter().filter(|record| record.condition == condition) {
        groups.entry(record.combination).or_default().push(record);
    }
    groups
        .into_iter()
        .map(|(combination, group)| {
            let rate = |count: usize| count as f64 / group.len() as f64;
            CombinationRates {
                combination,
                first: group[0].first.clone(),
                second: group[0].second.clone(),
                trials: group.len(),
                contact_rate: rate(group.iter().filter(|record| record.contact).count()),
                success_rate: rate(group.iter().filter(|record| record.success).count()),
                clean_success_rate: rate(group.iter().filter(|record| record.clean_success).count()),
                risk_rate: MeanSd::from_values(&group.iter().filter_map(|record| record.risk).collect::<Vec<_>>()).mean,
                trial_s: group.iter().map(|record| record.sim_seconds).sum::<f64>() / group.len() as f64,
            }
        })
        .collect()
}

/// Returns pairs of `value` for the combinations that both `a` and `b` have.
pub(super) fn pair_up(
    a: &[CombinationRates],
    b: &[CombinationRates],
    value: impl Fn(&CombinationRates) -> f64,
) -> Vec<(f64, f64)> {
    let others: HashMap<usize, f64> = b.iter().map(|rates| (rates.combination, value(rates))).collect();
    a.iter().filter_map(|rates| others.get(&rates.combination).map(|&other| (value(rates), other))).collect()
}
