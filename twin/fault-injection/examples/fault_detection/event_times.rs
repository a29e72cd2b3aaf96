//! Ground truth of a trial, used only to judge whether a detected fault was justified.

use control::executor::Phase;
use fault_detection::fault::{DetectedFault, FaultKind};
use grasp_verification::rollout::in_hand;
use sim::robot::GroundTruth;

/// Window before a report within which its event must have happened, s.
const JUSTIFICATION_WINDOW: f64 = 1.0;

/// Times of events that justify a report, s.
#[derive(Debug, Clone, Default)]
pub struct FaultEventTimes {
    held: [bool; 2],
    lost: Vec<f64>,
    touched: Vec<f64>,
    /// Times at which an object was not in the hand although expected there, or was left lying although it should have
    /// been raised.
    missing: Vec<f64>,
}

impl FaultEventTimes {
    /// Records the events of one tick.
    pub fn record(&mut self, truth: &GroundTruth, phase: Phase) {
        let held = [in_hand(truth, 0), in_hand(truth, 1)];
        if (0..2).any(|n| self.held[n] && !held[n]) {
            self.lost.push(truth.time);
        }
        self.held = held;
        let touched = |n: usize| truth.touched_by.get(n).is_some_and(|by| *by != 0);
        let missing = |n: usize| if phase.has_lifted(n) { !held[n] } else { phase.has_begun_lift(n) && !touched(n) };
        if missing(0) || missing(1) {
            self.missing.push(truth.time);
        }
        // Contact with the table, the floor or an object that is not in the hand, or between an object in the hand and
        // another one.
        let apart = (0..2).any(|n| touched(n) && !held[n]) || !truth.object_pairs.is_empty();
        if apart || truth.collides {
            self.touched.push(truth.time);
        }
    }

    /// True if the events so far justify `named`.
    pub fn justifies(&self, named: &DetectedFault) -> bool {
        let just =
            |times: &[f64]| times.iter().any(|time| (named.time - JUSTIFICATION_WINDOW..=named.time).contains(time));
        match named.kind {
            FaultKind::ObjectLost => just(&self.lost) || just(&self.missing),
            FaultKind::UnexpectedContact => just(&self.touched) || just(&self.lost),
            FaultKind::OtherPayload => just(&self.missing),
            _ => false,
        }
    }
}
