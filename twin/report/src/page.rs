//! Sections of the page.

use std::path::Path;

use anyhow::Result;
use maud::{Markup, PreEscaped, html};
use scenarios::summary::{Summary, combination_rates};
use scenarios::{Condition, TrialRecord};
use serde_json::Value;
use statistics::MeanSd;

use super::figure::Figure;
use super::findings::{Rate, combination_lines};
use super::html::{ColumnAlignment, HtmlTable, count_with_noun, format_duration, format_number, page};
use super::panels::{self, Panel};
use super::{ablation, comparisons, failures, findings, heat_map, pictures, prediction, run, verdict};

/// Script that sorts a table by the clicked column, ascending and descending in turn.
const SORTING_SCRIPT: &str = include_str!("../data/sorting.js");
/// Differences of the run from the paper, and definitions of the figures; contains no data.
const DEFINITIONS: &str = include_str!("../data/definitions.html");

/// Returns the whole page. `folder` may hold recordings, `figures` are contact and clean success, `panels` those of the
/// paper.
pub fn render(
    summary: &Summary,
    records: &[TrialRecord],
    run: &Value,
    (folder, figures, panels): (&Path, [&Figure; 2], &[Panel]),
) -> Result<String> {
    let (robot, seed) = (&summary.robot, summary.seed);
    let (combos, trials) =
        (count_with_noun(summary.combos, "object combination"), count_with_noun(summary.trials_per_combo, "trial"));
    let main = html! {
        h1 { "Multi-object benchmark of the F-TAC Hand" }
        p.byline {
            "The benchmark is that of Zhao et al., " i { "Embedding high-resolution touch across robotic hands enables adaptive human-like grasping" }
            ", Nature Machine Intelligence, 2025, " a href="https://doi.org/10.1038/s42256-025-01053-3" { "doi:10.1038/s42256-025-01053-3" }
            ", in an independent simulation."
        }
        p.byline { (combos) ", " (trials) " each, robot: " (robot) ", seed " (seed) }
        (run::warnings(run))
        (verdict::section(summary, records))
        (pictures::section(folder, records)?)
        (panels::section(panels, summary, records, run))
        (rates(summary, records))
        (comparisons::section(summary))
        (figure_section(figures, summary))
        (heat_map::section(records))
        (prediction::section(records))
        (ablation::section(summary, records))
        (facts(summary))
        (failures::section(summary, records, folder))
        (combinations(summary, records))
        (run::section(run))
        (PreEscaped(DEFINITIONS))
    };
    Ok(page(&format!("Multi-object benchmark: {robot}, seed {seed}"), "", &main, SORTING_SCRIPT))
}

/// Formats an optional number.
fn format_optional(value: Option<f64>, decimals: usize) -> String {
    format_number(value.unwrap_or(f64::NAN), decimals)
}

