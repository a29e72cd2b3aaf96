//! The two counts of a collision, and the rates by each.

use std::collections::BTreeMap;

use scenarios::{Condition, TrialRecord};
use statistics::MeanSd;

/// Criterion by which collisions are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CollisionCount {
    /// Unwanted contact in the trial.
    Contact,
    /// Predicted overlap: the object in the hand, at its estimated pose, overlaps the second one in its place at the
    /// grasp.
    Predicted,
}

impl CollisionCount {
    pub const ALL: [Self; 2] = [Self::Contact, Self::Predicted];

    pub fn name(self) -> &'static str {
        match self {
            Self::Contact => "contact",
            Self::Predicted => "predicted",
        }
    }

    /// True if the planned grasp collided; `None` if nothing was predicted.
    pub fn collided(self, record: &TrialRecord) -> Option<bool> {
        match self {
            Self::Contact => Some(record.contact),
            Self::Predicted => record.plan_separation_mm.map(|separation| separation < 0.0),
        }
    }

    /// True if the executed grasp succeeds: the planned one, or the one that touch chose instead. `None` if nothing was
    /// predicted.
    pub fn succeeded(self, record: &TrialRecord) -> Option<bool> {
        match self {
            Self::Contact => Some(record.clean_success),
            Self::Predicted if record.condition == Condition::Touch => record
                .plan_separation_mm
                .map(|_| record.chosen_separation_mm.is_some_and(|separation| separation >= 0.0)),
            Self::Predicted => self.collided(record).map(|collided| !collided),
        }
    }
}

/// Rate of a combination.
pub struct CombinationRate {
    combination: usize,
    /// Number of the combination and names of its objects.
    pub name: String,
    /// Share of its trials to which the count applies.
    pub rate: f64,
}

/// Rates under one condition by one count.
pub struct RateSample {
    pub count: CollisionCount,
    /// Rates by rising number of the combination; never empty.
    pub rates: Vec<CombinationRate>,
    /// Number of counted trials.
    pub trials: usize,
}

impl RateSample {
    /// Gathers the rates; `None` if the count applies to no trial.
    pub fn from_records(
        records: &[TrialRecord],
        condition: Condition,
        count: CollisionCount,
        counted: fn(CollisionCount, &TrialRecord) -> Option<bool>,
    ) -> Option<Self> {
        let mut groups: BTreeMap<usize, (String, Vec<bool>)> = BTreeMap::new();
        for record in records.iter().filter(|record| record.condition == condition) {
            let Some(counts) = counted(count, record) else { continue };
            let name = || format!("{} {}, then {}", record.combination, record.first, record.second);
            groups.entry(record.combination).or_insert_with(|| (name(), Vec::new())).1.push(counts);
        }
        let trials = groups.values().map(|(_, trials)| trials.len()).sum();
        let rates = groups.into_iter().map(|(combination, (name, trials))| CombinationRate {
            combination,
            name,
            rate: trials.iter().filter(|counts| **counts).count() as f64 / trials.len() as f64,
        });
        (trials > 0).then(|| Self { count, rates: rates.collect(), trials })
    }

    /// Returns mean and standard deviation over combinations. The standard deviation of a single one is NaN.
    pub fn mean_sd(&self) -> (f64, f64) {
        let MeanSd { mean, sd } = MeanSd::from_values(&self.rates.iter().map(|one| one.rate).collect::<Vec<_>>());
        (mean.unwrap_or(f64::NAN), sd.unwrap_or(f64::NAN))
    }

    /// Returns pairs (this rate, the other's) of the combinations that both have.
    pub fn paired(&self, other: &Self) -> Vec<(f64, f64)> {
        let others: BTreeMap<usize, f64> = other.rates.iter().map(|one| (one.combination, one.rate)).collect();
        self.rates.iter().filter_map(|one| Some((one.rate, *others.get(&one.combination)?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::synthetic_records;

    fn record(condition: Condition, plan: Option<f64>, chosen: Option<f64>) -> TrialRecord {
        let record =
            synthetic_records(1, 1).into_iter().find(|record| record.condition == condition).expect("a record");
        TrialRecord { plan_separation_mm: plan, chosen_separation_mm: chosen, ..record }
    }

    #[test]
    fn an_overlap_of_the_plan_collides_and_blind_fails_by_it() {
        let [blind, touch] = [Condition::Blind, Condition::Touch];
        for (condition, plan, chosen, expected) in [
            (blind, Some(2.0), None, (Some(false), Some(true))),
            (blind, Some(-2.0), None, (Some(true), Some(false))),
            (blind, None, None, (None, None)),
            (touch, Some(-2.0), Some(3.0), (Some(true), Some(true))),
            (touch, Some(-2.0), Some(-1.0), (Some(true), Some(false))),
            // Touch declined to grasp.
            (touch, Some(-2.0), None, (Some(true), Some(false))),
            (touch, None, None, (None, None)),
        ] {
            let record = record(condition, plan, chosen);
            let found = (CollisionCount::Predicted.collided(&record), CollisionCount::Predicted.succeeded(&record));
            assert_eq!(found, expected, "{condition} {plan:?} {chosen:?}");
        }
    }

    /// Trials without a prediction are not counted.
    #[test]
    fn rates_are_of_trials_with_a_prediction() {
        let records: Vec<_> = [Some(1.0), Some(-1.0), None].map(|plan| record(Condition::Blind, plan, None)).into();
        let sample = |count| {
            RateSample::from_records(&records, Condition::Blind, count, CollisionCount::collided).expect("trials")
        };
        assert_eq!(
            (sample(CollisionCount::Predicted).trials, sample(CollisionCount::Predicted).rates[0].rate),
            (2, 0.5)
        );
        assert_eq!(sample(CollisionCount::Contact).trials, 3);
        let unfelt = [record(Condition::Blind, None, None)];
        assert!(
            RateSample::from_records(&unfelt, Condition::Blind, CollisionCount::Predicted, CollisionCount::collided)
                .is_none()
        );
    }
}
