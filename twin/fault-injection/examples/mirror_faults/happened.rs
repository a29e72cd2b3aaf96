//! What really happened, by the scene's truth: for judging what was named, and nothing else.

use control::executor::Phase;
use fault_detection::divergence::{Divergence, Kind};
use proving::rehearsal::in_hand;
use sim::robot::Truth;

/// Before a name is given, what it names happened within this time, s.
const BEFORE: f64 = 1.0;

/// Times at which something happened that can rightly be named, s.
#[derive(Debug, Clone, Default)]
pub struct Happened {
    held: [bool; 2],
    lost: Vec<f64>,
    touched: Vec<f64>,
    /// When an object was not in the hand that should have been, or was left lying while it should have been raised.
    missing: Vec<f64>,
}

impl Happened {
    /// One tick.
    pub fn see(&mut self, truth: &Truth, phase: Phase) {
        let held = [in_hand(truth, 0), in_hand(truth, 1)];
        if (0..2).any(|n| self.held[n] && !held[n]) {
            self.lost.push(truth.time);
        }
        self.held = held;
        let touched = |n: usize| truth.touched_by.get(n).is_some_and(|by| *by != 0);
        let missing = |n: usize| if phase.has_lifted(n) { !held[n] } else { phase.lifts(n) && !touched(n) };
        if missing(0) || missing(1) {
            self.missing.push(truth.time);
        }
        // Contact with table, floor, or an object that is not in the hand, or of one that is with another.
        let apart = (0..2).any(|n| touched(n) && !held[n]) || !truth.object_pairs.is_empty();
        if apart || truth.collides {
            self.touched.push(truth.time);
        }
    }

    /// Whether `named` is true of what happened.
    pub fn justifies(&self, named: &Divergence) -> bool {
        let just = |times: &[f64]| times.iter().any(|time| (named.time - BEFORE..=named.time).contains(time));
        match named.kind {
            Kind::ObjectLost => just(&self.lost) || just(&self.missing),
            Kind::UnexpectedContact => just(&self.touched) || just(&self.lost),
            Kind::OtherPayload => just(&self.missing),
            _ => false,
        }
    }
}
