//! Charts as SVG, drawn by `kuva` in the colours of the page's style sheet: light or dark like the page.

use kuva::backend::svg::SvgBackend;
use kuva::prelude::{Layout, Plot, ScatterPlot, Theme};
use kuva::render::render::{Scene, render_multiple};
use maud::{Markup, PreEscaped, html};

use crate::html::printable;
use crate::style;

/// Fonts of all text in a chart.
const FONTS: &str = "system-ui,'Helvetica Neue',Arial,sans-serif";

/// Returns the colour of a condition, or of any other name of the style sheet.
pub fn color(name: &str) -> String {
    format!("var(--{})", if name == "external" { "yours" } else { name })
}

/// Returns the colour of arm `n` of a comparison: that of its condition, or its own.
pub fn arm_color(name: &str, n: usize) -> String {
    let known = ["ideal", "blind", "reflex", "touch"].contains(&name);
    if known { color(name) } else { format!("hsl({} 45% 50%)", 40 + 67 * n % 360) }
}

fn theme() -> Theme {
    let [paper, soft, line, ink] = ["paper", "soft", "line", "ink"].map(|name| format!("var(--{name})"));
    Theme {
        background: paper.clone(),
        axis_color: soft.clone(),
        tick_color: soft,
        grid_color: line.clone(),
        text_color: ink,
        legend_bg: paper.clone(),
        legend_border: line,
        box_median: paper,
        font_family: Some(FONTS.to_owned()),
        ..Theme::light()
    }
}

/// Returns a layout for `plots` of this size in pixels, in the theme of the page.
pub fn layout(plots: &[Plot], title: &str, [width, height]: [f64; 2]) -> Layout {
    let layout = Layout::auto_from_plots(plots).with_title(title).with_width(width).with_height(height);
    layout.with_theme(theme()).with_title_size(15).with_label_size(12).with_tick_size(11).with_legend_box(false)
}

/// Returns dots with titles that show under the pointer.
pub fn dots(color: &str, points: impl IntoIterator<Item = ((f64, f64), String)>) -> ScatterPlot {
    let (points, titles): (Vec<_>, Vec<_>) = points.into_iter().unzip();
    ScatterPlot::new().with_data(points).with_color(color).with_tooltip_labels(titles)
}

/// Draws a chart for a page that includes the style. `description` is the text for screen readers.
pub fn draw(plots: Vec<Plot>, layout: Layout, description: &str) -> Markup {
    element(&render_multiple(plots, layout), description)
}

/// Converts a drawing of kuva to an element that fills the width of its place.
pub fn element(scene: &Scene, description: &str) -> Markup {
    let svg = SvgBackend::new().render_scene(scene);
    let inside = svg.split_once('>').map_or("", |(_, inside)| inside).trim_end().trim_end_matches("</svg>");
    html! {
        svg xmlns="http://www.w3.org/2000/svg" class="figure" role="img" aria-label=(description) font-family=(FONTS) fill="var(--ink)"
            style={ "max-width:" (1.5 * scene.width) "px" } viewBox={ "0 0 " (scene.width) " " (scene.height) } { (PreEscaped(inside)) }
    }
}

/// Returns the chart as a separate file.
pub fn standalone(chart: &Markup) -> String {
    let style = html! { style { (PreEscaped(style::FIGURE_CSS)) } }.into_string();
    let chart = chart.0.replacen('>', &format!(">{style}"), 1);
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n", printable(PreEscaped(chart)))
}
