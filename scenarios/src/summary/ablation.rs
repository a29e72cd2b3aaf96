//! Ablation study: results of the policy `touch` with one part removed, on the same trials.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{ConfidenceInterval, PairedDifference};

use super::rates::{combination_rates, pair_up};
use crate::ablation::Ablation;
use crate::record::{AblatedTrial, Condition, TrialRecord};

/// Results of the policy `touch` under one ablation. Intervals are over combinations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AblationSummary {
    /// The part that was removed.
    pub ablation: Ablation,
    /// Trials run.
    pub trials: usize,
    /// Mean success rate.
    pub success: ConfidenceInterval,
    /// Mean rate of clean success.
    pub clean_success: ConfidenceInterval,
    /// Mean contact rate.
    pub contact: ConfidenceInterval,
    /// Clean success rate less that of the unablated policy on the same combinations.
    pub against_full: ConfidenceInterval,
}

impl AblationSummary {
    /// Returns a summary of each ablation in `ablated`, in the order of [`Ablation::ALL`]; `records` holds the trials
    /// of the unablated policy.
    pub fn all(records: &[TrialRecord], ablated: &[AblatedTrial]) -> Vec<Self> {
        let full = combination_rates(records, Condition::Touch);
        let of = |ablation: Ablation| -> Option<Self> {
            let trials: Vec<TrialRecord> =
                ablated.iter().filter(|trial| trial.ablation == ablation).map(|trial| trial.record.clone()).collect();
            let rates = combination_rates(&trials, Condition::Touch);
            let mean = |rate: &[f64]| {
                PairedDifference::from_pairs(&rate.iter().map(|rate| (*rate, 0.0)).collect::<Vec<_>>()).difference
            };
            (!rates.is_empty()).then(|| Self {
                ablation,
                trials: trials.len(),
                success: mean(&rates.iter().map(|rates| rates.success_rate).collect::<Vec<_>>()),
                clean_success: mean(&rates.iter().map(|rates| rates.clean_success_rate).collect::<Vec<_>>()),
                contact: mean(&rates.iter().map(|rates| rates.contact_rate).collect::<Vec<_>>()),
                against_full: PairedDifference::from_pairs(&pair_up(&rates, &full, |rates| rates.clean_success_rate))
                    .difference,
            })
        };
        Ablation::ALL.into_iter().filter_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::record;

    #[test]
    fn each_ablation_is_compared_on_its_own_combinations() {
        let with = |combination: usize, trial: usize, success: bool| {
            let mut record = record(combination, trial, Condition::Touch);
            (record.success, record.clean_success) = (success, success);
            record
        };
        let records: Vec<TrialRecord> = (0..7).map(|combination| with(combination, 0, true)).collect();
        // Six of the seven combinations, of which five fail.
        let ablated: Vec<AblatedTrial> = (0..6)
            .map(|combination| AblatedTrial {
                ablation: Ablation::PalmOnly,
                record: with(combination, 0, combination == 1),
            })
            .collect();
        let all = AblationSummary::all(&records, &ablated);
        assert_eq!(all.len(), 1);
        assert_eq!((all[0].ablation, all[0].trials), (Ablation::PalmOnly, 6));
        assert_eq!(all[0].success.value, Some(1.0 / 6.0));
        assert!((all[0].against_full.value.unwrap() + 5.0 / 6.0).abs() < 1e-12);
        assert!(all[0].success.low < all[0].success.high);
    }
}
