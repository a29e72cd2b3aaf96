//! The paper's box plots as SVG. Each condition has its dots (one per object combination), a box from the 25th to the 75th
//! percentile with the median and whiskers to the extremes, and the shaded kernel density.
//!
//! The paper draws the three on top of each other; here they are side by side so that none hides another: dots on the left, the
//! box in the middle, the density on the right. Dots of equal rate are laid out sideways; where a row is full, further rows
//! follow closely above and below it.
//!
//! Colours come from the page's style sheet (light and dark), and every dot has a `<title>` with its name and value. A charting
//! crate's SVG has neither, so the figure is written by hand.

use std::fmt::Write as _;

use super::html::{escape, number};
use super::style;

/// Size of the drawing.
const WIDTH: f64 = 540.0;
const HEIGHT: f64 = 430.0;
/// Where the axes' rectangle lies in it.
const LEFT: f64 = 50.0;
const RIGHT: f64 = WIDTH - 8.0;
const TOP: f64 = 88.0;
const BOTTOM: f64 = HEIGHT - 66.0;
/// The rates the axis shows: a little more than there are, so that dots at the ends keep clear of the frame.
const RANGE: (f64, f64) = (-0.05, 1.05);
const DOT_RADIUS: f64 = 2.2;
const DOT_PITCH: f64 = 4.9;
/// Dots in a row.
const DOTS_PER_ROW: usize = 13;
/// Densities below this share of the highest are not drawn.
const FAINT: f64 = 0.004;

/// One condition's column.
#[derive(Debug, Clone)]
pub struct Group {
    /// Name under the column; also its class, which colours it.
    pub name: String,
    /// Rate of every combination, with the combination's name.
    pub dots: Vec<(f64, String)>,
    /// Minimum, 25 %, median, 75 %, maximum.
    pub quartiles: Option<[f64; 5]>,
    /// Mean and standard deviation.
    pub mean_sd: Option<(f64, f64)>,
    /// Density over rate, ascending in rate.
    pub shade: Vec<(f64, f64)>,
}

#[derive(Debug, Clone)]
pub struct Figure {
    /// Over the drawing.
    pub title: String,
    /// Along the vertical axis.
    pub axis: String,
    /// In words, for who cannot see it.
    pub description: String,
    /// Columns, left to right.
    pub groups: Vec<Group>,
    /// Which two columns a test compared, and its outcome.
    pub bracket: Option<(usize, usize, String)>,
}

impl Figure {
    /// The figure for the page, which brings the style.
    pub fn inline(&self) -> String {
        self.draw("")
    }

    /// The figure as a standalone file.
    pub fn standalone(&self) -> String {
        let style = format!("<style>{}</style>\n", style::FIGURE);
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}", self.draw(&style))
    }

    fn draw(&self, style: &str) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
             aria-label=\"{}\">\n{style}<rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\n\
             <text class=\"title\" x=\"8\" y=\"22\">{}</text>\n",
            escape(&self.description),
            escape(&self.title)
        );
        self.axes(&mut svg);
        for (index, group) in self.groups.iter().enumerate() {
            column(&mut svg, self.centre(index), self.pitch(), group);
        }
        self.bracket(&mut svg);
        svg += "</svg>\n";
        svg
    }

    /// Width of a column.
    fn pitch(&self) -> f64 {
        (RIGHT - LEFT) / self.groups.len().max(1) as f64
    }

    /// Middle of column `index`.
    fn centre(&self, index: usize) -> f64 {
        LEFT + self.pitch() * (index as f64 + 0.5)
    }

    fn axes(&self, svg: &mut String) {
        rate_grid(svg, [LEFT, RIGHT], height);
        let middle = (TOP + BOTTOM) / 2.0;
        let _ = writeln!(
            svg,
            "<line class=\"axis\" x1=\"{LEFT}\" x2=\"{LEFT}\" y1=\"{TOP}\" y2=\"{BOTTOM}\"/>\
             <text class=\"soft\" text-anchor=\"middle\" transform=\"translate(14 {middle:.1}) rotate(-90)\">{}</text>",
            escape(&self.axis)
        );
    }

    /// The bracket over the two columns a test compared.
    fn bracket(&self, svg: &mut String) {
        let Some((from, to, text)) = &self.bracket else { return };
        let (a, b) = (self.centre(*from), self.centre(*to));
        let y = TOP - 22.0;
        let _ = writeln!(
            svg,
            "<path class=\"bracket\" d=\"M{a:.1} {:.1}V{y:.1}H{b:.1}V{:.1}\"/>\
             <text text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            y + 8.0,
            y + 8.0,
            (a + b) / 2.0,
            y - 7.0,
            escape(text)
        );
    }
}

