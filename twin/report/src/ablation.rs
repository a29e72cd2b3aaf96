//! The gain of full-hand touch: rates of clean success without some of its means, a row each, with mean and 95 % interval.

use std::fmt::Write as _;

use scenarios::summary::{Summary, combination_rates};
use scenarios::{Condition, TrialRecord};
use statistics::{Difference, Interval};
use world::Sensing;

use super::comparisons::with_interval;
use super::html::{Column, Table, escape, number};
use super::style;

/// Size of the drawing and of a row.
const WIDTH: f64 = 760.0;
const ROW: f64 = 30.0;
/// Where the axis lies in it.
const LEFT: f64 = 250.0;
const RIGHT: f64 = WIDTH - 90.0;
const TOP: f64 = 44.0;

/// A row of the figure: name, class that colours it, mean clean success.
struct Row {
    name: &'static str,
    class: &'static str,
    success: Interval,
}

/// Blind at the top, then the ablations by rising success, then reflex and the whole hand.
fn rows(summary: &Summary, records: &[TrialRecord]) -> Vec<Row> {
    let of = |condition: Condition| {
        let rates = combination_rates(records, condition);
        Difference::of(&rates.iter().map(|rates| (rates.clean_success_rate, 0.0)).collect::<Vec<_>>()).difference
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
    // Of conditions that were not played there is no mean.
    rows.retain(|row| row.success.value.is_some());
    rows
}

/// The figure; `alone` brings its own style.
pub fn figure(summary: &Summary, records: &[TrialRecord], alone: bool) -> String {
    let rows = rows(summary, records);
    let bottom = TOP + ROW * rows.len() as f64;
    let at = |rate: f64| LEFT + rate * (RIGHT - LEFT);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" viewBox=\"0 0 {WIDTH} {}\" role=\"img\" \
         aria-label=\"Clean success rate without some of its means\">\n",
        bottom + 34.0
    );
    if alone {
        let _ = writeln!(svg, "<style>{}</style>", style::FIGURE);
    }
    let _ = writeln!(
        svg,
        "<rect class=\"paper\" width=\"{WIDTH}\" height=\"{}\"/>\
         <text class=\"title\" x=\"8\" y=\"22\">Clean success by what the hand may use</text>",
        bottom + 34.0
    );
    for tenth in [0, 2, 4, 6, 8, 10] {
        let rate = f64::from(tenth) / 10.0;
        let x = at(rate);
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{bottom:.1}\"/>\
             <text class=\"soft\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"{:.1}\">{rate:.1}</text>",
            bottom + 18.0
        );
    }
    for (n, Row { name, class, success }) in rows.iter().enumerate() {
        let y = TOP + ROW * (n as f64 + 0.5);
        let _ = writeln!(
            svg,
            "<text text-anchor=\"end\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            LEFT - 10.0,
            y + 4.5,
            escape(name)
        );
        let Some(mean) = success.value else { continue };
        let bar = success.low.zip(success.high).map_or_else(String::new, |(low, high)| {
            let (low, high) = (at(low), at(high));
            format!("<line class=\"median\" x1=\"{low:.1}\" x2=\"{high:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>")
        });
        let _ = writeln!(
            svg,
            "<g class=\"{class}\">{bar}\
             <circle class=\"dot\" cx=\"{:.1}\" cy=\"{y:.1}\" r=\"6\"/></g>\
             <text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            at(mean),
            RIGHT + 14.0,
            y + 4.5,
            number(mean, 3)
        );
    }
    svg + "</svg>\n"
}

/// The section of the page; empty where no ablation was run.
pub fn section(summary: &Summary, records: &[TrialRecord]) -> String {
    if summary.ablations.is_empty() {
        return String::new();
    }
    let head = [
        ("what the hand may use", Column::Words),
        ("trials", Column::Numbers),
        ("success [95 %]", Column::Numbers),
        ("clean success [95 %]", Column::Numbers),
        ("against the whole hand [95 %]", Column::Numbers),
        ("contact", Column::Numbers),
    ];
    let mut table = Table::new(
        "The same trials without some of its means; clean success is compared; intervals by bootstrap over combinations",
        &head,
    );
    let with = |of: &Interval| with_interval(of, 3);
    for ablation in &summary.ablations {
        table.row(&[
            ablation.ablation.label().to_string(),
            ablation.trials.to_string(),
            with(&ablation.success),
            with(&ablation.clean_success),
            with(&ablation.against_full),
            number(ablation.contact.value.unwrap_or(f64::NAN), 3),
        ]);
    }
    format!(
        "<h2 id=\"ablations\">What full-hand touch buys</h2>\n<figure>\n{}<figcaption>Dot: mean over combinations; bar: 95 % \
         bootstrap interval. Also as <a href=\"ablations.svg\">ablations.svg</a>.</figcaption>\n</figure>\n{}",
        figure(summary, records, false),
        table.finish()
    )
}
