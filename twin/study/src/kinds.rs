//! Kinds of grasps: a kind is a set of digits with a kind of opposition.

use grasping::synthesis::diversity::{digit_set, opposition};
use grasping::synthesis::held::HeldGrasp;
use grasping::synthesis::kind;

/// A kind of our own hand's grasps.
pub type Kind<'a> = kind::Kind<'a, HeldGrasp>;

/// The kinds among `grasps`, the most frequent first.
pub fn kinds(grasps: &[HeldGrasp]) -> Vec<Kind<'_>> {
    let name = |grasp: &HeldGrasp| format!("{} {}", digit_set(grasp), opposition(grasp).name());
    kind::kinds(grasps, name, |grasp| grasp.margin)
}

/// The kinds as a table, a line a kind.
pub fn table(kinds: &[Kind<'_>]) -> String {
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

    use super::*;
    use crate::attributes::tests::grasp;

    /// Kinds come by frequency; each keeps its grasp with the largest margin.
    #[test]
    fn the_most_frequent_kind_comes_first() {
        let of = |digits: &[Digit], margin: f64| HeldGrasp { digits: digits.to_vec(), margin, ..grasp(0.3, &[]) };
        let (two, three) = (&[Digit::Thumb, Digit::Index][..], &[Digit::Thumb, Digit::Index, Digit::Middle][..]);
        let all = [of(two, 3.0), of(three, 1.0), of(three, 2.0), of(three, 1.5)];
        let found = kinds(&all);
        assert_eq!(found.iter().map(|kind| (kind.count, kind.best.margin)).collect::<Vec<_>>(), [(3, 2.0), (1, 3.0)]);
        assert_ne!(found[0].name, found[1].name);
    }
}
