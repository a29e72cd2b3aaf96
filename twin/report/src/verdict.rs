//! Headline of the page: the results in words, of the conditions that were run.

use maud::{Markup, html};
use scenarios::summary::Summary;
use scenarios::{Condition, TrialRecord};
use statistics::{ConfidenceInterval, TTest};

use super::comparisons::{self, Comparison};
use super::findings::{Rate, format_test};
use super::html::format_number;

/// Significance level: a difference counts as shown if p is below it.
const SIGNIFICANCE_LEVEL: f64 = 0.05;

/// Returns the paragraph.
pub fn section(summary: &Summary, records: &[TrialRecord]) -> Markup {
    if records.is_empty() {
        return html! { p.verdict.short { "No finished trial yet: there is nothing to report." } };
    }
    let compared = comparisons::available_comparisons(summary);
    let (headline, all_shown) = headline(&compared);
    html! {
        p.verdict.short[!all_shown] {
            @if let Some(headline) = headline { strong { (headline) "." } " " }
            (clean_success(summary, &compared)) (contacts(summary, &compared))
        }
    }
}

/// Returns the conclusion of the tests, or the reason why there is none, and true if every tested difference is shown.
fn headline(compared: &[Comparison]) -> (Option<String>, bool) {
    let said = [
        (
            [Condition::Touch, Condition::Blind],
            Rate::CleanSuccess,
            "touch raises clean success over blind",
            "that touch raises clean success over blind is not shown",
        ),
        (
            [Condition::Touch, Condition::Reflex],
            Rate::CleanSuccess,
            "touch raises clean success over reflex, so its images are needed",
            "that its images are needed, and not only its further tries, is not shown",
        ),
        (
            [Condition::Blind, Condition::Ideal],
            Rate::Contact,
            "errors cause unwanted contacts",
            "that errors cause unwanted contacts is not shown",
        ),
    ];
    let asked: Vec<_> = said
        .into_iter()
        .filter_map(|(conditions, rate, shown, not)| {
            let one = compared.iter().find(|one| one.conditions == conditions && one.rate == rate)?;
            Some((one.test, shown, not))
        })
        .collect();
    let findings: Vec<(bool, &str)> = asked
        .iter()
        .filter_map(|(test, shown, not)| {
            test.p.map(|p| if p < SIGNIFICANCE_LEVEL { (true, *shown) } else { (false, *not) })
        })
        .collect();
    let all_shown = findings.iter().all(|(shown, _)| *shown);
    if findings.is_empty() {
        let reason = asked.iter().find_map(|(test, ..)| test.reason());
        return (reason.map(|reason| format!("No verdict: {reason}")), all_shown);
    }
    let words: Vec<&str> = findings.iter().map(|(_, text)| *text).collect();
    (Some(capitalised(&words.join("; "))), all_shown)
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn percent(rate: Option<f64>) -> String {
    format!("{} %", format_number(rate.map_or(f64::NAN, |rate| rate * 100.0), 1))
}

/// Formats a test's outcome, or the reason why there is none.
fn format_test_or_reason(test: &TTest) -> String {
    format_test(test).unwrap_or_else(|| format!("not tested: {}", test.reason().unwrap_or_default()))
}

/// Joins words as in `a, b and c`.
fn join_words(parts: &[String]) -> String {
    match parts {
        [] => String::new(),
        [only] => only.clone(),
        [most @ .., last] => format!("{} and {last}", most.join(", ")),
    }
}

fn clean_success(summary: &Summary, compared: &[Comparison]) -> String {
    let words = [
        (Condition::Touch, "with touch"),
        (Condition::Blind, "blind"),
        (Condition::Reflex, "with further tries but no tactile image"),
        (Condition::External, "with the external policy"),
    ];
    let parts: Vec<String> = words
        .into_iter()
        .map(|(condition, words)| (summary.conditions.get(condition), words))
        .filter(|(condition, _)| condition.trials > 0)
        .map(|(condition, words)| format!("{} {words}", percent(condition.clean_success_rate.mean)))
        .collect();
    if parts.is_empty() {
        return String::new();
    }
    let test = compared
        .iter()
        .find(|one| one.rate == Rate::CleanSuccess && one.conditions == [Condition::Touch, Condition::Blind]);
    let test = test.map_or_else(String::new, |one| {
        let ConfidenceInterval { value, low, high } = summary.differences.clean_success.difference;
        let points = |value: f64| format_number(100.0 * value, 1);
        let gain = match (value, low, high) {
            (Some(value), Some(low), Some(high)) => {
                format!("; touch less blind {} points, 95 % {} to {}", points(value), points(low), points(high))
            }
            _ => String::new(),
        };
        format!(" ({}{gain}; the paper: 100 % and 53.5 %)", format_test_or_reason(one.test))
    });
    format!("Trials that succeeded cleanly, with the same errors: {}{test}. ", join_words(&parts))
}

fn contacts(summary: &Summary, compared: &[Comparison]) -> String {
    let words = [
        (Condition::Ideal, "without errors"),
        (Condition::Blind, "blind"),
        (Condition::Reflex, "with reflex"),
        (Condition::Touch, "with touch"),
        (Condition::External, "with the external policy"),
    ];
    let parts: Vec<String> = words
        .into_iter()
        .map(|(condition, words)| (summary.conditions.get(condition), words))
        .filter(|(condition, _)| condition.trials > 0)
        .map(|(condition, words)| format!("{} {words}", percent(condition.contact_rate.mean)))
        .collect();
    let test = compared.iter().find(|one| one.rate == Rate::Contact);
    let test = test.map_or_else(String::new, |one| {
        format!(" (blind over ideal: {}; the paper: 46.5 % and 0.0 %)", format_test_or_reason(one.test))
    });
    format!("Trials with an unwanted contact: {}{test}.", join_words(&parts))
}
