//! Kinds of a URDF hand's grasps: a kind is a set of actuators whose links touch, with or without the palm.

use std::collections::BTreeSet;

use grasping::synthesis::held::HeldGrasp;
use grasping::synthesis::kind::{self, Kind};

use super::describe::Described;

/// The actuators whose links touch, in the hand's order, and the palm.
fn name(hand: &Described, grasp: &HeldGrasp) -> String {
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
pub fn kinds<'a>(hand: &Described, grasps: &'a [HeldGrasp]) -> Vec<Kind<'a>> {
    kind::kinds(grasps, |grasp| name(hand, grasp))
}
