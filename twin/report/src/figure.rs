//! Box plots of the paper. Each condition has its dots (one per object combination), a box from the 25th to the 75th
//! percentile with the median, the mean with whiskers to the extremes, and the shaded kernel density.
//!
//! The paper draws them on top of each other. Here they are side by side so that none hides another: dots on the left,
//! the box in the middle, the density on the right. Dots of equal rate are spread sideways; when a row is full, further
//! rows follow closely above and below it.

use kuva::prelude::{LinePlot, MarkerShape, Plot, RaincloudPlot, ScatterPlot, TextAnnotation, TickFormat};
use maud::Markup;

use super::chart;
use super::html::format_number;

/// Size of a drawing of four columns and one bracket, pixels.
const BASE_SIZE: [f64; 2] = [540.0, 430.0];
/// Additional size per further column (width) and per further bracket (height), pixels.
const EXTRA_SIZE: [f64; 2] = [90.0, 36.0];
/// Range of rates on the axis: with room for dots at the ends, and for numbers and a bracket above.
const RATE_RANGE: [f64; 2] = [-0.06, 1.36];
/// Height of a bracket with its text, in rates.
const BRACKET_HEIGHT: f64 = 0.13;
/// Spacing of dots, in columns and in rates.
const DOT_PITCH: [f64; 2] = [0.026, 0.018];
/// Dots in a row.
const DOTS_PER_ROW: usize = 13;

/// One condition's column.
#[derive(Debug, Clone)]
pub struct Group {
    /// Name under the column.
    pub name: String,
    /// Colour of the drawing, in SVG notation.
    pub color: String,
    /// Rate of every combination, with the combination's name. Empty for published figures.
    pub dots: Vec<(f64, String)>,
    /// Number of combinations.
    pub count: usize,
    /// Mean and standard deviation.
    pub mean_sd: Option<(f64, f64)>,
}

#[derive(Debug, Clone)]
pub struct Figure {
    /// Title above the drawing.
    pub title: String,
    /// Label of the vertical axis.
    pub axis: String,
    /// Description in words, for screen readers.
    pub description: String,
    /// Columns, left to right.
    pub groups: Vec<Group>,
    /// Brackets: the two columns that a test compared, and its outcome. The lowest bracket comes first.
    pub brackets: Vec<(usize, usize, String)>,
}

impl Figure {
    /// Draws the figure for a page that includes the style.
    pub fn draw(&self) -> Markup {
        let groups = || self.groups.iter().enumerate().map(|(n, group)| (n as f64 + 1.0, group));
        let values = |group: &Group| group.dots.iter().map(|(rate, _)| *rate).filter(|rate| rate.is_finite()).collect();
        let cloud = RaincloudPlot::new()
            .with_groups(self.groups.iter().map(|group| (group.name.clone(), values(group))))
            .with_group_colors(self.groups.iter().map(|group| group.color.clone()))
            .with_rain(false)
            .with_cloud_alpha(0.28);
        let mut plots: Vec<Plot> = vec![cloud.into()];
        for (x, group) in groups() {
            plots.push(dots(x, group).into());
            plots.extend(mean(x, group).into_iter().flatten().map(Plot::from));
        }
        for (n, (from, to, _)) in self.brackets.iter().enumerate() {
            let [a, b] = [from, to].map(|n| *n as f64 + 1.0);
            let [low, high] = [1.21, 1.23].map(|y| y + BRACKET_HEIGHT * n as f64);
            let corners = vec![(a, low), (a, high), (b, high), (b, low)];
            plots.push(LinePlot::new().with_data(corners).with_color("var(--soft)").with_stroke_width(1.0).into());
        }
        let [columns, brackets] = [self.groups.len(), self.brackets.len()].map(|n| n as f64);
        let size = [
            BASE_SIZE[0] + EXTRA_SIZE[0] * (columns - 4.0).max(0.0),
            BASE_SIZE[1] + EXTRA_SIZE[1] * (brackets - 1.0).max(0.0),
        ];
        let mut layout = chart::layout(&plots, &self.title, size)
            .with_x_categories(self.groups.iter().map(|group| group.name.clone()).collect())
            .with_y_label(&self.axis)
            .with_y_axis_min(RATE_RANGE[0])
            .with_y_axis_max(RATE_RANGE[1] + BRACKET_HEIGHT * (brackets - 1.0).max(0.0))
            .with_y_tick_step(0.2)
            .with_y_tick_format(TickFormat::Custom(std::sync::Arc::new(|rate| match (-0.01..1.01).contains(&rate) {
                true => format!("{:.1}", rate.abs()),
                false => String::new(),
            })));
        for (x, group) in groups() {
            let mean = |(mean, sd): (f64, f64)| format!("{} ± {}", format_number(mean, 3), format_number(sd, 3));
            let words = [group.mean_sd.map_or("no data".to_owned(), mean), format!("n = {}", group.count)];
            for (y, words) in [1.13, 1.06].into_iter().zip(words) {
                layout = layout.with_annotation(TextAnnotation::new(words, x, y));
            }
        }
        for (n, (from, to, text)) in self.brackets.iter().enumerate() {
            let (x, y) = ((from + to) as f64 / 2.0 + 1.0, 1.24 + BRACKET_HEIGHT * n as f64);
            layout = layout.with_annotation(TextAnnotation::new(text, x, y));
        }
        chart::draw(plots, layout, &self.description)
    }
}

