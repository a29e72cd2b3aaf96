//! A disconnectivity tree as SVG: leaves at their energies, with circles sized by their basins and coloured by broad type.

use std::fmt::Write as _;

use report::html::escape;
use study::landscape::disconnectivity::Tree;
use study::taxonomy::Category;

/// A leaf: one basin.
#[derive(Debug, Clone)]
pub struct Leaf {
    /// Number of grasps in the basin.
    pub members: usize,
    /// Broad type of the majority.
    pub category: Category,
    /// Index in the scene of the grasp shown.
    pub grasp: usize,
    /// Caption.
    pub text: String,
}

pub fn color(category: Category) -> &'static str {
    match category {
        Category::Power => "#c0392b",
        Category::Intermediate => "#d9a514",
        Category::Precision => "#2e8b57",
    }
}

const TOP: f64 = 50.0;
const BOTTOM: f64 = 560.0;
const LEFT: f64 = 64.0;

/// The drawing.
pub fn svg(tree: &Tree, leaves: &[Leaf], title: &str) -> String {
    let n = tree.energies.len();
    let pitch = (1100.0 / n.max(1) as f64).clamp(15.0, 60.0);
    let width = LEFT + pitch * n as f64 + 30.0;
    let heights = tree.merges.iter().map(|merge| merge.height);
    let (low, high) = tree
        .energies
        .iter()
        .copied()
        .chain(heights)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let span = (high - low).max(1e-9);
    let y = |energy: f64| BOTTOM - (energy - low) / span * (BOTTOM - TOP - 40.0);
    let places = tree.places();
    let x = |branch: usize| LEFT + pitch * (places[branch] + 0.5);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"620\" viewBox=\"0 0 {width:.0} 620\" font-family=\"system-ui,Arial,sans-serif\" \
         font-size=\"12\"><rect width=\"{width:.0}\" height=\"620\" fill=\"#fff\"/>\n<text x=\"8\" y=\"20\" font-size=\"15\" \
         font-weight=\"600\">{}</text>\n",
        escape(title)
    );
    for tick in 0..=5 {
        let energy = low + span * f64::from(tick) / 5.0;
        let at = y(energy);
        let _ = writeln!(
            svg,
            "<line x1=\"{LEFT}\" x2=\"{width:.0}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#e6eaed\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\" fill=\"#56626b\">{energy:.2}</text>",
            LEFT - 6.0,
            at + 4.0
        );
    }
    let _ = writeln!(svg, "<text x=\"8\" y=\"{}\" fill=\"#56626b\">energy</text>", TOP - 8.0);
    let mut line = |x1: f64, y1: f64, x2: f64, y2: f64, style: &str| {
        let _ = writeln!(
            svg,
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"#3d4a52\" stroke-width=\"1.4\" {style}/>"
        );
    };
    let mut parent = vec![None; n + tree.merges.len()];
    for (k, merge) in tree.merges.iter().enumerate() {
        merge.branches.iter().for_each(|branch| parent[*branch] = Some(k));
        line(x(merge.branches[0]), y(merge.height), x(merge.branches[1]), y(merge.height), "");
    }
    for (branch, parent) in parent.iter().enumerate() {
        let from = if branch < n { tree.energies[branch] } else { tree.merges[branch - n].height };
        match parent {
            Some(k) => line(x(branch), y(from), x(branch), y(tree.merges[*k].height), ""),
            // A branch without a known path to others ends in a dotted line.
            None => line(x(branch), y(from), x(branch), y(high) - 22.0, "stroke-dasharray=\"2 4\""),
        }
    }
    for (n, leaf) in leaves.iter().enumerate() {
        let _ = writeln!(
            svg,
            "<circle data-grasp=\"{}\" data-text=\"{1}\" cx=\"{2:.1}\" cy=\"{3:.1}\" r=\"{4:.1}\" fill=\"{5}\" \
             fill-opacity=\".88\" stroke=\"#fff\"><title>{1}</title></circle>",
            leaf.grasp,
            escape(&leaf.text),
            x(n),
            y(tree.energies[n]),
            (2.6 * (leaf.members as f64).sqrt()).clamp(3.0, 24.0),
            color(leaf.category)
        );
    }
    for (k, category) in Category::ALL.into_iter().enumerate() {
        let at = LEFT + 130.0 * k as f64;
        let _ = writeln!(
            svg,
            "<circle cx=\"{at}\" cy=\"600\" r=\"6\" fill=\"{}\"/><text x=\"{}\" y=\"604\">{}</text>",
            color(category),
            at + 11.0,
            category.name()
        );
    }
    svg += "</svg>\n";
    svg
}

#[cfg(test)]
mod tests {
    use super::*;
    use study::landscape::disconnectivity::tree;

    #[test]
    fn every_basin_has_its_circle() {
        let found = tree(&[0.0, 0.5, 1.0], &[(0, 1, 2.0)]);
        let leaf = |n| Leaf { members: 1 + n, category: Category::Power, grasp: n, text: format!("basin <{n}>") };
        let text = svg(&found, &[leaf(0), leaf(1), leaf(2)], "three");
        assert_eq!(text.matches("data-grasp").count(), 3);
        assert!(text.contains("basin &lt;2&gt;") && text.matches("stroke-dasharray").count() == 2);
    }
}
