//! In which order the two objects are taken: decided before anything moves, by what the best sequence of grasps of either order promises.

use grasping::Grasp;

use super::Knowledge;
use super::touch::empty_hand;
use crate::sensing::Senses;

/// What the best sequence of grasps promises in a trial whose first grasp is planned as `first`: proven score of the first grasp times worth of the
/// best second grasp after it.
pub fn promise(knowledge: &Knowledge, senses: &Senses, first: &Grasp) -> f64 {
    let candidates = empty_hand::candidates(knowledge, senses, first);
    candidates.iter().map(|candidate| candidate.worth).fold(0.0, f64::max)
}
