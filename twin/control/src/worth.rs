//! Worth of a grasp: all factors that multiply a proven score, in one place.
//!
//! The score of a grasp is the share of rehearsals under the expected noise in which it held. Its worth in a given
//! situation is that score times the factors below. They rank alternatives, so only ratios matter. All were set by
//! hand.

use std::sync::Arc;

use dexterous_grasping::Grasp;

use crate::extent::Extent;
use crate::odds::Rehearsed;

/// Factor for each failure of a grasp in this very trial or transport.
pub const FAILED: f64 = 0.5;
/// Factor of a grasp that was not rehearsed together with the other object of the combination.
pub const UNREHEARSED: f64 = 0.9;
/// Factor of a grasp taken over from another object of similar shape.
pub const STAND_IN: f64 = 0.5;
/// Factor of a pick that was not proven with these digits occupied.
pub const UNPROVEN_BESIDE: f64 = 0.5;
/// Threshold below which a pick sequence makes no further pick: a failed one may lose the held objects.
pub const LEAST: f64 = 0.25;
/// Threshold for replacing the plan: a candidate must be worth this many times as much.
pub const SWITCH_GAIN: f64 = 1.05;
/// Value of a miss without contact relative to a hold: a quarter to a third of such trials still end well without a
/// contact.
pub const MISSED: f64 = 0.35;
/// Probability of a contact for a grasp that was not rehearsed under errors.
pub const UNREHEARSED_CONTACT: f64 = 0.25;

/// A grasp that might take an object, and its worth in this situation.
#[derive(Debug, Clone)]
pub struct Candidate {
    pub grasp: Grasp,
    /// Probability of success without obstacles.
    pub worth: f64,
    /// Factor on the worth and on the odds of a hold after failures in this very trial, 1 before any. It accounts for
    /// effects that rehearsals lack.
    pub trust: f64,
    /// Rehearsals under errors of the aim, after the first grasp of the plan; empty if it was not rehearsed.
    pub rehearsed: Arc<[Rehearsed]>,
}

impl Candidate {
    /// A grasp that was not rehearsed under errors.
    pub fn new(grasp: Grasp, worth: f64) -> Self {
        Self { grasp, worth, trust: 1.0, rehearsed: Arc::default() }
    }

    /// Weights the rehearsals for the felt hold of the first object.
    #[must_use]
    pub fn beside(&self, felt: &Extent) -> Self {
        Self { rehearsed: self.rehearsed.iter().map(|rehearsed| rehearsed.beside(felt)).collect(), ..self.clone() }
    }
}

/// A first grasp, and the second grasps that were rehearsed after it.
#[derive(Debug, Clone)]
pub struct Sequence {
    pub first: Grasp,
    pub second: Vec<Candidate>,
}
