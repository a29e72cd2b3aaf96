//! Score of a grasp: all factors that multiply a verified score, in one place.
//!
//! The verified score of a grasp is the share of rollouts under the expected noise in which it held. Its score in a
//! given situation is that score times the factors below. They rank alternatives, so only ratios matter. All were set
//! by hand.

use std::sync::Arc;

use dexterous_grasping::Grasp;

use crate::extent::HeldExtent;
use crate::outcome_model::Rollout;

/// Factor for each failure of a grasp in this very trial or transport.
pub const FAILURE_FACTOR: f64 = 0.5;
/// Factor of a grasp without rollouts together with the other object of the combination.
pub const NO_ROLLOUT_FACTOR: f64 = 0.9;
/// Factor of a grasp taken over from another object of similar shape.
pub const FALLBACK_FACTOR: f64 = 0.5;
/// Factor of a pick that was not verified with these digits occupied.
pub const UNVERIFIED_PICK_FACTOR: f64 = 0.5;
/// Threshold below which a pick sequence makes no further pick: a failed one may lose the held objects.
pub const MIN_PICK_SCORE: f64 = 0.25;
/// Threshold for replacing the planned grasp: a candidate must score this many times as much.
pub const SWITCH_GAIN: f64 = 1.05;
/// Score of a miss without contact relative to a hold: a quarter to a third of such trials still end well without a
/// contact.
pub const MISS_SCORE: f64 = 0.35;
/// Probability of a contact for a grasp without rollouts under errors.
pub const DEFAULT_CONTACT_PROBABILITY: f64 = 0.25;

/// A grasp that might take an object, and its score in this situation.
#[derive(Debug, Clone)]
pub struct GraspCandidate {
    pub grasp: Grasp,
    /// Probability of success without obstacles.
    pub score: f64,
    /// Factor on the score and on the probability of a hold after failures in this very trial, 1 before any. It
    /// accounts for effects that rollouts lack.
    pub failure_factor: f64,
    /// Rollouts under errors of the aim, after the first grasp of the plan; empty if there are none.
    pub rollouts: Arc<[Rollout]>,
}

impl GraspCandidate {
    /// A grasp without rollouts under errors.
    pub fn new(grasp: Grasp, worth: f64) -> Self {
        Self { grasp, score: worth, failure_factor: 1.0, rollouts: Arc::default() }
    }

    /// Weights the rollouts for the felt hold of the first object.
    #[must_use]
    pub fn reweighted_for_hold(&self, felt: &HeldExtent) -> Self {
        Self {
            rollouts: self.rollouts.iter().map(|rollout| rollout.reweighted_for_hold(felt)).collect(),
            ..self.clone()
        }
    }
}

/// A first grasp, and the second grasps with rollouts after it.
#[derive(Debug, Clone)]
pub struct GraspSequence {
    pub first: Grasp,
    pub second_candidates: Vec<GraspCandidate>,
}
