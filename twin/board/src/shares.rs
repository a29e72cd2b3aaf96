//! Shares of outcomes and paired comparisons, as the benchmark's summary defines them: means over combinations.

use std::collections::BTreeMap;

use scenarios::record::Condition;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{McNemar, MeanSd, PairedDifference, SuccessRate, paired_t_test};

use crate::outcomes::{OutcomeKind, OutcomePlace, Outcomes, RecordedOutcome};

/// Unit of sampling of an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntervalKind {
    /// Wilson's interval of independent trials: with one trial of each combination, or if all combinations are equal.
    Wilson,
    /// Bootstrap over combinations, because the trials of one are correlated.
    Combinations,
}

/// Share of trials with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Share {
    /// Mean over combinations.
    pub value: f64,
    /// Standard deviation over combinations; none for one combination.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
    /// Number of trials with the outcome.
    pub count: u64,
    /// Number of trials.
    pub of: u64,
    /// Unit of sampling of the interval.
    pub interval: IntervalKind,
}

/// Shares of a policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shares {
    /// Duration of a trial, s, mean over combinations.
    pub trial_s: f64,
    /// Duration of a trial relative to `blind` in the same runs; none without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_ratio: Option<f64>,
    /// Success without any unwanted contact.
    pub clean: Share,
    /// Success.
    pub success: Share,
    /// Unwanted contact.
    pub contact: Share,
}

/// Paired comparison of the clean success of two policies that ran the same trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// The other policy.
    pub rival: Condition,
    /// True if it has the largest clean share of the other policies.
    pub strongest: bool,
    /// Clean share less that of the rival, mean over combinations.
    pub difference: f64,
    /// Lower end of the 95 % bootstrap interval over combinations; none for fewer than five, or equal ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Upper end of the interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// Probability in the paired, one-sided t-test over combinations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p: Option<f64>,
    /// Number of trials in which only the row's policy was clean.
    pub won: usize,
    /// Number of trials in which only the rival was clean.
    pub lost: usize,
}

/// Returns a value of every outcome of a condition, by combination.
fn by_combination(
    outcomes: &Outcomes,
    condition: Condition,
    value: impl Fn(&RecordedOutcome) -> f64,
) -> BTreeMap<usize, Vec<f64>> {
    let mut groups: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for (place, outcome) in outcomes.iter().filter(|(place, _)| place.condition == condition) {
        groups.entry(place.combination).or_default().push(value(outcome));
    }
    groups
}

/// Returns the mean of every combination.
fn means(outcomes: &Outcomes, condition: Condition, value: impl Fn(&RecordedOutcome) -> f64) -> Vec<f64> {
    let groups = by_combination(outcomes, condition, value).into_values();
    groups.map(|group| group.iter().sum::<f64>() / group.len() as f64).collect()
}

fn flag(is_true: bool) -> f64 {
    f64::from(u8::from(is_true))
}

fn share(outcomes: &Outcomes, condition: Condition, hit: fn(OutcomeKind) -> bool) -> Option<Share> {
    let rates = means(outcomes, condition, |outcome| flag(hit(outcome.kind)));
    let of_condition = || outcomes.iter().filter(|(place, _)| place.condition == condition);
    let (of, count) = (of_condition().count(), of_condition().filter(|(_, outcome)| hit(outcome.kind)).count());
    let MeanSd { mean, sd } = MeanSd::from_values(&rates);
    let (of, count, value) = (of as u64, count as u64, mean?);
    let pairs: Vec<(f64, f64)> = rates.iter().map(|rate| (*rate, 0.0)).collect();
    let several = of > rates.len() as u64;
    let bootstrap = several.then(|| PairedDifference::from_pairs(&pairs).difference);
    let (low, high, interval) = match bootstrap.and_then(|interval| interval.low.zip(interval.high)) {
        Some((low, high)) => (low, high, IntervalKind::Combinations),
        None => {
            let rate = SuccessRate::new(count, of);
            (rate.low, rate.high, IntervalKind::Wilson)
        }
    };
    Some(Share { value, sd, low, high, count, of, interval })
}

/// Computes the shares of a condition; none without trials.
pub fn shares(outcomes: &Outcomes, condition: Condition) -> Option<Shares> {
    let seconds =
        |condition| MeanSd::from_values(&means(outcomes, condition, |outcome: &RecordedOutcome| outcome.seconds)).mean;
    let trial_s = seconds(condition)?;
    Some(Shares {
        trial_s,
        time_ratio: seconds(Condition::Blind).filter(|blind| *blind > 0.0).map(|blind| trial_s / blind),
        clean: share(outcomes, condition, OutcomeKind::is_clean)?,
        success: share(outcomes, condition, OutcomeKind::is_success)?,
        contact: share(outcomes, condition, OutcomeKind::has_contact)?,
    })
}

