//! A curve over an axis as SVG: a line for each arm with its 95 % intervals.

use std::fmt::Write as _;

use report::figure::rate_grid;
use report::html::{escape, number};

use crate::curve::Estimate;

const WIDTH: f64 = 540.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 50.0;
const RIGHT: f64 = WIDTH - 120.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = HEIGHT - 56.0;

/// An arm's line.
pub struct Line {
    pub name: String,
    /// Place on the horizontal axis, and rate.
    pub points: Vec<(f64, Estimate)>,
}

/// Lines over an axis.
pub struct Figure {
    pub title: String,
    /// Below the axis.
    pub axis: String,
    /// Places on the axis and what stands there.
    pub ticks: Vec<(f64, String)>,
    pub lines: Vec<Line>,
}

impl Figure {
    /// For a page that brings the report's style.
    pub fn svg(&self) -> String {
        let (low, high) = self
            .ticks
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (x, _)| (low.min(*x), high.max(*x)));
        let span = if high > low { high - low } else { 1.0 };
        let across = |x: f64| LEFT + 16.0 + (x - low) / span * (RIGHT - LEFT - 32.0);
        let down = |rate: f64| BOTTOM - rate * (BOTTOM - TOP);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\">\n\
             <rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/><text class=\"title\" x=\"8\" y=\"22\">{0}</text>\n",
            escape(&self.title)
        );
        rate_grid(&mut svg, [LEFT, RIGHT], down);
        for (x, label) in &self.ticks {
            let _ = writeln!(
                svg,
                "<text class=\"soft\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                across(*x),
                BOTTOM + 18.0,
                escape(label)
            );
        }
        let _ = writeln!(
            svg,
            "<text class=\"soft\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            (LEFT + RIGHT) / 2.0,
            BOTTOM + 40.0,
            escape(&self.axis)
        );
        // Names keep clear of each other.
        let mut names: Vec<(f64, usize)> = Vec::new();
        for (n, line) in self.lines.iter().enumerate() {
            // Intervals beside each other, not on top of each other.
            let aside = (n as f64 - (self.lines.len() as f64 - 1.0) / 2.0) * 3.0;
            let _ = writeln!(svg, "<g class=\"{}\" style=\"{}\">", escape(&line.name), color(&line.name, n));
            let path: Vec<String> = line
                .points
                .iter()
                .map(|(x, rate)| format!("{:.1} {:.1}", across(*x) + aside, down(rate.value)))
                .collect();
            let _ = writeln!(svg, "<path class=\"curve\" d=\"M{}\"/>", path.join("L"));
            for (x, rate) in &line.points {
                let (x, y) = (across(*x) + aside, down(rate.value));
                if let (Some(low), Some(high)) = (rate.low, rate.high) {
                    let _ = writeln!(svg, "<path class=\"whisker\" d=\"M{x:.1} {:.1}V{:.1}\"/>", down(low), down(high));
                }
                let _ = writeln!(
                    svg,
                    "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.4\"><title>{}: {} of {}</title></circle>",
                    escape(&line.name),
                    number(rate.value, 3),
                    rate.n
                );
            }
            svg += "</g>\n";
            names.extend(line.points.last().map(|(_, rate)| (down(rate.value), n)));
        }
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut above = f64::NEG_INFINITY;
        for (y, n) in names {
            let y = y.max(above + 15.0);
            above = y;
            let name = &self.lines[n].name;
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" style=\"{};fill:var(--own)\" class=\"{1}\">{}</text>",
                RIGHT + 6.0,
                y + 4.0,
                color(name, n),
                escape(name)
            );
        }
        svg + "</svg>\n"
    }
}

/// Policies have the report's colours; what else there is gets others.
fn color(name: &str, n: usize) -> String {
    let known = ["ideal", "blind", "reflex", "touch"].contains(&name);
    if known { format!("--own:var(--{name})") } else { format!("--own:hsl({} 45% 50%)", 40 + 67 * n % 360) }
}
