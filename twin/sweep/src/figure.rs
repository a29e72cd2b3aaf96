//! A curve over an axis: one line per arm with its 95 % intervals.

use kuva::prelude::{LinePlot, Plot, TickFormat};
use maud::Markup;
use report::chart;
use report::html::format_number;

use crate::curve::RateEstimate;

/// Size of the drawing, pixels.
const DRAWING_SIZE: [f64; 2] = [540.0, 360.0];
/// Offset between neighbouring lines as a share of the axis, so that their intervals do not cover each other.
const LINE_OFFSET: f64 = 0.012;

/// Line of an arm.
pub struct Line {
    pub name: String,
    /// Position on the horizontal axis, and rate.
    pub points: Vec<(f64, RateEstimate)>,
}

/// Lines over an axis.
pub struct Figure {
    pub title: String,
    /// Label of the axis.
    pub axis: String,
    /// Labels at 1, 2, ... on the axis; none for a numeric axis.
    pub categories: Option<Vec<String>>,
    pub lines: Vec<Line>,
}

impl Figure {
    /// Draws the figure for a page that includes the report's style.
    pub fn draw(&self) -> Markup {
        let places = || self.lines.iter().flat_map(|line| &line.points).map(|(x, _)| *x);
        let span = places().fold(f64::NEG_INFINITY, f64::max) - places().fold(f64::INFINITY, f64::min);
        let mut plots: Vec<Plot> = Vec::new();
        for (n, Line { name, points }) in self.lines.iter().enumerate() {
            let aside = (n as f64 - (self.lines.len() as f64 - 1.0) / 2.0) * LINE_OFFSET * span;
            let at = |(x, rate): &(f64, RateEstimate)| (x + aside, rate.value);
            let reach = |(_, rate): &(f64, RateEstimate)| {
                (rate.value - rate.low.unwrap_or(rate.value), rate.high.unwrap_or(rate.value) - rate.value)
            };
            let title =
                |(_, rate): &(f64, RateEstimate)| format!("{name}: {} of {}", format_number(rate.value, 3), rate.n);
            let color = chart::arm_color(name, n);
            let line = LinePlot::new().with_data(points.iter().map(at)).with_y_err_asymmetric(points.iter().map(reach));
            plots.push(line.with_color(color.clone()).with_legend(name).into());
            plots.push(chart::dots(&color, points.iter().map(|point| (at(point), title(point)))).with_size(3.4).into());
        }
        let layout = chart::layout(&plots, &self.title, DRAWING_SIZE).with_x_label(&self.axis);
        let layout = layout.with_y_axis_min(-0.04).with_y_axis_max(1.04).with_y_tick_step(0.2);
        let layout = layout.with_y_tick_format(TickFormat::Fixed(1));
        let layout = match &self.categories {
            Some(categories) => {
                let ends = (0.5, categories.len() as f64 + 0.5);
                layout.with_x_categories(categories.clone()).with_x_axis_min(ends.0).with_x_axis_max(ends.1)
            }
            None => layout,
        };
        chart::draw(plots, layout, &self.title)
    }
}
