//! Disconnectivity tree as SVG: leaves at their energies, with circles sized by their basins and coloured by broad
//! type.

use dexterous_grasping::taxonomy::Category;
use grasp_analysis::landscape::disconnectivity::DisconnectivityTree;
use maud::{Markup, html};

/// A leaf of the tree: one basin.
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

/// Draws the tree.
pub fn svg(tree: &DisconnectivityTree, leaves: &[Leaf], title: &str) -> Markup {
    let n = tree.energies.len();
    let pitch = (1100.0 / n.max(1) as f64).clamp(15.0, 60.0);
    let width = (LEFT + pitch * n as f64 + 30.0).round();
    let heights = tree.merges.iter().map(|merge| merge.height);
    let (low, high) = tree
        .energies
        .iter()
        .copied()
        .chain(heights)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let span = (high - low).max(1e-9);
    let y = |energy: f64| BOTTOM - (energy - low) / span * (BOTTOM - TOP - 40.0);
    let places = tree.horizontal_positions();
    let x = |branch: usize| LEFT + pitch * (places[branch] + 0.5);
    let mut lines = Vec::new();
    let mut parent = vec![None; n + tree.merges.len()];
    for (k, merge) in tree.merges.iter().enumerate() {
        merge.branches.iter().for_each(|branch| parent[*branch] = Some(k));
        lines.push(([x(merge.branches[0]), y(merge.height), x(merge.branches[1]), y(merge.height)], None));
    }
    for (branch, parent) in parent.iter().enumerate() {
        let from = if branch < n { tree.energies[branch] } else { tree.merges[branch - n].height };
        // A branch without a known path to others ends in a dotted line.
        let (to, dashes) = parent.map_or((y(high) - 22.0, Some("2 4")), |k| (y(tree.merges[k].height), None));
        lines.push(([x(branch), y(from), x(branch), to], dashes));
    }
    let tenth = |x: f64| format!("{x:.1}");
    html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height="620" viewBox={ "0 0 " (width) " 620" } font-family="system-ui,Arial,sans-serif" font-size="12" {
            rect width=(width) height="620" fill="#fff" {}
            text x="8" y="20" font-size="15" font-weight="600" { (title) }
            @for energy in (0..=5).map(|tick| low + span * f64::from(tick) / 5.0) {
                line x1=(LEFT) x2=(width) y1=(tenth(y(energy))) y2=(tenth(y(energy))) stroke="#e6eaed" {}
                text x=(LEFT - 6.0) y=(tenth(y(energy) + 4.0)) text-anchor="end" fill="#56626b" { (format!("{energy:.2}")) }
            }
            text x="8" y=(TOP - 8.0) fill="#56626b" { "energy" }
            @for (ends, dashes) in lines {
                @let [x1, y1, x2, y2] = ends.map(tenth);
                line x1=(x1) y1=(y1) x2=(x2) y2=(y2) stroke="#3d4a52" stroke-width="1.4" stroke-dasharray=[dashes] {}
            }
            @for (n, Leaf { members, category, grasp, text }) in leaves.iter().enumerate() {
                circle data-grasp=(grasp) data-text=(text) cx=(tenth(x(n))) cy=(tenth(y(tree.energies[n])))
                    r=(tenth((2.6 * (*members as f64).sqrt()).clamp(3.0, 24.0))) fill=(color(*category)) fill-opacity=".88" stroke="#fff" { title { (text) } }
            }
            @for (k, category) in Category::ALL.into_iter().enumerate() {
                @let at = LEFT + 130.0 * k as f64;
                circle cx=(at) cy="600" r="6" fill=(color(category)) {}
                text x=(at + 11.0) y="604" { (category.name()) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use grasp_analysis::landscape::disconnectivity::tree;

    #[test]
    fn every_basin_has_its_circle() {
        let found = tree(&[0.0, 0.5, 1.0], &[(0, 1, 2.0)]);
        let leaf = |n| Leaf { members: 1 + n, category: Category::Power, grasp: n, text: format!("basin <{n}>") };
        let text = svg(&found, &[leaf(0), leaf(1), leaf(2)], "three").into_string();
        assert_eq!(text.matches("data-grasp").count(), 3);
        assert!(text.contains("basin &lt;2&gt;") && text.matches("stroke-dasharray").count() == 2);
    }
}