/// Lines at the fifths of a rate from 0 to 1, with their values on the left.
pub fn rate_grid(svg: &mut String, [left, right]: [f64; 2], height: impl Fn(f64) -> f64) {
    for tenth in [0, 2, 4, 6, 8, 10] {
        let rate = f64::from(tenth) / 10.0;
        let y = height(rate);
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
             <text class=\"soft\" text-anchor=\"end\" x=\"{:.1}\" y=\"{:.1}\">{rate:.1}</text>",
            left - 7.0,
            y + 4.0
        );
    }
}

/// Where a rate lies on the drawing, from its top.
fn height(rate: f64) -> f64 {
    BOTTOM - (rate - RANGE.0) / (RANGE.1 - RANGE.0) * (BOTTOM - TOP)
}

/// Draws one condition around the vertical at `x`.
fn column(svg: &mut String, x: f64, pitch: f64, group: &Group) {
    let _ = writeln!(svg, "<g class=\"{}\">", escape(&group.name));
    shade(svg, x + 16.0, (pitch / 2.0 - 26.0).min(56.0), &group.shade);
    if let Some(quartiles) = &group.quartiles {
        box_plot(svg, x + 3.0, quartiles);
    }
    if let Some((mean, _)) = group.mean_sd {
        let (x, y) = (x + 3.0, height(mean));
        let _ = writeln!(
            svg,
            "<path class=\"mean\" d=\"M{x:.1} {:.1}l3.5 3.5l-3.5 3.5l-3.5 -3.5z\"><title>mean {}</title></path>",
            y - 3.5,
            number(mean, 3)
        );
    }
    dots(svg, x - 11.0, &group.dots);
    svg.push_str("</g>\n");
    let n = group.dots.len();
    let mean = group
        .mean_sd
        .map_or_else(|| "no data".to_string(), |(mean, sd)| format!("{} ± {}", number(mean, 3), number(sd, 3)));
    let _ = writeln!(
        svg,
        "<text text-anchor=\"middle\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>\
         <text class=\"soft\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"{:.1}\">{mean}</text>\
         <text class=\"soft\" text-anchor=\"middle\" x=\"{x:.1}\" y=\"{:.1}\">n = {n}</text>",
        BOTTOM + 20.0,
        escape(&group.name),
        BOTTOM + 37.0,
        BOTTOM + 53.0
    );
}

/// The density's shading, its foot on the vertical at `x`, its highest point `reach` to the right of it.
fn shade(svg: &mut String, x: f64, reach: f64, density: &[(f64, f64)]) {
    let inside: Vec<_> =
        density.iter().filter(|(v, d)| v.is_finite() && d.is_finite() && (0.0..=1.0).contains(v)).collect();
    let highest = inside.iter().map(|(_, d)| *d).fold(0.0, f64::max);
    if highest <= 0.0 {
        return;
    }
    let drawn: Vec<_> = inside.into_iter().filter(|(_, density)| *density > FAINT * highest).collect();
    let (Some(first), Some(last)) = (drawn.first(), drawn.last()) else { return };
    let mut path = format!("M{x:.1} {:.1}", height(first.0));
    for (value, density) in &drawn {
        let _ = write!(path, "L{:.1} {:.1}", x + reach * density / highest, height(*value));
    }
    let _ = writeln!(svg, "<path class=\"shade\" d=\"{path}L{x:.1} {:.1}Z\"/>", height(last.0));
}

