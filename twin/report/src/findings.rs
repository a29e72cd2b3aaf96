//! Results from the records that are missing in the summary: the columns of the figures, one line per combination,
//! harmless contacts.

use std::collections::BTreeMap;

use scenarios::summary::{CombinationRates, ConditionSummary, Summary, combination_rates};
use scenarios::{Condition, TrialRecord};
use statistics::{MeanSd, TTest, percentile};

use super::chart::color;
use super::figure::{Figure, Group};
use super::html::{format_number, format_probability};

/// Kind of rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rate {
    /// Trials with an unwanted contact.
    Contact,
    /// Successful trials.
    Success,
    /// Trials that succeeded without any unwanted contact.
    CleanSuccess,
}

impl Rate {
    pub fn of_combination(self, rates: &CombinationRates) -> f64 {
        match self {
            Self::Contact => rates.contact_rate,
            Self::Success => rates.success_rate,
            Self::CleanSuccess => rates.clean_success_rate,
        }
    }

    /// Returns the mean and standard deviation over all combinations.
    pub fn over_all(self, summary: &ConditionSummary) -> MeanSd {
        match self {
            Self::Contact => summary.contact_rate,
            Self::Success => summary.success_rate,
            Self::CleanSuccess => summary.clean_success_rate,
        }
    }
}

/// Returns the figures of contact and of clean success.
pub fn figures(summary: &Summary, records: &[TrialRecord]) -> [Figure; 2] {
    let contact = (Condition::Ideal, Condition::Blind);
    let contact = figure(summary, records, Rate::Contact, contact, &summary.t_test.contact);
    let clean = (Condition::Blind, Condition::Touch);
    let clean = figure(summary, records, Rate::CleanSuccess, clean, &summary.t_test.clean_success);
    [contact, clean]
}

fn figure(
    summary: &Summary,
    records: &[TrialRecord],
    rate: Rate,
    compared: (Condition, Condition),
    test: &TTest,
) -> Figure {
    let noun = match rate {
        Rate::Contact => "Contact rate",
        Rate::Success => "Success rate",
        Rate::CleanSuccess => "Clean success rate",
    };
    let finished = summary.conditions.conditions_with_trials();
    let groups: Vec<Group> = finished
        .iter()
        .map(|condition| group(*condition, rate.over_all(summary.conditions.get(*condition)), records, rate))
        .collect();
    let column = |condition: Condition| finished.iter().position(|one| *one == condition);
    let columns_compared = column(compared.0).zip(column(compared.1));
    let columns: Vec<String> = groups
        .iter()
        .map(|group| match (group.mean_sd, extremes(group)) {
            (Some((mean, _)), [Some(low), Some(median), Some(high)]) => format!(
                "{}: mean {}, median {}, from {} to {}",
                group.name,
                format_number(mean, 3),
                format_number(median, 3),
                format_number(low, 3),
                format_number(high, 3)
            ),
            _ => format!("{}: no data", group.name),
        })
        .collect();
    Figure {
        title: format!("{noun} of each object combination"),
        axis: noun.to_lowercase(),
        description: format!(
            "Box plots of the {} of each object combination. {}.",
            noun.to_lowercase(),
            columns.join("; ")
        ),
        groups,
        brackets: format_test(test)
            .zip(columns_compared)
            .map(|(text, (one, other))| (one, other, text))
            .into_iter()
            .collect(),
    }
}

/// Returns the smallest rate, the median and the largest.
fn extremes(group: &Group) -> [Option<f64>; 3] {
    let rates: Vec<f64> = group.dots.iter().map(|(rate, _)| *rate).collect();
    [0.0, 50.0, 100.0].map(|percent| percentile(&rates, percent))
}

/// Formats a test's outcome as in papers; `None` if there was nothing to test.
pub fn format_test(test: &TTest) -> Option<String> {
    let p = match format_probability(test.p?) {
        text if text.starts_with('<') => text,
        text => format!("= {text}"),
    };
    Some(format!("t({}) = {}, p {p}", test.df, format_number(test.t?, 1)))
}

fn group(condition: Condition, all: MeanSd, records: &[TrialRecord], rate: Rate) -> Group {
    let combinations = combination_rates(records, condition);
    Group {
        name: condition.name().to_string(),
        color: color(condition.name()),
        count: combinations.len(),
        dots: combinations
            .iter()
            .map(|one| (rate.of_combination(one), format!("{} {}, then {}", one.combination, one.first, one.second)))
            .collect(),
        mean_sd: all.mean.map(|mean| (mean, all.sd.unwrap_or(f64::NAN))),
    }
}

/// Rates of one combination under all conditions.
#[derive(Debug, Clone)]
pub struct CombinationLine {
    /// Id of the combination.
    pub combination: usize,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object.
    pub second: String,
    /// Rates in the order of [`Condition::ALL`]; `None` for a condition that was not run.
    pub rates: [Option<CombinationRates>; Condition::ALL.len()],
    /// Share of its touch trials that left the planned grasp.
    pub switched: Option<f64>,
}

/// Conditions whose clean success ranks combinations, the most informative first.
pub const RANKING_CONDITIONS: [Condition; 4] =
    [Condition::Touch, Condition::Blind, Condition::Reflex, Condition::External];

/// Lists all combinations, worst first: by clean success under the conditions of [`RANKING_CONDITIONS`], then by
/// contacts blind and ideal.
pub fn combination_lines(records: &[TrialRecord]) -> Vec<CombinationLine> {
    let mut lines: BTreeMap<usize, CombinationLine> = BTreeMap::new();
    for (index, condition) in Condition::ALL.into_iter().enumerate() {
        for rates in combination_rates(records, condition) {
            let line = lines.entry(rates.combination).or_insert_with(|| CombinationLine {
                combination: rates.combination,
                first: rates.first.clone(),
                second: rates.second.clone(),
                rates: [const { None }; Condition::ALL.len()],
                switched: None,
            });
            line.rates[index] = Some(rates);
        }
    }
    let mut touch: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for record in records.iter().filter(|record| record.condition == Condition::Touch) {
        let (switched, trials) = touch.entry(record.combination).or_default();
        *switched += usize::from(record.switched);
        *trials += 1;
    }
    let mut lines: Vec<CombinationLine> = lines.into_values().collect();
    for line in &mut lines {
        line.switched = touch.get(&line.combination).map(|(switched, trials)| *switched as f64 / *trials as f64);
    }
    let rank = |line: &CombinationLine| -> Vec<f64> {
        let rate = |condition: Condition, rate: Rate| {
            let at = Condition::ALL.iter().position(|one| *one == condition)?;
            line.rates[at].as_ref().map(|rates| rate.of_combination(rates))
        };
        let clean = RANKING_CONDITIONS.map(|condition| rate(condition, Rate::CleanSuccess).unwrap_or(f64::INFINITY));
        let contact = [Condition::Blind, Condition::Ideal];
        let contact = contact.map(|condition| -rate(condition, Rate::Contact).unwrap_or(0.0));
        [&clean[..], &contact[..]].concat()
    };
    lines.sort_by(|a, b| {
        let mut order = rank(a).into_iter().zip(rank(b)).map(|(a, b)| a.total_cmp(&b));
        order.find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    });
    lines
}

/// Counts trials with an unwanted contact, and the successful ones among them.
pub fn harmless_contacts(records: &[TrialRecord], condition: Condition) -> (usize, usize) {
    let touched = || records.iter().filter(move |record| record.condition == condition && record.contact);
    (touched().count(), touched().filter(|record| record.success).count())
}
