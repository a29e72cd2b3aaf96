//! Ablation of full-hand touch: rates of clean success without some of its capabilities, one row each, with mean and 95
//! % interval.

use kuva::prelude::{ForestPlot, Plot};
use maud::{Markup, html};
use scenarios::summary::{Summary, combination_rates};
use scenarios::{Condition, TrialRecord};
use statistics::{ConfidenceInterval, PairedDifference};
use world::Sensing;

use super::chart::{self, color};
use super::comparisons::format_with_interval;
use super::html::{ColumnAlignment, HtmlTable, format_number};

/// Width of the drawing and height of a row, pixels.
const WIDTH: f64 = 760.0;
const ROW_HEIGHT: f64 = 30.0;

/// A row of the figure: name, class that colours it, mean clean success.
struct Row {
    name: &'static str,
    class: &'static str,
    success: ConfidenceInterval,
}

/// Returns the rows: blind at the top, then the ablations by rising success, then reflex and the whole hand.
fn rows(summary: &Summary, records: &[TrialRecord]) -> Vec<Row> {
    let of = |condition: Condition| {
        let rates = combination_rates(records, condition);
        PairedDifference::from_pairs(&rates.iter().map(|rates| (rates.clean_success_rate, 0.0)).collect::<Vec<_>>())
            .difference
    };
    let mut less: Vec<Row> = summary
        .ablations
        .iter()
        .map(|ablation| Row { name: ablation.ablation.label(), class: "ideal", success: ablation.clean_success })
        .collect();
    less.sort_by(|a, b| a.success.value.unwrap_or(0.0).total_cmp(&b.success.value.unwrap_or(0.0)));
    let mut rows = vec![Row { name: "blind", class: "blind", success: of(Condition::Blind) }];
    rows.extend(less);
    rows.push(Row { name: Sensing::ServosOnly.label(), class: "reflex", success: of(Condition::Reflex) });
    rows.push(Row { name: Sensing::Full.label(), class: "touch", success: of(Condition::Touch) });
    // Conditions that were not run have no mean.
    rows.retain(|row| row.success.value.is_some());
    rows
}

/// Draws the figure for a page that includes the style.
pub fn figure(summary: &Summary, records: &[TrialRecord]) -> Markup {
    let rows = rows(summary, records);
    let forest =
        rows.iter().fold(ForestPlot::new().with_show_null_line(false), |forest, Row { name, class, success }| {
            let mean = success.value.unwrap_or(0.0);
            let label = format!("{name}: {}", format_number(mean, 3));
            forest.with_colored_row(
                label,
                mean,
                success.low.unwrap_or(mean),
                success.high.unwrap_or(mean),
                color(class),
            )
        });
    let plots: Vec<Plot> = vec![forest.with_whisker_width(4.0).into()];
    let size = [WIDTH, 90.0 + ROW_HEIGHT * rows.len() as f64];
    let layout = chart::layout(&plots, "Clean success by available capabilities", size);
    chart::draw(plots, layout.with_x_axis_min(0.0).with_x_axis_max(1.0), "Clean success rate without some capabilities")
}

/// Returns the section of the page; empty if no ablation was run.
pub fn section(summary: &Summary, records: &[TrialRecord]) -> Markup {
    if summary.ablations.is_empty() {
        return Markup::default();
    }
    let head = [
        ("available capabilities", ColumnAlignment::Words),
        ("trials", ColumnAlignment::Numbers),
        ("success [95 %]", ColumnAlignment::Numbers),
        ("clean success [95 %]", ColumnAlignment::Numbers),
        ("against the whole hand [95 %]", ColumnAlignment::Numbers),
        ("contact", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new(
        "Trials without some capabilities; clean success is compared; intervals by bootstrap over combinations",
        &head,
    );
    let with = |of: &ConfidenceInterval| format_with_interval(of, 3);
    for ablation in &summary.ablations {
        table.row(&[
            ablation.ablation.label().to_string(),
            ablation.trials.to_string(),
            with(&ablation.success),
            with(&ablation.clean_success),
            with(&ablation.against_full),
            format_number(ablation.contact.value.unwrap_or(f64::NAN), 3),
        ]);
    }
    html! {
        h2 id="ablations" { "Ablations of full-hand touch" }
        figure {
            (figure(summary, records))
            figcaption { "Square: mean over combinations; bar: 95 % bootstrap interval. Also as " a href="ablations.svg" { "ablations.svg" } "." }
        }
        (table)
    }
}
