//! Kinds of a URDF hand's grasps: a kind is a set of actuators whose links touch, with or without the palm.

use std::collections::BTreeSet;

use grasping::synthesis::held::UrdfGrasp;
use grasping::synthesis::kind::{self, Kind};

use super::describe::Described;

/// A kind of a URDF hand's grasps.
pub type UrdfKind<'a> = Kind<'a, UrdfGrasp>;

/// The actuators whose links touch, in the hand's order, and the palm.
fn name(hand: &Described, grasp: &UrdfGrasp) -> String {
    let touching: BTreeSet<usize> = grasp.contacts.iter().filter_map(|contact| contact.link).collect();
    let moves = |line: usize| {
        let joints = &hand.sampled.mechanism.lines[line].joints;
        touching.iter().any(|link| hand.hand.tree.chain(*link).iter().any(|joint| joints.contains(joint)))
    };
    let names = hand.hand.pulls.iter().enumerate().filter(|(line, _)| moves(*line)).map(|(_, pull)| pull.name.as_str());
    let palm = grasp.contacts.iter().any(|contact| contact.link.is_none()).then_some("palm");
    names.chain(palm).collect::<Vec<_>>().join("+")
}

/// The kinds among `grasps`, the most frequent first.
pub fn kinds<'a>(hand: &Described, grasps: &[&'a UrdfGrasp]) -> Vec<UrdfKind<'a>> {
    kind::kinds(grasps.iter().copied(), |grasp| name(hand, grasp))
}

/// The kinds as a table, a line a kind.
pub fn table(kinds: &[UrdfKind<'_>]) -> String {
    let width = kinds.iter().map(|kind| kind.name.len()).max().unwrap_or(0).max(4);
    let mut text = format!("{:width$} {:>5} {:>8} {:>9}\n", "kind", "count", "margin N", "payload g");
    for Kind { name, count, best } in kinds {
        text += &format!("{name:width$} {count:5} {:8.2} {:9.0}\n", best.margin, 1e3 * best.proof.payload);
    }
    text
}
