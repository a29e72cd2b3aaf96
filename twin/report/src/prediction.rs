//! Quality of the predicted risk of the blind trials: its ROC curve and its calibration curve, side by side.

use kuva::prelude::{Figure, Layout, LinePlot, Plot, TickFormat};
use maud::{Markup, html};
use scenarios::summary::risk_prediction;
use scenarios::{Condition, TrialRecord};
use statistics::PredictionQuality;

use super::chart::{self, color};
use super::html::format_number;

/// Size of a panel, pixels.
const PANEL_SIZE: [f64; 2] = [370.0, 380.0];

/// Returns the section of the page; empty if there is nothing to show.
pub fn section(records: &[TrialRecord]) -> Markup {
    let blind = records.iter().any(|record| record.condition == Condition::Blind);
    let prediction = risk_prediction(records);
    let interval = match prediction.as_ref().and_then(|prediction| prediction.interval) {
        Some([low, high]) => {
            format!(" [{}, {}] (95 %, Hanley and McNeil)", format_number(low, 3), format_number(high, 3))
        }
        None => " (too few trials, or no misranked pair: no interval)".to_string(),
    };
    html! { @if blind {
        h2 id="risk" { "Quality of the predicted risk" }
        @match &prediction {
            None => p {
                "The predicted risk cannot be compared with contacts: this takes blind trials with a contact and blind \
                 trials without one, both with a pose estimate of the first object in the hand."
            }
            Some(prediction) => div.figures { figure {
                (draw(prediction))
                figcaption {
                    "Risk of an unwanted contact of the planned grasp, as predicted from the pose estimate of the first object, in "
                    (prediction.scored.len()) " blind trials with that object in the hand. Left: share of trials with a contact that are \
                    above a threshold over the share of those without one; area " (format_number(prediction.area, 3)) (interval) ". Right: \
                    observed contacts over predicted risk in groups of similar risk, with Wilson 95 % intervals; on the diagonal \
                    predictions are correct. Also as " a href="risk.svg" { "risk.svg" } "."
                }
            } }
        }
    } }
}

/// Returns the figure as a standalone file.
pub fn standalone(records: &[TrialRecord]) -> Option<String> {
    Some(chart::standalone(&draw(&risk_prediction(records)?)))
}

fn draw(prediction: &PredictionQuality) -> Markup {
    let description = format!(
        "ROC curve of the predicted risk, area {}; observed over predicted contact rate in {} groups",
        format_number(prediction.area, 3),
        prediction.groups.len()
    );
    let of = |group: &statistics::CalibrationGroup| group.observed.rate.unwrap_or(0.0);
    let curve = |points: Vec<(f64, f64)>| LinePlot::new().with_data(points).with_color(color("touch"));
    let roc = curve(prediction.roc.iter().map(|[x, y]| (*x, *y)).collect());
    let line = curve(prediction.groups.iter().map(|group| (group.predicted, of(group))).collect());
    let titled = |group: &statistics::CalibrationGroup| {
        let (predicted, observed) = (format_number(group.predicted, 3), &group.observed);
        ((group.predicted, of(group)), format!("predicted {predicted}, observed {} of {}", observed.count, observed.of))
    };
    let reach = prediction.groups.iter().map(|group| (of(group) - group.observed.low, group.observed.high - of(group)));
    let dots =
        chart::dots(&color("touch"), prediction.groups.iter().map(titled)).with_y_err_asymmetric(reach).with_size(4.0);
    let diagonal = || LinePlot::new().with_data([(0.0, 0.0), (1.0, 1.0)]).with_color("var(--soft)").with_dashed();
    let panels: Vec<Vec<Plot>> =
        vec![vec![diagonal().into(), roc.into()], vec![diagonal().into(), line.into(), dots.into()]];
    let names = [
        ["ROC curve", "trials without a contact above the threshold", "with a contact"],
        ["Calibration", "predicted risk", "observed contact rate"],
    ];
    let layouts: Vec<Layout> = panels
        .iter()
        .zip(names)
        .map(|(plots, [title, x, y])| {
            let layout = chart::layout(plots, title, PANEL_SIZE).with_x_label(x).with_y_label(y);
            let layout =
                layout.with_x_axis_min(-0.04).with_x_axis_max(1.04).with_y_axis_min(-0.04).with_y_axis_max(1.04);
            layout.with_x_tick_step(0.2).with_y_tick_step(0.2).with_tick_format(TickFormat::Fixed(1))
        })
        .collect();
    let figure =
        Figure::new(1, 2).with_plots(panels).with_layouts(layouts).with_cell_size(PANEL_SIZE[0], PANEL_SIZE[1]);
    chart::element(&figure.render(), &description)
}