/// Returns the table of the conditions beside the paper's values.
fn rates(summary: &Summary, records: &[TrialRecord]) -> Markup {
    let columns = [
        ("condition", ColumnAlignment::Words),
        ("trials", ColumnAlignment::Numbers),
        ("n", ColumnAlignment::Numbers),
        ("contact rate: mean (SD)", ColumnAlignment::Numbers),
        ("success rate: mean (SD)", ColumnAlignment::Numbers),
        ("clean success rate: mean (SD)", ColumnAlignment::Numbers),
        ("predicted risk", ColumnAlignment::Numbers),
        ("time of a trial (s)", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("Rates over combinations (n), each the share of its trials", &columns);
    for condition in summary.conditions.conditions_with_trials() {
        let ours = summary.conditions.get(condition);
        let cell = |rate: Rate| {
            let MeanSd { mean, sd } = rate.over_all(ours);
            format!("{} ({})", format_optional(mean, 3), format_optional(sd, 3))
        };
        table.row(&[
            condition.name().to_string(),
            ours.trials.to_string(),
            combination_rates(records, condition).len().to_string(),
            cell(Rate::Contact),
            cell(Rate::Success),
            cell(Rate::CleanSuccess),
            format_optional(ours.risk_rate.mean, 3),
            format_optional(ours.trial_s.mean, 1),
        ]);
    }
    html! { h2 id="rates" { "Contact and success" } (table) }
}

fn figure_section(figures: [&Figure; 2], summary: &Summary) -> Markup {
    let captions = [("contact.svg", "ideal with blind"), ("clean_success.svg", "blind with touch")];
    html! {
        h2 id="figures" { "Figures" }
        div.figures {
            @for (figure, (file, compared)) in figures.into_iter().zip(captions) {
                figure {
                    (figure.draw())
                    figcaption {
                        (figure.title) ": a dot is one of " (count_with_noun(summary.combos, "combination")) " (its name shows under the pointer); the box \
                        spans the 25th to the 75th percentile, the thick line is the median, the diamond the mean, whiskers reach from minimum to \
                        maximum; the shading is a kernel density estimate, each scaled to the same width. Dots of equal rate that fill a row continue \
                        above and below it. "
                        @if !figure.brackets.is_empty() { "The bracket compares " (compared) " (paired, one-sided). " }
                        "Also as " a href=(file) { (file) } "."
                    }
                }
            }
        }
    }
}

/// Returns the section on speed and accuracy.
fn facts(summary: &Summary) -> Markup {
    let unit = |value: Option<f64>, decimals: usize, unit: &str| match value {
        Some(value) => format!("{} {unit}", format_number(value, decimals)),
        None => "–".to_string(),
    };
    let (time, pose) = (&summary.decision_ms, &summary.pose_error);
    let mut facts = vec![
        ("Decision, median".to_string(), unit(time.p50, 1, "ms")),
        ("Decision, 99th percentile".to_string(), unit(time.p99, 1, "ms")),
        ("Pose error, position, median".to_string(), unit(pose.mm.median, 2, "mm")),
        ("Pose error, position, 95th percentile".to_string(), unit(pose.mm.p95, 2, "mm")),
        ("Pose error, angle, median".to_string(), unit(pose.deg.median, 1, "°")),
        ("Pose error, angle, 95th percentile".to_string(), unit(pose.deg.p95, 1, "°")),
        ("Planned pose before touch, error, median".to_string(), unit(pose.prior_mm.median, 2, "mm")),
        ("Planned pose before touch, error, 95th percentile".to_string(), unit(pose.prior_mm.p95, 2, "mm")),
    ];
    // All of these are measured in touch trials.
    if summary.conditions.touch.trials == 0 {
        facts.clear();
    }
    facts.extend([
        ("Real-time factor, all threads together".to_string(), unit(summary.real_time_factor, 2, "×")),
        ("Wall time".to_string(), format_duration(summary.wall_s)),
    ]);
    html! {
        h2 id="speed" { "Speed and accuracy" }
        dl.facts { @for (term, value) in facts { div { dt { (term) } dd { (value) } } } }
    }
}

/// Returns the table with one line per combination.
fn combinations(summary: &Summary, records: &[TrialRecord]) -> Markup {
    let mut head = vec![
        ("no.".to_string(), ColumnAlignment::Words),
        ("first object".to_string(), ColumnAlignment::Words),
        ("second object".to_string(), ColumnAlignment::Words),
    ];
    let finished = summary.conditions.conditions_with_trials();
    for rate in ["contact", "clean success"] {
        head.extend(finished.iter().map(|condition| (format!("{rate}, {condition}"), ColumnAlignment::Numbers)));
    }
    let touched = finished.contains(&Condition::Touch);
    if touched {
        head.push(("switched".to_string(), ColumnAlignment::Numbers));
    }
    let head: Vec<(&str, ColumnAlignment)> = head.iter().map(|(name, column)| (name.as_str(), *column)).collect();
    let ranks: Vec<&str> = findings::RANKING_CONDITIONS
        .iter()
        .filter(|condition| finished.contains(condition))
        .map(|condition| condition.name())
        .collect();
    let by =
        if ranks.is_empty() { "contacts".to_string() } else { format!("clean success: {}", ranks.join(", then ")) };
    let mut table = HtmlTable::new(&format!("Rates of every combination, worst first by {by}"), &head);
    for line in combination_lines(records) {
        let mut cells = vec![line.combination.to_string(), line.first.clone(), line.second.clone()];
        for rate in [Rate::Contact, Rate::CleanSuccess] {
            // In the order of `Condition::ALL`.
            let rates = Condition::ALL.into_iter().zip(&line.rates);
            let rates = rates.filter(|(condition, _)| finished.contains(condition));
            cells.extend(
                rates.map(|(_, rates)| format_optional(rates.as_ref().map(|rates| rate.of_combination(rates)), 2)),
            );
        }
        cells.extend(touched.then(|| format_optional(line.switched, 2)));
        table.row(&cells);
    }
    html! { h2 id="combinations" { "Every combination" } (table) }
}