/// Compares a condition with `blind` and with the strongest of all others that have outcomes.
pub fn comparisons(outcomes: &Outcomes, own: Condition) -> Vec<Comparison> {
    let clean = |condition| share(outcomes, condition, OutcomeKind::is_clean).map(|share| share.value);
    let rivals = Condition::NOISY.into_iter().filter(|rival| *rival != own);
    let rated: Vec<(Condition, f64)> = rivals.filter_map(|rival| Some((rival, clean(rival)?))).collect();
    // Of equal ones the first is the strongest.
    let strongest = rated.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(rival, _)| *rival);
    let compared = rated.iter().map(|(rival, _)| *rival);
    compared
        .filter(|rival| *rival == Condition::Blind || Some(*rival) == strongest)
        .map(|rival| compare(outcomes, own, rival, Some(rival) == strongest))
        .collect()
}

fn compare(outcomes: &Outcomes, own: Condition, rival: Condition, strongest: bool) -> Comparison {
    let rates = |condition| means(outcomes, condition, |outcome| flag(outcome.kind.is_clean()));
    let pairs: Vec<(f64, f64)> = rates(own).into_iter().zip(rates(rival)).collect();
    let difference = PairedDifference::from_pairs(&pairs).difference;
    let trials = outcomes.iter().filter(|(place, _)| place.condition == own).filter_map(|(place, outcome)| {
        let other = outcomes.get(&OutcomePlace { condition: rival, ..*place })?;
        Some((place.combination, outcome.kind.is_clean(), other.kind.is_clean()))
    });
    let table = McNemar::from_pairs(trials);
    Comparison {
        rival,
        strongest,
        difference: difference.value.unwrap_or_default(),
        low: difference.low,
        high: difference.high,
        p: paired_t_test(&pairs).p,
        won: table.first_only,
        lost: table.second_only,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcomes(seeds: u64, trials: usize, clean: impl Fn(Condition, usize, usize) -> bool) -> Outcomes {
        let mut all = Outcomes::new();
        for condition in [Condition::Blind, Condition::Touch] {
            for (seed, combination) in (0..seeds).flat_map(|seed| (0..10).map(move |combination| (seed, combination))) {
                for trial in 0..trials {
                    let kind = if clean(condition, combination, trial) {
                        OutcomeKind::Clean
                    } else {
                        OutcomeKind::FailedContact
                    };
                    let seconds = if condition == Condition::Blind { 10.0 } else { 15.0 };
                    let outcome = RecordedOutcome { kind, seconds, record: String::new() };
                    all.insert(OutcomePlace { seed, condition, combination, trial }, outcome);
                }
            }
        }
        all
    }

    /// With one trial of each of ten combinations the interval is Wilson's: 5 of 10 is 0.237 to 0.763.
    #[test]
    fn one_trial_of_each_combination_has_wilsons_interval() {
        let all = outcomes(1, 1, |_, combination, _| combination < 5);
        let shares = shares(&all, Condition::Touch).expect("shares");
        let clean = shares.clean;
        assert_eq!((clean.value, clean.count, clean.of, clean.interval), (0.5, 5, 10, IntervalKind::Wilson));
        assert!((clean.low - 0.2366).abs() < 5e-4 && (clean.high - 0.7634).abs() < 5e-4, "{clean:?}");
        assert_eq!((shares.time_ratio, shares.contact.value), (Some(1.5), 0.5));
    }

    /// Equal trials of a combination are no further evidence: twice as many leave the interval as it is.
    #[test]
    fn trials_of_a_combination_do_not_narrow_the_interval() {
        let clean = |seeds| {
            let all = outcomes(seeds, 2, |_, combination, _| combination < 5);
            shares(&all, Condition::Touch).expect("shares").clean
        };
        let (few, many) = (clean(1), clean(4));
        assert_eq!((few.interval, many.interval), (IntervalKind::Combinations, IntervalKind::Combinations));
        assert!((few.high - few.low - (many.high - many.low)).abs() < 1e-9 && few.of * 4 == many.of);
    }

    #[test]
    fn comparisons_are_paired_by_trial() {
        let all = outcomes(1, 2, |condition, combination, trial| match condition {
            Condition::Blind => combination == 9,
            _ => combination < 6 + trial,
        });
        let compared = comparisons(&all, Condition::Touch);
        assert_eq!(compared.len(), 1);
        let blind = &compared[0];
        assert_eq!((blind.rival, blind.strongest, blind.won, blind.lost), (Condition::Blind, true, 13, 2));
        assert!((blind.difference - 0.55).abs() < 1e-12, "{blind:?}");
        assert!(blind.low.is_some_and(|low| low > 0.0) && blind.p.is_some_and(|p| p < 0.05), "{blind:?}");
        assert_eq!(comparisons(&all, Condition::Blind)[0].rival, Condition::Touch);
    }
}
