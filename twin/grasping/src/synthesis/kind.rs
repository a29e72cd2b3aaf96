//! Grasps by kind, each with its best one.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;

use super::diversity::{digit_set, opposition};
use super::held::{HeldGrasp, VerifiedGrasp};

/// A kind of grasp: how many there are of it, and the one with the largest wrench margin.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Kind<'a, G> {
    /// What makes the kind, in words.
    #[serde(rename = "kind")]
    pub name: String,
    /// Grasps of this kind.
    pub count: usize,
    /// The best of them.
    pub best: &'a G,
}

/// The kinds among `grasps` by `name`, the most frequent first; the best is the first of the largest margin.
pub fn kinds<'a, G: VerifiedGrasp>(
    grasps: impl IntoIterator<Item = &'a G>,
    name: impl Fn(&G) -> String,
) -> Vec<Kind<'a, G>> {
    let mut found: BTreeMap<String, Kind<'a, G>> = BTreeMap::new();
    for grasp in grasps {
        let name = name(grasp);
        let kind = found.entry(name.clone()).or_insert(Kind { name, count: 0, best: grasp });
        kind.count += 1;
        if grasp.margin() > kind.best.margin() {
            kind.best = grasp;
        }
    }
    let mut kinds: Vec<Kind<'a, G>> = found.into_values().collect();
    kinds.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.name.cmp(&b.name)));
    kinds
}

/// A kind of the F-TAC Hand's grasps: a set of digits with a kind of opposition.
pub type HandKind<'a> = Kind<'a, HeldGrasp>;

/// The kinds among the F-TAC Hand's `grasps`, the most frequent first.
pub fn hand_kinds(grasps: &[HeldGrasp]) -> Vec<HandKind<'_>> {
    let name = |grasp: &HeldGrasp| format!("{} {}", digit_set(grasp), opposition(grasp).name());
    kinds(grasps, name)
}

/// The kinds as a table, a line a kind.
pub fn table(kinds: &[HandKind<'_>]) -> String {
    let mut text = format!("{:18} {:>5} {:>8} {:>8} {:>8}\n", "kind", "count", "margin N", "room mm", "moved mm");
    for kind in kinds {
        let room = kind.best.room.map_or("-".into(), |room| format!("{:.0}", 1e3 * room));
        let (margin, moved) = (kind.best.margin, 1e3 * kind.best.moved[0]);
        text += &format!("{:18} {:5} {margin:8.2} {room:>8} {moved:8.1}\n", kind.name, kind.count);
    }
    text
}

#[cfg(test)]
mod tests {
    use hand_model::Digit;

    use super::super::held::tests::grasp;
    use super::*;

    /// Kinds come by frequency; each keeps its grasp with the largest margin.
    #[test]
    fn the_most_frequent_kind_comes_first() {
        let of = |digits: &[Digit], margin: f64| HeldGrasp { digits: digits.to_vec(), margin, ..grasp() };
        let (two, three) = (&[Digit::Thumb, Digit::Index][..], &[Digit::Thumb, Digit::Index, Digit::Middle][..]);
        let all = [of(two, 3.0), of(three, 1.0), of(three, 2.0), of(three, 1.5)];
        let found = hand_kinds(&all);
        assert_eq!(found.iter().map(|kind| (kind.count, kind.best.margin)).collect::<Vec<_>>(), [(3, 2.0), (1, 3.0)]);
        assert_ne!(found[0].name, found[1].name);
    }
}
