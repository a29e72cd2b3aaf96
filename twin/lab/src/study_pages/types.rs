//! The distribution of types over objects as a picture: a bar an object, a piece of it a type.

use std::fmt::Write as _;

use report::html::escape;
use study::rules::Distribution;
use study::taxonomy::{Category, Taxonomy};

/// Shades of a category's colour: power red, intermediate yellow, precision green, as in the paper.
pub fn color(taxonomy: &Taxonomy, kind: usize) -> String {
    let category = taxonomy.types[kind].category;
    let own: Vec<usize> = (0..taxonomy.types.len()).filter(|k| taxonomy.types[*k].category == category).collect();
    let place = own.iter().position(|k| *k == kind).unwrap_or(0) as f64 / own.len() as f64;
    let (hue, width) = match category {
        Category::Power => (350.0, 42.0),
        Category::Intermediate => (46.0, 14.0),
        Category::Precision => (105.0, 70.0),
    };
    // Neighbours differ in lightness as well, so that grey prints can be read.
    let light = [44.0, 60.0, 73.0][own.iter().position(|k| *k == kind).unwrap_or(0) % 3];
    format!("hsl({:.0} 62% {light:.0}%)", (hue + width * place) % 360.0)
}

/// The picture.
pub fn svg(taxonomy: &Taxonomy, found: &Distribution) -> String {
    let (left, top, row, width) = (120.0, 34.0, 21.0, 620.0);
    let height = (top + row * found.objects.len() as f64 + 40.0).max(top + 19.0 * 19.0 + 20.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1000 {height}\" font-family=\"system-ui,Arial,sans-serif\" \
         font-size=\"12\"><rect width=\"1000\" height=\"{height}\" fill=\"#fff\"/>\n<text x=\"8\" y=\"20\" font-size=\"15\" \
         font-weight=\"600\">Grasp types of {} verified grasps, share of each object's</text>\n",
        found.totals().iter().sum::<usize>()
    );
    for (n, object) in found.objects.iter().enumerate() {
        let y = top + row * n as f64;
        let of: usize = found.counts[n].iter().sum();
        let _ =
            write!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>", left - 6.0, y + 14.0, escape(object));
        let mut x = left;
        for (kind, count) in found.counts[n].iter().enumerate().filter(|(_, count)| **count > 0) {
            let part = width * *count as f64 / of as f64;
            let _ = write!(
                svg,
                "<rect x=\"{x:.1}\" y=\"{y}\" width=\"{part:.1}\" height=\"{}\" fill=\"{}\"><title>{object}: {} \
                 {count}</title></rect>",
                row - 4.0,
                color(taxonomy, kind),
                escape(&taxonomy.types[kind].name)
            );
            x += part;
        }
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\" fill=\"#56626b\">{of}</text>", left + width + 6.0, y + 14.0);
    }
    let totals = found.totals();
    for (kind, entry) in taxonomy.types.iter().enumerate() {
        let y = top + 19.0 * kind as f64;
        let _ = writeln!(
            svg,
            "<rect x=\"790\" y=\"{y}\" width=\"13\" height=\"13\" fill=\"{}\"/><text x=\"808\" y=\"{}\">{} {}</text>",
            color(taxonomy, kind),
            y + 11.0,
            escape(&entry.name),
            totals.get(kind).copied().unwrap_or(0)
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{left}\" y=\"{}\" fill=\"#56626b\">{} ambiguous grasps are counted under their best type</text>\n</svg>",
        top + row * found.objects.len() as f64 + 16.0,
        found.ambiguous.iter().sum::<usize>()
    );
    svg
}

#[cfg(test)]
mod tests {
    use super::*;
    use study::rules::Decision;

    #[test]
    fn every_type_has_its_own_colour_and_every_object_its_bar() {
        let taxonomy = Taxonomy::paper();
        let mut colors: Vec<String> = (0..19).map(|kind| color(&taxonomy, kind)).collect();
        colors.sort();
        colors.dedup();
        assert_eq!(colors.len(), 19);
        let decision = |kind| Decision { kind, margin: 1.0, second: (0, 0.0), ambiguous: false };
        let made = [("ball", decision(8)), ("vase", decision(3)), ("vase", decision(8))];
        let found = Distribution::of(&taxonomy, made.iter().map(|(object, decision)| (*object, decision)));
        let text = svg(&taxonomy, &found);
        assert!(text.contains(">ball<") && text.contains(">vase<") && text.contains("vase: Ring 1"));
    }
}
