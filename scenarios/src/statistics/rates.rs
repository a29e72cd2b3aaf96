//! Rates of collision and success, combination by combination.

use std::collections::{BTreeMap, HashMap};

use serde::{Deserialize, Serialize};

use crate::record::{Condition, TrialRecord};

/// Rates of one combination under one condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CombinationRates {
    /// [`crate::Combination::id`].
    pub combination: usize,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object.
    pub second: String,
    /// Trials counted.
    pub trials: usize,
    /// Trials with a collision over all, 0 to 1.
    pub collision_rate: f64,
    /// Successful trials over all, 0 to 1.
    pub success_rate: f64,
}

/// Rates of every combination under `condition`, by rising id.
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
                collision_rate: rate(group.iter().filter(|record| record.collision).count()),
                success_rate: rate(group.iter().filter(|record| record.success).count()),
            }
        })
        .collect()
}

/// Pairs of `value` over the combinations that both conditions have.
pub(super) fn pair_up(
    a: &[CombinationRates],
    b: &[CombinationRates],
    value: impl Fn(&CombinationRates) -> f64,
) -> Vec<(f64, f64)> {
    let others: HashMap<usize, f64> = b.iter().map(|rates| (rates.combination, value(rates))).collect();
    a.iter().filter_map(|rates| others.get(&rates.combination).map(|&other| (value(rates), other))).collect()
}
