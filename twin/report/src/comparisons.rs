//! Comparisons between conditions: tests, effect sizes, and trials within combinations. Conditions that were not run
//! are left out.

use maud::{Markup, Render as _, html};
use scenarios::Condition;
use scenarios::summary::Summary;
use statistics::{ConfidenceInterval, NoTestReason, PairedDifference, TTest};

use super::findings::Rate;
use super::html::{ColumnAlignment, HtmlTable, format_number, format_probability};

/// One of the benchmark's comparisons between two conditions that were run.
pub struct Comparison<'a> {
    /// The two conditions; the test asks whether the first has the larger mean.
    pub conditions: [Condition; 2],
    pub rate: Rate,
    pub test: &'a TTest,
    difference: &'a PairedDifference,
}

impl Comparison<'_> {
    /// Returns the question of the test, as named in the table.
    fn question(&self) -> String {
        let [more, less] = self.conditions;
        match self.rate {
            Rate::Contact => format!("more contacts {more} than {less}?"),
            Rate::Success => format!("more success with {more} than {less}?"),
            Rate::CleanSuccess => format!("more clean success with {more} than {less}?"),
        }
    }

    fn name(&self) -> String {
        let [more, less] = self.conditions;
        let rate = match self.rate {
            Rate::Contact => "contacts",
            Rate::Success => "success",
            Rate::CleanSuccess => "clean success",
        };
        format!("{rate}, {more} less {less}")
    }
}

/// Lists the comparisons whose two conditions were both run.
pub fn available_comparisons(summary: &Summary) -> Vec<Comparison<'_>> {
    use Condition::{Blind, Ideal, Reflex, Touch};
    let (tests, differences) = (&summary.t_test, &summary.differences);
    let all = [
        ([Blind, Ideal], Rate::Contact, &tests.contact, &differences.contact),
        ([Touch, Blind], Rate::Success, &tests.success, &differences.success),
        ([Touch, Blind], Rate::CleanSuccess, &tests.clean_success, &differences.clean_success),
        ([Touch, Reflex], Rate::CleanSuccess, &tests.touch_over_reflex, &differences.touch_over_reflex),
    ];
    let compared = all.map(|(conditions, rate, test, difference)| Comparison { conditions, rate, test, difference });
    let finished = |one: &Comparison| {
        let both = one.conditions.iter().all(|condition| summary.conditions.get(*condition).trials > 0);
        both && one.test.untested != Some(NoTestReason::NotRun)
    };
    compared.into_iter().filter(finished).collect()
}

/// Formats an optional number.
fn format_optional(value: Option<f64>, decimals: usize) -> String {
    format_number(value.unwrap_or(f64::NAN), decimals)
}

/// Formats a value with its interval, if it has one.
pub fn format_with_interval(of: &ConfidenceInterval, decimals: usize) -> String {
    match (of.low, of.high) {
        (Some(low), Some(high)) => {
            format!(
                "{} [{}, {}]",
                format_optional(of.value, decimals),
                format_number(low, decimals),
                format_number(high, decimals)
            )
        }
        _ => format_optional(of.value, decimals),
    }
}

/// Returns the tables; empty if nothing can be compared.
pub fn section(summary: &Summary) -> Markup {
    let compared = available_comparisons(summary);
    html! { @if !compared.is_empty() {
        (tests(summary, &compared)) (differences(&compared)) (mixed_model_table(summary)) (trial_by_trial(summary))
    } }
}

/// Returns the table of the tests.
fn tests(summary: &Summary, compared: &[Comparison]) -> HtmlTable {
    let head = [
        ("question", ColumnAlignment::Words),
        ("difference of means", ColumnAlignment::Numbers),
        ("t", ColumnAlignment::Numbers),
        ("df", ColumnAlignment::Numbers),
        ("p", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("Paired one-sided t-tests over combinations", &head);
    for one in compared {
        let [more, less] = one.conditions.map(|condition| one.rate.over_all(summary.conditions.get(condition)).mean);
        let test = one.test;
        let tested = test.p.map(|p| [format_optional(test.t, 2), test.df.to_string(), format_probability(p)]);
        let [t, df, p] = tested.unwrap_or_else(|| {
            let reason = test.reason().unwrap_or_default();
            ["–".to_owned(), "–".to_owned(), format!("none: {reason}")]
        });
        table.row(&[one.question(), format_optional(more.zip(less).map(|(a, b)| a - b), 3), t, df, p]);
    }
    table
}

/// Returns the table of effect sizes, which goes beyond the paper: the sizes of the differences, and the power with
/// fewer combinations.
fn differences(compared: &[Comparison]) -> HtmlTable {
    let head = [
        ("difference", ColumnAlignment::Words),
        ("mean [95 %]", ColumnAlignment::Numbers),
        ("effect size d_z [95 %]", ColumnAlignment::Numbers),
        ("power with fewer combinations", ColumnAlignment::Words),
    ];
    let mut table = HtmlTable::new("Paired differences over combinations, with bootstrap intervals", &head);
    for one in compared {
        let PairedDifference { difference, d_z, power } = one.difference;
        let power: Vec<String> = power.iter().map(|(n, power)| format!("{n}: {}", format_number(*power, 2))).collect();
        table.row(&[one.name(), format_with_interval(difference, 3), format_with_interval(d_z, 2), power.join(", ")]);
    }
    table
}

/// Returns the table of the mixed model, trials within combinations: it shows whether combinations differ, or only
/// their trials.
fn mixed_model_table(summary: &Summary) -> Markup {
    let head = [
        ("difference, trial by trial", ColumnAlignment::Words),
        ("mean [95 %]", ColumnAlignment::Numbers),
        ("SD between combinations", ColumnAlignment::Numbers),
        ("SD within them", ColumnAlignment::Numbers),
        ("share between", ColumnAlignment::Numbers),
        ("pairs of trials", ColumnAlignment::Numbers),
    ];
    let of = &summary.differences.mixed;
    let all = [
        ("clean success, touch less blind", &of.clean_success),
        ("clean success, touch less reflex", &of.touch_over_reflex),
        ("contacts, blind less touch", &of.contact),
    ];
    let finished: Vec<_> = all.into_iter().filter(|(_, mixed)| mixed.trials > 0).collect();
    if finished.is_empty() {
        return Markup::default();
    }
    let mut table = HtmlTable::new("Mixed model: paired trials within combinations", &head);
    for (name, mixed) in finished {
        table.row(&[
            name.to_string(),
            format_with_interval(&mixed.difference, 3),
            format_optional(mixed.between_sd, 3),
            format_optional(mixed.within_sd, 3),
            format_optional(mixed.intraclass, 2),
            mixed.trials.to_string(),
        ]);
    }
    table.render()
}

/// Compares the success of touch and blind, pair by pair of trials.
fn trial_by_trial(summary: &Summary) -> Markup {
    let counts = &summary.differences.mcnemar;
    let tested = counts.p.map_or("none, too few trials differ".to_owned(), |p| format!("p {}", format_probability(p)));
    html! { @if counts.both + counts.first_only + counts.second_only + counts.neither > 0 {
        p {
            "Trial by trial: " (counts.both) " succeeded both blind and with touch, " (counts.first_only) " only with touch, "
            (counts.second_only) " only blind, " (counts.neither) " neither way (McNemar’s exact test, one-sided: " (tested) ")."
        }
    } }
}
