//! The board as a page, in the style of the reports.

use maud::{Markup, html};
use report::html::{ColumnAlignment, HtmlTable, count_with_noun, format_number, format_probability, whole_page};

use crate::shares::{Comparison, IntervalKind};
use crate::table::{BoardGroup, BoardRow, GROUP_NOTE, HEADS, difference_text, with_interval};

/// Title of the page.
const TITLE: &str = "Board: policies on the multi-object benchmark";
/// Columns that contain numbers.
const NUMBER_COLUMNS: std::ops::Range<usize> = 1..6;
/// Number of columns: the hash of the outcomes is among a row's details.
const COLUMNS: usize = HEADS.len() - 1;

/// Returns the whole page.
pub fn page(groups: &[BoardGroup]) -> String {
    let rows = groups.iter().map(|group| group.rows.len()).sum();
    let body = html! {
        p.byline {
            (count_with_noun(rows, "row")) ". A clean success has all objects in the hand at the end and no unwanted contact on the way. "
            "Every row is a file with the outcomes of its trials; "
            code { "ftac board check" } " verifies it and runs trials again."
        }
        @let faulty: Vec<&BoardRow> = groups.iter().flat_map(|group| &group.rows).filter(|row| row.differences > 0).collect();
        @if !faulty.is_empty() {
            ul.warnings { @for row in faulty { li { (row.name) ": the file does not agree with its own outcomes" } } }
        }
        @if groups.len() > 1 { p { (GROUP_NOTE) } }
        @for group in groups {
            h2 { (group.title()) }
            (table(group))
            @for row in &group.rows { (details(row)) }
        }
        h2 { "Columns" }
        dl.terms {
            dt { "seeds" } dd { "Development: the policy was developed on these seeds, or may have been. Held out: by its author's word, it was not." }
            dt { "clean, success, contact" } dd { "Means over combinations of each combination's share of trials." }
            dt { "time" } dd { "Duration of a trial relative to the policy blind in the same run." }
            dt { "over blind" } dd { "Clean share less that of the policy blind, paired over combinations, with a bootstrap interval." }
        }
    };
    whole_page(TITLE, &body)
}

fn table(group: &BoardGroup) -> HtmlTable {
    let alignment = |n| if NUMBER_COLUMNS.contains(&n) { ColumnAlignment::Numbers } else { ColumnAlignment::Words };
    let heads: Vec<(&str, ColumnAlignment)> =
        HEADS[..COLUMNS].iter().enumerate().map(|(n, head)| (*head, alignment(n))).collect();
    let mut table = HtmlTable::new("Policies, the largest share of clean trials first", &heads);
    for row in &group.rows {
        table.row(&row.cells()[..COLUMNS]);
    }
    table
}

fn details(row: &BoardRow) -> Markup {
    let clean = &row.shares.clean;
    let unit = match clean.interval {
        IntervalKind::Wilson => "Wilson's interval over trials",
        IntervalKind::Combinations => "bootstrap interval over combinations",
    };
    html! {
        details {
            summary { (row.name) }
            ul {
                @if let Some(by) = &row.by { li { "by " (by) } }
                // Entries have links of the web only.
                @if let Some(link) = &row.link { li { a href=(link) rel="nofollow noopener" { (link) } } }
                li { "policy " code { (row.policy) } @if let Some(hash) = &row.policy_sha256 { ", SHA-256 " code { (hash) } } }
                li {
                    "program " (row.version) @if let Some(commit) = &row.commit { ", commit " code { (commit) } }
                    "; outcomes " code { (row.outcomes) }
                }
                li { (clean.count) " of " (clean.of) " trials are clean: " (with_interval(clean)) ", " (unit) }
                li { "a trial takes " (format_number(row.shares.trial_s, 1)) " s" }
                @for comparison in &row.comparisons { li { (compared(comparison)) } }
            }
        }
    }
}

fn compared(comparison: &Comparison) -> String {
    let Comparison { rival, strongest, p, won, lost, .. } = comparison;
    let p = p.map_or_else(String::new, |p| format!(", p = {} (one-sided)", format_probability(p)));
    let strongest = if *strongest { ", the strongest other policy of the run" } else { "" };
    format!("over {rival}{strongest}: {}{p}; {won} trials won, {lost} lost", difference_text(comparison))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::add::tests::touch_entry;
    use crate::entry::BoardEntry;
    use crate::table::read_board;

    #[test]
    fn the_page_shows_every_row_and_escapes_its_texts() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |entry: &BoardEntry, file: &str| {
            std::fs::write(folder.path().join(file), entry.to_text().expect("text")).expect("written");
        };
        let link = Some("https://example.org/?a=\"><script>".to_owned());
        let entry = BoardEntry { name: "<b>".to_owned(), link, ..touch_entry() };
        entry.validate(Path::new("row.toml")).expect("a link of the web");
        write(&entry, "a.toml");
        let mut wrong = touch_entry();
        wrong.shares.clean.value = 1.0;
        write(&wrong, "b.toml");
        let page = page(&read_board(folder.path()).expect("a board"));
        for part in [
            "<th scope=\"row\">&lt;b&gt;</th>",
            "href=\"https://example.org/?a=&quot;&gt;&lt;script&gt;\"",
            "11 of 12 trials are clean",
            "over blind, the strongest other policy of the run: +0.417",
            "Touch: the file does not agree with its own outcomes",
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
        assert!(!page.contains("<script>"));
    }
}
