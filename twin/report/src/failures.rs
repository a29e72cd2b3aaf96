//! Causes of failed trials, with links to recordings of them.

use std::collections::BTreeSet;
use std::path::Path;

use maud::{Markup, html};
use scenarios::summary::Summary;
use scenarios::{Condition, FailureCause, TrialRecord};

use super::findings::harmless_contacts;
use super::html::{ColumnAlignment, HtmlTable};

/// Returns the section. `folder` may hold recordings.
pub fn section(summary: &Summary, records: &[TrialRecord], folder: &Path) -> Markup {
    let listed: Vec<Condition> = summary.conditions.conditions_with_trials();
    let by_condition: Vec<_> = listed.iter().map(|condition| summary.conditions.get(*condition)).collect();
    let causes: BTreeSet<FailureCause> = by_condition.iter().flat_map(|one| one.failures.keys().copied()).collect();
    let mut head = vec![("cause", ColumnAlignment::Words)];
    head.extend(listed.iter().map(|condition| (condition.name(), ColumnAlignment::Numbers)));
    let mut table = HtmlTable::new("Failed trials by cause", &head);
    let recorded = recorded_failures(folder);
    let mut row = |name: String, counts: Vec<usize>| {
        let mut cells = vec![name];
        cells.extend(counts.iter().map(ToString::to_string));
        table.row(&cells);
    };
    for cause in causes {
        row(cause.to_string(), by_condition.iter().map(|one| one.failures.get(&cause).copied().unwrap_or(0)).collect());
    }
    let failed = |condition: &Condition| records.iter().filter(|r| r.condition == *condition && !r.success).count();
    row("all failed trials".to_string(), listed.iter().map(failed).collect());
    row("all trials".to_string(), by_condition.iter().map(|one| one.trials).collect());
    let harmless: Vec<String> = Condition::ALL
        .into_iter()
        .map(|condition| (condition, harmless_contacts(records, condition)))
        .filter(|(_, (touched, _))| *touched > 0)
        .map(|(condition, (touched, succeeded))| format!("{condition}: {succeeded} of {touched}"))
        .collect();
    let note = match harmless.is_empty() {
        true => "No trial had an unwanted contact.".to_string(),
        false => format!("Trials that succeeded in spite of a contact: {}.", harmless.join("; ")),
    };
    html! {
        h2 id="failures" { "Causes of failure" }
        (table)
        p { (note) }
        p {
            @if recorded.is_empty() { "No failure was recorded; " code { "--record causes" } " records one of each." }
            @else {
                "A recording of each, to open with " code { "ftac view" } ": "
                @for (n, (name, file)) in recorded.iter().enumerate() { @if n > 0 { ", " } a href=(file) { (name) } }
                "."
            }
        }
    }
}

/// Returns names and files of the recordings listed in `causes.csv`: one of each cause and condition.
fn recorded_failures(folder: &Path) -> Vec<(String, String)> {
    let Ok(text) = std::fs::read_to_string(folder.join("causes.csv")) else { return Vec::new() };
    let fields = text
        .lines()
        .skip(1)
        .filter_map(|line| line.split_once(',').and_then(|(a, rest)| Some((a, rest.rsplit_once(',')?))));
    fields.map(|(condition, (cause, file))| (format!("{condition}: {cause}"), file.to_owned())).collect()
}