/// Returns the mean of the column at `x`: a diamond with a lighter one in it, with whiskers to the extremes. Without
/// dots the whiskers are one standard deviation long.
fn mean(x: f64, group: &Group) -> Option<[ScatterPlot; 2]> {
    let (mean, sd) = group.mean_sd?;
    let rates = || group.dots.iter().map(|(rate, _)| *rate);
    let (low, high) = match group.dots.is_empty() {
        true => ((mean - sd).max(0.0), (mean + sd).min(1.0)),
        false => (rates().fold(mean, f64::min), rates().fold(mean, f64::max)),
    };
    let diamond = |color: &str, size: f64| {
        let dot = chart::dots(color, [((x, mean), format!("mean {}", format_number(mean, 3)))]);
        dot.with_marker(MarkerShape::Diamond).with_size(size)
    };
    let whiskers = diamond(&group.color, 5.0).with_y_err_asymmetric([(mean - low, high - mean)]);
    Some([whiskers, diamond("var(--paper)", 3.4)])
}

/// Returns the dots to the left of the column at `x`.
fn dots(x: f64, group: &Group) -> ScatterPlot {
    let mut order: Vec<_> = group.dots.iter().filter(|(rate, _)| rate.is_finite()).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rows = order.chunk_by(|a, b| (a.0 - b.0).abs() < 1e-9).flat_map(|equals| {
        let rows = equals.len().div_ceil(DOTS_PER_ROW);
        equals.iter().enumerate().map(move |(index, (rate, name))| {
            let (row, place) = ((index % rows) as f64 - (rows - 1) as f64 / 2.0, (index / rows) as f64);
            (
                (x - 0.1 - DOT_PITCH[0] * place, rate + DOT_PITCH[1] * row),
                format!("{name}: {}", format_number(*rate, 3)),
            )
        })
    });
    chart::dots(&group.color, rows).with_size(2.2).with_marker_opacity(0.85)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(name: &str, rates: &[f64]) -> Group {
        Group {
            name: name.to_string(),
            color: chart::color(name),
            count: rates.len(),
            dots: rates.iter().map(|rate| (*rate, format!("<{rate}> & co"))).collect(),
            mean_sd: Some((0.5, 0.3)),
        }
    }

    fn drawn(groups: Vec<Group>) -> String {
        let figure = Figure {
            title: "Rate".into(),
            axis: "rate".into(),
            description: "Rates < 1".into(),
            brackets: (groups.len() > 1).then(|| (0, 1, "p < 0.001".into())).into_iter().collect(),
            groups,
        };
        figure.draw().into_string()
    }

    fn at(piece: &str, name: &str) -> f64 {
        let rest = piece.split_once(&format!("{name}=\"")).expect("an attribute").1;
        rest.split_once('"').expect("its end").0.parse().expect("a number")
    }

    #[test]
    fn every_combination_is_a_dot_inside_the_drawing() {
        let spread: Vec<f64> = (0..60).map(|i| f64::from(i % 11) / 10.0).collect();
        let svg = drawn(vec![group("ideal", &[0.0; 60]), group("blind", &spread), group("touch", &[1.0; 60])]);
        assert_eq!(svg.matches("<circle ").count(), 180);
        for piece in svg.split("<circle ").skip(1) {
            assert!(
                (50.0..BASE_SIZE[0]).contains(&at(piece, "cx"))
                    && (50.0..BASE_SIZE[1] - 40.0).contains(&at(piece, "cy")),
                "{piece}"
            );
        }
    }

    /// A published figure has a mean and a standard deviation, but no dot.
    #[test]
    fn a_stated_figure_is_a_mean_with_whiskers() {
        let stated = Group { dots: vec![], count: 60, mean_sd: Some((0.9, 0.3)), ..group("blind", &[]) };
        let svg = drawn(vec![stated]);
        assert!(svg.contains("n = 60") && svg.contains("0.900 ± 0.300") && !svg.contains("<circle "), "{svg}");
    }

    #[test]
    fn no_two_dots_coincide() {
        let svg = drawn(vec![group("touch", &[1.0; 60])]);
        let places: std::collections::BTreeSet<&str> =
            svg.split("<circle ").skip(1).map(|piece| piece.split_once(" r=").expect("a radius").0).collect();
        assert_eq!(places.len(), 60);
    }

    #[test]
    fn names_are_escaped() {
        let svg = drawn(vec![group("blind", &[0.5])]);
        assert!(svg.contains("&lt;0.5&gt; &amp; co: 0.500"));
        assert!(svg.contains("aria-label=\"Rates &lt; 1\""));
    }

    #[test]
    fn nothing_to_draw_draws_axes() {
        let empty = Group { name: "blind".into(), color: chart::color("blind"), dots: vec![], count: 0, mean_sd: None };
        assert!(drawn(vec![empty.clone(), empty]).contains("no data"));
        assert!(drawn(vec![]).ends_with("</svg>"));
        assert!(!drawn(vec![group("touch", &[f64::NAN])]).contains("NaN"));
    }
}
