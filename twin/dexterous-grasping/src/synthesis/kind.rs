//! Grasps by kind, each with its best one.

use std::collections::BTreeMap;

use serde::Serialize;

use super::diversity::{digit_set, opposition};
use super::held::HeldGrasp;

/// A kind of grasp: the number of its grasps, and the one with the largest wrench margin.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct GraspKind<'a> {
    /// Name of the kind, as text.
    #[serde(rename = "kind")]
    pub name: String,
    /// Number of grasps of this kind.
    pub count: usize,
    /// Grasp with the largest wrench margin.
    pub best: &'a HeldGrasp,
}

/// Sorts `grasps` into kinds by `name`, the most frequent first. The best is the first with the largest margin.
pub fn grasp_kinds(grasps: &[HeldGrasp], name: impl Fn(&HeldGrasp) -> String) -> Vec<GraspKind<'_>> {
    let mut found: BTreeMap<String, GraspKind<'_>> = BTreeMap::new();
    for grasp in grasps {
        let name = name(grasp);
        let kind = found.entry(name.clone()).or_insert(GraspKind { name, count: 0, best: grasp });
        kind.count += 1;
        if grasp.margin > kind.best.margin {
            kind.best = grasp;
        }
    }
    let mut kinds: Vec<GraspKind<'_>> = found.into_values().collect();
    kinds.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.name.cmp(&b.name)));
    kinds
}

/// Sorts the F-TAC Hand's `grasps` into kinds, the most frequent first. A kind is a set of digits with a kind of
/// opposition.
pub fn ftac_grasp_kinds(grasps: &[HeldGrasp]) -> Vec<GraspKind<'_>> {
    grasp_kinds(grasps, |grasp| format!("{} {}", digit_set(grasp), opposition(grasp).name()))
}

/// Formats the kinds as a table with a line per kind.
pub fn table(kinds: &[GraspKind<'_>]) -> String {
    let by_digits = kinds.iter().any(|kind| kind.best.digit_use.is_some());
    let width = kinds.iter().map(|kind| kind.name.len()).max().unwrap_or(0).max(if by_digits { 18 } else { 4 });
    let mut text = format!("{:width$} {:>5} {:>8}", "kind", "count", "margin N");
    text +=
        &if by_digits { format!(" {:>8} {:>8}\n", "room mm", "moved mm") } else { format!(" {:>9}\n", "payload g") };
    let millimetres =
        |length: Option<f64>, places: usize| length.map_or("-".into(), |m| format!("{:.places$}", 1e3 * m));
    for GraspKind { name, count, best } in kinds {
        text += &format!("{name:width$} {count:5} {:8.2}", best.margin);
        text += &if by_digits {
            let room = best.digit_use.as_ref().and_then(|used| used.room);
            format!(" {:>8} {:>8}\n", millimetres(room, 0), millimetres(best.moved.map(|[far, _]| far), 1))
        } else {
            format!(
                " {:>9}\n",
                best.verified_load.map_or("-".into(), |verification| format!("{:.0}", 1e3 * verification.payload))
            )
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use hand_model::Digit;

    use super::super::held::tests::{grasp, used};
    use super::*;

    /// Kinds come by frequency. Each keeps its grasp with the largest margin.
    #[test]
    fn the_most_frequent_kind_comes_first() {
        let of = |digits: &[Digit], margin: f64| HeldGrasp { digit_use: Some(used(digits)), margin, ..grasp() };
        let (two, three) = (&[Digit::Thumb, Digit::Index][..], &[Digit::Thumb, Digit::Index, Digit::Middle][..]);
        let all = [of(two, 3.0), of(three, 1.0), of(three, 2.0), of(three, 1.5)];
        let found = ftac_grasp_kinds(&all);
        assert_eq!(found.iter().map(|kind| (kind.count, kind.best.margin)).collect::<Vec<_>>(), [(3, 2.0), (1, 3.0)]);
        assert_ne!(found[0].name, found[1].name);
    }
}
