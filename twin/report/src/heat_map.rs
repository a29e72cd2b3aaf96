//! Clean success of every combination as a heat map of first against second object, blind beside touch.

use std::collections::BTreeSet;

use kuva::prelude::{MarkerShape, Plot};
use maud::{Markup, html};
use scenarios::{Condition, TrialRecord};

use super::chart;
use super::findings::{CombinationLine, Rate, combination_lines};
use super::html::format_number;

/// Size of a cell, and room for names, pixels.
const CELL_SIZE: f64 = 15.0;
const NAME_WIDTH: f64 = 112.0;
/// Shown conditions, with their index in [`Condition::ALL`].
const SHOWN_CONDITIONS: [(usize, Condition); 2] = [(1, Condition::Blind), (3, Condition::Touch)];

/// Returns the section; empty without records of these conditions.
pub fn section(records: &[TrialRecord]) -> Markup {
    let lines = combination_lines(records);
    let finished = |index: usize| lines.iter().any(|line| line.rates[index].is_some());
    html! { @if SHOWN_CONDITIONS.iter().any(|(index, _)| finished(*index)) {
        h2 id="map" { "First against second object" }
        p {
            "Clean success of every combination, from red (none) over yellow to green (all trials); numbers show under the pointer. \
            Blank pairs are not among the combinations."
        }
        div.maps {
            @for (index, condition) in SHOWN_CONDITIONS.into_iter().filter(|(index, _)| finished(*index)) {
                figure { (map(&lines, index, condition)) figcaption { (condition) } }
            }
        }
    } }
}

fn map(lines: &[CombinationLine], index: usize, condition: Condition) -> Markup {
    let names = |pick: fn(&CombinationLine) -> &String| -> Vec<String> {
        lines.iter().map(pick).collect::<BTreeSet<_>>().into_iter().cloned().collect()
    };
    // The first name of the rows stands at the top.
    let (columns, rows) = (names(|line| &line.second), names(|line| &line.first).into_iter().rev().collect::<Vec<_>>());
    let place = |names: &[String], name: &String| names.iter().position(|one| one == name).unwrap_or(0) as f64 + 1.0;
    let (cells, colors): (Vec<_>, Vec<_>) = lines
        .iter()
        .filter_map(|line| Some((line, Rate::CleanSuccess.of_combination(line.rates[index].as_ref()?))))
        .map(|(line, rate)| {
            let title = format!("{}, then {}: clean success {}", line.first, line.second, format_number(rate, 2));
            (((place(&columns, &line.second), place(&rows, &line.first)), title), color(rate))
        })
        .unzip();
    let cells = chart::dots("none", cells)
        .with_colors(colors)
        .with_marker(MarkerShape::Square)
        .with_size(CELL_SIZE / 2.0 - 0.5);
    let plots: Vec<Plot> = vec![cells.into()];
    let size = [columns.len(), rows.len()].map(|names| NAME_WIDTH + 10.0 + CELL_SIZE * names as f64);
    let [x, y] = [columns.len(), rows.len()].map(|names| names as f64 + 0.5);
    let layout = chart::layout(&plots, "", size)
        .with_force_margins(NAME_WIDTH, 10.0)
        .with_force_margins_y(10.0, NAME_WIDTH)
        .with_x_axis_min(0.5)
        .with_x_axis_max(x)
        .with_y_axis_min(0.5)
        .with_y_axis_max(y)
        .with_x_categories(columns)
        .with_y_categories(rows)
        .with_x_tick_rotate(-90.0)
        .with_show_grid(false);
    chart::draw(plots, layout, &format!("clean success of first against second object, {condition}"))
}

/// Returns a colour from red at 0, over yellow, to green at 1. The colours also differ in lightness.
fn color(rate: f64) -> String {
    const SCALE: [[f64; 3]; 3] = [[165.0, 30.0, 45.0], [246.0, 206.0, 90.0], [28.0, 122.0, 88.0]];
    let x = 2.0 * if rate.is_finite() { rate.clamp(0.0, 1.0) } else { 0.0 };
    let below = (x as usize).min(1);
    let part = x - below as f64;
    let [r, g, b] = std::array::from_fn(|i| (SCALE[below][i] * (1.0 - part) + SCALE[below + 1][i] * part) as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::synthetic_records;

    #[test]
    fn every_combination_is_a_cell_of_each_map() {
        let records = synthetic_records(12, 4);
        let html = section(&records).into_string();
        let pairs: BTreeSet<_> = records.iter().map(|record| record.combination).collect();
        assert_eq!(html.matches("<title>").count(), 2 * pairs.len());
        assert!(html.contains("mug &lt;small&gt;") && !html.contains("NaN"));
        assert_eq!((color(0.0), color(1.0)), ("#a51e2d".to_owned(), "#1c7a58".to_owned()));
        assert!(section(&[]).0.is_empty());
    }
}
