//! What each part of the senses is worth: the policy `touch` with less of them, on the same trials.

use serde::{Deserialize, Serialize};

use super::paired::{Effect, Interval};
use super::rates::{combination_rates, pair_up};
use crate::record::{AblatedTrial, Condition, TrialRecord};
use crate::sensing::Sensing;

/// The policy `touch` with some of the senses. Intervals are over combinations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ablation {
    /// What it was left with.
    pub sensing: Sensing,
    /// Trials run.
    pub trials: usize,
    /// Mean success rate.
    pub success: Interval,
    /// Mean collision rate.
    pub collision: Interval,
    /// Success less that of the whole hand on the same combinations.
    pub against_full: Interval,
}

impl Ablation {
    /// One for each kind of sensing in `ablated`, in the order of [`Sensing::ABLATIONS`]; `records` holds the whole hand's trials.
    pub fn all(records: &[TrialRecord], ablated: &[AblatedTrial]) -> Vec<Self> {
        let full = combination_rates(records, Condition::Touch);
        let of = |sensing: Sensing| -> Option<Self> {
            let trials: Vec<TrialRecord> =
                ablated.iter().filter(|trial| trial.sensing == sensing).map(|trial| trial.record.clone()).collect();
            let rates = combination_rates(&trials, Condition::Touch);
            let mean = |rate: &[f64]| Effect::of(&rate.iter().map(|rate| (*rate, 0.0)).collect::<Vec<_>>()).difference;
            (!rates.is_empty()).then(|| Self {
                sensing,
                trials: trials.len(),
                success: mean(&rates.iter().map(|rates| rates.success_rate).collect::<Vec<_>>()),
                collision: mean(&rates.iter().map(|rates| rates.collision_rate).collect::<Vec<_>>()),
                against_full: Effect::of(&pair_up(&rates, &full, |rates| rates.success_rate)).difference,
            })
        };
        Sensing::ABLATIONS.into_iter().filter_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::record;

    #[test]
    fn each_sensing_is_compared_on_its_own_combinations() {
        let with = |combination: usize, trial: usize, success: bool| {
            let mut record = record(combination, trial, Condition::Touch);
            record.success = success;
            record
        };
        let records: Vec<TrialRecord> = (0..3).map(|combination| with(combination, 0, true)).collect();
        // Two of the three combinations, one of them lost.
        let ablated: Vec<AblatedTrial> = (0..2)
            .map(|combination| AblatedTrial {
                sensing: Sensing::PalmOnly,
                record: with(combination, 0, combination == 1),
            })
            .collect();
        let all = Ablation::all(&records, &ablated);
        assert_eq!(all.len(), 1);
        assert_eq!((all[0].sensing, all[0].trials), (Sensing::PalmOnly, 2));
        assert_eq!(all[0].success.value, Some(0.5));
        assert_eq!(all[0].against_full.value, Some(-0.5));
        assert!(all[0].success.low < all[0].success.high);
    }
}
