//! What a grasp is worth: every factor that multiplies a proven score, in one place.
//!
//! A grasp's score is the share of rehearsals under the expected noise in which it held. Its worth in a given situation is that
//! score times the factors below. They rank alternatives; only ratios matter. All were set by hand.

use std::sync::Arc;

use grasping::Grasp;

use crate::extent::Extent;
use crate::odds::Rehearsed;

/// A grasp that failed in this very trial or transport: the factor of each failure.
pub const FAILED: f64 = 0.5;
/// A grasp that was not rehearsed together with the other object of the combination.
pub const UNREHEARSED: f64 = 0.9;
/// A grasp taken over from another object of similar shape.
pub const STAND_IN: f64 = 0.5;
/// A pick that was not proven with these digits occupied.
pub const UNPROVEN_BESIDE: f64 = 0.5;
/// A pick sequence continues only with picks worth at least this much: a failed one may lose what is held.
pub const LEAST: f64 = 0.25;
/// A candidate replaces the plan only if it is worth this many times as much.
pub const SWITCH_GAIN: f64 = 1.05;
/// A try that misses without a contact, against one that holds: of such trials a quarter to a third still end well without a contact.
pub const MISSED: f64 = 0.35;
/// Probability of a contact of a grasp that was not rehearsed under errors.
pub const UNREHEARSED_CONTACT: f64 = 0.25;

/// A grasp that might take an object, and its worth in this situation.
#[derive(Debug, Clone)]
pub struct Candidate {
    pub grasp: Grasp,
    /// Probability of success when nothing is in the way.
    pub worth: f64,
    /// What is left of it after failures in this very trial, 1 before any: what was rehearsed is not all that happens.
    pub trust: f64,
    /// How it went under errors of its aim, after the first grasp of the plan; empty where that was not rehearsed.
    pub rehearsed: Arc<[Rehearsed]>,
}

impl Candidate {
    /// A grasp that was not rehearsed under errors.
    pub fn new(grasp: Grasp, worth: f64) -> Self {
        Self { grasp, worth, trust: 1.0, rehearsed: Arc::default() }
    }

    /// The same with what its rehearsals count for beside the first object as it is felt.
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