/// Box, median and whiskers around the vertical at `x`.
fn box_plot(svg: &mut String, x: f64, quartiles: &[f64; 5]) {
    if quartiles.iter().any(|v| !v.is_finite()) {
        return;
    }
    let [low, q1, median, q3, high] = quartiles.map(height);
    let (left, right) = (x - 8.0, x + 8.0);
    let _ = writeln!(
        svg,
        "<path class=\"whisker\" d=\"M{x:.1} {low:.1}V{q1:.1}M{x:.1} {q3:.1}V{high:.1}M{:.1} {low:.1}h8M{:.1} {high:.1}h8\"/>\
         <rect class=\"box\" x=\"{left:.1}\" y=\"{q3:.1}\" width=\"16\" height=\"{:.1}\"/>\
         <line class=\"median\" x1=\"{left:.1}\" x2=\"{right:.1}\" y1=\"{median:.1}\" y2=\"{median:.1}\"/>",
        x - 4.0,
        x - 4.0,
        (q1 - q3).max(0.0)
    );
}

/// The dots, to the left of the vertical at `right`.
fn dots(svg: &mut String, right: f64, dots: &[(f64, String)]) {
    let mut order: Vec<_> = dots.iter().filter(|(rate, _)| rate.is_finite()).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    for equals in order.chunk_by(|a, b| (a.0 - b.0).abs() < 1e-9) {
        let rows = equals.len().div_ceil(DOTS_PER_ROW);
        for (index, (rate, name)) in equals.iter().enumerate() {
            let (row, place) = (index % rows, index / rows);
            let x = right - DOT_PITCH * place as f64;
            let y = height(*rate) + DOT_PITCH * (row as f64 - (rows - 1) as f64 / 2.0);
            let _ = writeln!(
                svg,
                "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{DOT_RADIUS}\"><title>{}: {}</title></circle>",
                escape(name),
                number(*rate, 3)
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(name: &str, rates: &[f64]) -> Group {
        Group {
            name: name.to_string(),
            dots: rates.iter().map(|rate| (*rate, format!("<{rate}> & co"))).collect(),
            quartiles: Some([0.0, 0.25, 0.5, 0.75, 1.0]),
            mean_sd: Some((0.5, 0.3)),
            shade: vec![(0.0, 0.5), (0.5, 1.0), (1.0, 0.5)],
        }
    }

    fn figure(groups: Vec<Group>) -> Figure {
        Figure {
            title: "Rate".into(),
            axis: "rate".into(),
            description: "Rates < 1".into(),
            bracket: (groups.len() > 1).then(|| (0, 1, "p < 0.001".into())),
            groups,
        }
    }

    #[test]
    fn every_combination_is_a_dot_inside_the_drawing() {
        let spread: Vec<f64> = (0..60).map(|i| f64::from(i % 11) / 10.0).collect();
        let svg =
            figure(vec![group("ideal", &[0.0; 60]), group("blind", &spread), group("touch", &[1.0; 60])]).standalone();
        assert_eq!(svg.matches("<circle class=\"dot\"").count(), 180);
        for piece in svg.split("<circle ").skip(1) {
            let at = |name: &str| -> f64 {
                let rest = piece.split_once(&format!("{name}=\"")).unwrap().1;
                rest.split_once('"').unwrap().0.parse().unwrap()
            };
            assert!((LEFT..RIGHT).contains(&at("cx")), "{piece}");
            assert!((TOP..BOTTOM).contains(&at("cy")), "{piece}");
        }
    }

    #[test]
    fn no_two_dots_coincide() {
        let svg = figure(vec![group("touch", &[1.0; 60])]).inline();
        let places: std::collections::BTreeSet<&str> =
            svg.split("<circle ").skip(1).map(|piece| piece.split_once(" r=").unwrap().0).collect();
        assert_eq!(places.len(), 60);
    }

    #[test]
    fn names_are_escaped() {
        let svg = figure(vec![group("blind", &[0.5])]).inline();
        assert!(svg.contains("&lt;0.5&gt; &amp; co: 0.500"));
        assert!(svg.contains("aria-label=\"Rates &lt; 1\""));
    }

    #[test]
    fn nothing_to_draw_draws_axes() {
        let empty = Group { name: "blind".into(), dots: vec![], quartiles: None, mean_sd: None, shade: vec![] };
        assert!(figure(vec![empty.clone(), empty]).inline().contains("no data"));
        assert!(figure(vec![]).inline().ends_with("</svg>\n"));
        let odd = Group { quartiles: Some([f64::NAN; 5]), shade: vec![(0.0, f64::NAN)], ..group("touch", &[f64::NAN]) };
        assert!(!figure(vec![odd]).inline().contains("NaN"));
    }
}
