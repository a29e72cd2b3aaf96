//! Kinds of a hand's grasps: a set of digits with a kind of opposition. If digits have no names, a kind is the set of
//! actuators whose links touch, with or without the palm.

use std::collections::BTreeSet;

use dexterous_grasping::synthesis::held::HeldGrasp;
use dexterous_grasping::synthesis::kind::{self, GraspKind, ftac_grasp_kinds};

use super::grasping_hand::GraspingHand;

/// Returns the name of a kind: the actuators whose links touch, in the hand's order, and the palm.
fn kind_name(hand: &GraspingHand, grasp: &HeldGrasp) -> String {
    let touching: BTreeSet<usize> = grasp.contacts.iter().filter_map(|contact| contact.link).collect();
    let moves = |line: usize| {
        let joints = &hand.sampled.mechanism.lines[line].joints;
        touching.iter().any(|link| hand.sampled.tree.chain(*link).iter().any(|joint| joints.contains(joint)))
    };
    let pulls = hand.mechanism().actuators.iter().enumerate();
    let names = pulls.filter(|(line, _)| moves(*line)).map(|(_, pull)| pull.name.as_str());
    names.chain(grasp.palm().then_some("palm")).collect::<Vec<_>>().join("+")
}

/// Returns the kinds among `grasps`, the most frequent first.
pub fn kinds<'a>(hand: &GraspingHand, grasps: &'a [HeldGrasp]) -> Vec<GraspKind<'a>> {
    match hand.named_hand {
        Some(_) => ftac_grasp_kinds(grasps),
        None => kind::grasp_kinds(grasps, |grasp| kind_name(hand, grasp)),
    }
}
