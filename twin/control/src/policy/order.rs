//! Order of the two objects: decided before any motion, from the value of the best sequence of grasps in either order.

use dexterous_grasping::Grasp;

use super::Knowledge;
use super::touch::empty_hand;
use crate::sensing::TouchPerception;

/// Score of the best sequence of grasps in a trial whose first grasp is planned as `first`: the verified score of the
/// first grasp times the score of the best second grasp after it.
pub fn best_sequence_score(knowledge: &Knowledge, senses: &TouchPerception, first: &Grasp) -> f64 {
    let candidates = empty_hand::candidates(knowledge, senses, first);
    candidates.iter().map(|candidate| candidate.score).fold(0.0, f64::max)
}
