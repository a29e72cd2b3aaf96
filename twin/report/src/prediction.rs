//! What the predicted risk of the blind trials is worth: its ROC curve and its calibration curve, side by side, as SVG.

use std::fmt::Write as _;

use scenarios::summary::risk_prediction;
use scenarios::{Condition, TrialRecord};
use statistics::Prediction;

use super::html::{escape, number};
use super::style;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 380.0;
/// Side of a panel, which shows 0 to 1 both ways.
const SIDE: f64 = 270.0;
const TOP: f64 = 48.0;
/// Left edges of the panels.
const PANELS: [f64; 2] = [64.0, 450.0];

/// The section of the page; empty where there is nothing to show.
pub fn section(records: &[TrialRecord]) -> String {
    if !records.iter().any(|record| record.condition == Condition::Blind) {
        return String::new();
    }
    let heading = "<h2 id=\"risk\">What the predicted risk is worth</h2>\n";
    let Some(prediction) = risk_prediction(records) else {
        return format!(
            "{heading}<p>The predicted risk cannot be compared with contacts: that takes blind trials with a contact and blind \
             trials without one, in both of which the first object was felt in the hand.</p>\n"
        );
    };
    let interval = match prediction.interval {
        Some([low, high]) => format!(" [{}, {}] (95 %, Hanley and McNeil)", number(low, 3), number(high, 3)),
        None => " (too few trials, or none that it confuses: no interval)".to_string(),
    };
    let area = number(prediction.area, 3);
    format!(
        "{heading}<div class=\"figures\"><figure>\n{}<figcaption>Risk of an unwanted contact if the plan is carried out, as \
         predicted from what is felt of the first object, in {} blind trials with that object in the hand. Left: share of trials \
         with a contact that are above a threshold over the share of those without one; area {area}{interval}. \
         Right: observed contacts over predicted risk in groups of like risk, with Wilson 95 % intervals; on the \
         diagonal predictions are true. Also as <a href=\"risk.svg\">risk.svg</a>.</figcaption></figure></div>\n",
        draw(&prediction, ""),
        prediction.scored.len(),
    )
}

/// The figure as a standalone file.
pub fn standalone(records: &[TrialRecord]) -> Option<String> {
    let style = format!("<style>{}</style>\n", style::FIGURE);
    let prediction = risk_prediction(records)?;
    Some(format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}", draw(&prediction, &style)))
}

fn draw(prediction: &Prediction, style: &str) -> String {
    let description = format!(
        "ROC curve of the predicted risk, area {}; observed over predicted contact rate in {} groups",
        number(prediction.area, 3),
        prediction.groups.len()
    );
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         aria-label=\"{}\">\n{style}<rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\n<g class=\"touch\">\n",
        escape(&description)
    );
    panel(&mut svg, PANELS[0], ["ROC curve", "trials without a contact above the threshold", "with a contact"]);
    let curve: Vec<String> = prediction.roc.iter().map(|[x, y]| at(PANELS[0], *x, *y)).collect();
    let _ = writeln!(svg, "<polyline class=\"curve\" points=\"{}\"/>", curve.join(" "));
    panel(&mut svg, PANELS[1], ["Calibration", "predicted risk", "observed contact rate"]);
    let of = |group: &statistics::Group| group.observed.rate.unwrap_or(0.0);
    let line: Vec<String> = prediction.groups.iter().map(|group| at(PANELS[1], group.predicted, of(group))).collect();
    let _ = writeln!(svg, "<polyline class=\"curve\" points=\"{}\"/>", line.join(" "));
    for group in &prediction.groups {
        let (x, observed) = (across(PANELS[1], group.predicted), &group.observed);
        let [y, low, high] = [of(group), observed.low, observed.high].map(down);
        let _ = writeln!(
            svg,
            "<path class=\"whisker\" d=\"M{x:.1} {low:.1}V{high:.1}\"/><circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" \
             r=\"4\"><title>predicted {}, observed {} of {}</title></circle>",
            number(group.predicted, 3),
            observed.count,
            observed.of
        );
    }
    svg += "</g>\n</svg>\n";
    svg
}

/// The axes of the panel at `left`, and its diagonal.
fn panel(svg: &mut String, left: f64, [title, x, y]: [&str; 3]) {
    for fifth in 0..=5 {
        let value = f64::from(fifth) / 5.0;
        let (across, down) = (across(left, value), down(value));
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{}\" y1=\"{down:.1}\" y2=\"{down:.1}\"/>\
             <line class=\"grid\" x1=\"{across:.1}\" x2=\"{across:.1}\" y1=\"{TOP}\" y2=\"{}\"/>\
             <text class=\"soft\" text-anchor=\"end\" x=\"{:.1}\" y=\"{:.1}\">{value:.1}</text>\
             <text class=\"soft\" text-anchor=\"middle\" x=\"{across:.1}\" y=\"{:.1}\">{value:.1}</text>",
            left + SIDE,
            TOP + SIDE,
            left - 7.0,
            down + 4.0,
            TOP + SIDE + 17.0
        );
    }
    let middle = TOP + SIDE / 2.0;
    let _ = writeln!(
        svg,
        "<line class=\"axis\" x1=\"{left}\" x2=\"{}\" y1=\"{}\" y2=\"{TOP}\" stroke-dasharray=\"5 4\"/>\
         <text class=\"title\" x=\"{left}\" y=\"28\">{}</text>\
         <text class=\"soft\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>\
         <text class=\"soft\" text-anchor=\"middle\" transform=\"translate({:.1} {middle:.1}) rotate(-90)\">{}</text>",
        left + SIDE,
        TOP + SIDE,
        escape(title),
        left + SIDE / 2.0,
        TOP + SIDE + 38.0,
        escape(x),
        left - 38.0,
        escape(y)
    );
}

fn across(left: f64, value: f64) -> f64 {
    left + value * SIDE
}

fn down(value: f64) -> f64 {
    TOP + (1.0 - value) * SIDE
}

fn at(left: f64, x: f64, y: f64) -> String {
    format!("{:.1},{:.1}", across(left, x), down(y))
}
