//! Kinds of another hand's grasps: a kind is a set of actuators whose links touch, with or without the palm.

use std::collections::{BTreeMap, BTreeSet};

use grasping::synthesis::held::AnyHeld;
use serde::Serialize;

use super::describe::Described;

/// A kind of grasp: how many there are of it, and the one with the largest wrench margin.
#[derive(Debug, Clone, Serialize)]
pub struct AnyKind<'a> {
    #[serde(rename = "kind")]
    pub name: String,
    pub count: usize,
    pub best: &'a AnyHeld,
}

/// The actuators whose links touch, in the hand's order, and the palm.
fn name(hand: &Described, grasp: &AnyHeld) -> String {
    let touching: BTreeSet<usize> = grasp.contacts.iter().filter_map(|(link, ..)| *link).collect();
    let moves = |line: usize| {
        let joints = &hand.mechanism.lines[line].joints;
        touching.iter().any(|link| hand.tree.chain(*link).iter().any(|joint| joints.contains(joint)))
    };
    let names = hand.hand.pulls.iter().enumerate().filter(|(line, _)| moves(*line)).map(|(_, pull)| pull.name.as_str());
    let palm = grasp.contacts.iter().any(|(link, ..)| link.is_none()).then_some("palm");
    names.chain(palm).collect::<Vec<_>>().join("+")
}

/// The kinds among `grasps`, the most frequent first.
pub fn kinds<'a>(hand: &Described, grasps: &[&'a AnyHeld]) -> Vec<AnyKind<'a>> {
    let mut found: BTreeMap<String, AnyKind<'a>> = BTreeMap::new();
    for grasp in grasps {
        let name = name(hand, grasp);
        let kind = found.entry(name.clone()).or_insert(AnyKind { name, count: 0, best: grasp });
        kind.count += 1;
        if grasp.margin > kind.best.margin {
            kind.best = grasp;
        }
    }
    let mut kinds: Vec<AnyKind<'a>> = found.into_values().collect();
    kinds.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.name.cmp(&b.name)));
    kinds
}

/// The kinds as a table, a line a kind.
pub fn table(kinds: &[AnyKind<'_>]) -> String {
    let width = kinds.iter().map(|kind| kind.name.len()).max().unwrap_or(0).max(4);
    let mut text = format!("{:width$} {:>5} {:>8} {:>9}\n", "kind", "count", "margin N", "payload g");
    for AnyKind { name, count, best } in kinds {
        text += &format!("{name:width$} {count:5} {:8.2} {:9.0}\n", best.margin, 1e3 * best.proof.payload);
    }
    text
}
