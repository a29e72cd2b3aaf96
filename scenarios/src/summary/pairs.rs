//! Pairs of trials that two conditions ran with the same errors.

use std::collections::HashMap;

use statistics::PredictionQuality;

use crate::record::{Condition, TrialRecord};

/// Returns (combination, `outcome` under `first`, `outcome` under `second`) of each trial that both conditions ran.
pub fn paired_outcomes(
    records: &[TrialRecord],
    first: Condition,
    second: Condition,
    outcome: impl Fn(&TrialRecord) -> bool,
) -> Vec<(usize, bool, bool)> {
    let of = |condition: Condition| records.iter().filter(move |record| record.condition == condition);
    let id = |record: &TrialRecord| (record.combination, record.trial);
    let seconds: HashMap<_, bool> = of(second).map(|record| (id(record), outcome(record))).collect();
    let pair = |record: &TrialRecord| Some((record.combination, outcome(record), *seconds.get(&id(record))?));
    of(first).filter_map(pair).collect()
}

/// Evaluates the predicted risk of blind trials as a prediction of unwanted contact. Trials without a predicted risk
/// are left out.
pub fn risk_prediction(records: &[TrialRecord]) -> Option<PredictionQuality> {
    let blind = records.iter().filter(|record| record.condition == Condition::Blind);
    PredictionQuality::from_scored(blind.filter_map(|record| Some((record.risk?, record.contact))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::record;

    #[test]
    fn only_trials_of_both_conditions_count() {
        let mut records = Vec::new();
        for (combination, trial) in [(0, 0), (0, 1), (1, 0)] {
            let mut touch = record(combination, trial, Condition::Touch);
            let mut blind = record(combination, trial, Condition::Blind);
            (touch.clean_success, blind.clean_success) = (true, trial == 1);
            records.extend([touch, blind]);
        }
        records.push(record(2, 0, Condition::Touch));
        let pairs = paired_outcomes(&records, Condition::Touch, Condition::Blind, |record| record.clean_success);
        assert_eq!(pairs, [(0, true, false), (0, true, true), (1, true, false)]);
    }
}
