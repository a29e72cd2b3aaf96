//! In which order the two objects are taken: decided before anything moves, by what the best sequence of grasps of either order promises.

use grasping::Grasp;

use super::Knowledge;
use super::touch::empty_hand;
use crate::sensing::Senses;

/// The other order must promise this many times as much. Where no sequence of the plan is sure, the plans of both orders were searched for
/// the best of many odds, and the best of many is partly the luckiest. Set by hand on seed 1.
const GAIN: f64 = 1.1;

/// What two orders promise, where the other one promises more than the planned one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reordered {
    /// Of the planned order.
    pub planned: f64,
    /// Of the other one.
    pub other: f64,
}

impl Reordered {
    /// `Some` if the other order should be taken.
    pub fn of(planned: f64, other: f64) -> Option<Self> {
        (other > GAIN * planned).then_some(Self { planned, other })
    }
}

/// What the best sequence of grasps promises in a trial whose first grasp is planned as `first`: proven score of the first grasp times worth of the
/// best second grasp after it.
pub fn promise(knowledge: &Knowledge, senses: &Senses, first: &Grasp) -> f64 {
    let candidates = empty_hand::candidates(knowledge, senses, first);
    candidates.iter().map(|candidate| candidate.worth).fold(0.0, f64::max)
}
