//! Distribution of types over objects as a bar chart: one bar per object, one segment per type.

use dexterous_grasping::taxonomy::{Category, Taxonomy};
use grasp_analysis::distribution::Distribution;
use kuva::prelude::{BarPlot, Plot};
use maud::Markup;
use report::chart;

/// Returns the colour of a type, a shade of its category's: power red, intermediate yellow, precision green, as in the
/// paper.
pub fn color(taxonomy: &Taxonomy, kind: usize) -> String {
    let category = taxonomy.types[kind].category;
    let own: Vec<usize> = (0..taxonomy.types.len()).filter(|k| taxonomy.types[*k].category == category).collect();
    let place = own.iter().position(|k| *k == kind).unwrap_or(0) as f64 / own.len() as f64;
    let (hue, width) = match category {
        Category::Power => (350.0, 42.0),
        Category::Intermediate => (46.0, 14.0),
        Category::Precision => (105.0, 70.0),
    };
    // Neighbours differ in lightness as well, so that grey prints are readable.
    let light = [44.0, 60.0, 73.0][own.iter().position(|k| *k == kind).unwrap_or(0) % 3];
    format!("hsl({:.0} 62% {light:.0}%)", (hue + width * place) % 360.0)
}

/// Draws the chart.
pub fn svg(taxonomy: &Taxonomy, found: &Distribution) -> Markup {
    let totals = found.totals();
    let legend =
        taxonomy.types.iter().zip(&totals).map(|(kind, total)| format!("{} {total}", kind.name)).collect::<Vec<_>>();
    let (mut bars, mut titles) = (BarPlot::new().with_stacked().with_horizontal(true), Vec::new());
    // The first object is at the top.
    for (object, counts) in found.objects.iter().zip(&found.counts).rev() {
        let of: usize = counts.iter().sum();
        let parts = counts.iter().enumerate().map(|(kind, count)| (*count as f64 / of as f64, color(taxonomy, kind)));
        bars = bars.with_group(format!("{object} ({of})"), parts);
        titles
            .extend(counts.iter().zip(&taxonomy.types).map(|(count, kind)| format!("{object}: {} {count}", kind.name)));
    }
    let bars = bars.with_legend(legend.iter().map(String::as_str).collect()).with_tooltip_labels(titles);
    let plots: Vec<Plot> = vec![bars.into()];
    let title = format!("Grasp types of {} verified grasps, share of each object's", totals.iter().sum::<usize>());
    let size = [1000.0, (110.0 + 21.0 * found.objects.len() as f64).max(480.0)];
    let ambiguous =
        format!("{} ambiguous grasps are counted under their best type", found.ambiguous.iter().sum::<usize>());
    let layout = chart::layout(&plots, &title, size).with_x_axis_min(0.0).with_x_axis_max(1.0).with_x_label(ambiguous);
    chart::draw(plots, layout, &title)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dexterous_grasping::taxonomy::rules::RuleDecision;

    #[test]
    fn every_type_has_its_own_colour_and_every_object_its_bar() {
        let taxonomy = Taxonomy::paper();
        let mut colors: Vec<String> = (0..19).map(|kind| color(&taxonomy, kind)).collect();
        colors.sort();
        colors.dedup();
        assert_eq!(colors.len(), 19);
        let decision = |kind| RuleDecision { kind, margin: 1.0, second: (0, 0.0), ambiguous: false };
        let made = [("ball", decision(8)), ("vase", decision(3)), ("vase", decision(8))];
        let found = Distribution::from_decisions(&taxonomy, made.iter().map(|(object, decision)| (*object, decision)));
        let text = svg(&taxonomy, &found).into_string();
        assert!(text.contains(">ball (1)<") && text.contains(">vase (2)<") && text.contains("vase: Ring 1"));
    }
}
