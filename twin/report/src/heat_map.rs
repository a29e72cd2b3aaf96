//! Clean success of every combination as a map of first against second object, blind beside touch.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use scenarios::{Condition, TrialRecord};

use super::findings::{CombinationLine, Rate, combination_lines};
use super::html::{escape, number};

/// Size of a cell, and room for names, pixels.
const CELL: f64 = 15.0;
const NAMES: f64 = 112.0;
/// Conditions that are shown, by their place in [`Condition::ALL`].
const SHOWN: [(usize, Condition); 2] = [(1, Condition::Blind), (3, Condition::Touch)];

/// The section; nothing without records of these conditions.
pub fn section(records: &[TrialRecord]) -> String {
    let lines = combination_lines(records);
    let maps: String = SHOWN
        .iter()
        .filter(|(index, _)| lines.iter().any(|line| line.rates[*index].is_some()))
        .map(|(index, condition)| {
            format!(
                "<figure>{}<figcaption>{}</figcaption></figure>\n",
                map(&lines, *index, *condition),
                condition.name()
            )
        })
        .collect();
    if maps.is_empty() {
        return String::new();
    }
    format!(
        "<h2 id=\"map\">First against second object</h2>\n<p>Clean success of every combination, from red (none) over yellow to \
         green (all trials); numbers show under the pointer. Blank pairs are not among the combinations.</p>\n<div class=\"maps\">\n\
         {maps}</div>\n"
    )
}

fn map(lines: &[CombinationLine], index: usize, condition: Condition) -> String {
    let names = |pick: fn(&CombinationLine) -> &String| -> BTreeMap<String, usize> {
        let all: BTreeSet<&String> = lines.iter().map(pick).collect();
        all.into_iter().enumerate().map(|(n, name)| (name.clone(), n)).collect()
    };
    let (rows, columns) = (names(|line| &line.first), names(|line| &line.second));
    let (width, height) = (NAMES + CELL * columns.len() as f64, NAMES + CELL * rows.len() as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure map\" style=\"max-width:{:.0}px\" \
         viewBox=\"0 0 {width} {height}\" role=\"img\" \
         aria-label=\"clean success of first against second object, {condition}\">\n",
        1.5 * width
    );
    let middle = |n: usize| NAMES + CELL * (n as f64 + 0.5);
    for (name, row) in &rows {
        let (y, name) = (middle(*row) + 3.5, escape(name));
        let _ = writeln!(
            svg,
            "<text class=\"soft\" text-anchor=\"end\" x=\"{:.1}\" y=\"{y:.1}\">{name}</text>",
            NAMES - 5.0
        );
    }
    for (name, column) in &columns {
        let (x, name) = (middle(*column) + 3.5, escape(name));
        let turn = format!("translate({x:.1} {:.1}) rotate(-90)", NAMES - 5.0);
        let _ = writeln!(svg, "<text class=\"soft\" transform=\"{turn}\">{name}</text>");
    }
    for line in lines {
        let Some(rates) = &line.rates[index] else { continue };
        let rate = Rate::CleanSuccess.of(rates);
        let (x, y) = (NAMES + CELL * columns[&line.second] as f64, NAMES + CELL * rows[&line.first] as f64);
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{0}\" height=\"{0}\" rx=\"2\" fill=\"{1}\"><title>{2}, then {3}: clean \
             success {4}</title></rect>",
            CELL - 1.0,
            color(rate),
            escape(&line.first),
            escape(&line.second),
            number(rate, 2)
        );
    }
    svg + "</svg>\n"
}

/// Red at 0, over yellow to green at 1; also apart in lightness.
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
    use crate::tests::made_up;

    #[test]
    fn every_combination_is_a_cell_of_each_map() {
        let records = made_up(12, 4);
        let html = section(&records);
        let pairs: BTreeSet<_> = records.iter().map(|record| record.combination).collect();
        assert_eq!(html.matches("<rect ").count(), 2 * pairs.len());
        assert!(html.contains("mug &lt;small&gt;") && !html.contains("NaN"));
        assert_eq!((color(0.0), color(1.0)), ("#a51e2d".to_owned(), "#1c7a58".to_owned()));
        assert!(section(&[]).is_empty());
    }
}
