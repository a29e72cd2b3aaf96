//! What a phase of the trial lets expect of the hand: contact, and objects in it.

use control::executive::Phase;

use super::limits::HandLimits;

/// What a phase lets expect of the forces on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expects {
    /// The hand moves through the air, or stands still.
    Nothing,
    /// It meets objects, and the table.
    Contact,
}

/// What `phase` lets expect once `progress` (0 to 1) of it is over.
pub fn expects(limits: &HandLimits, phase: Phase, progress: f64) -> Expects {
    match phase {
        Phase::ApproachFirst | Phase::ApproachSecond | Phase::ReachFirst | Phase::ReachSecond => {
            if progress < limits.arriving { Expects::Nothing } else { Expects::Contact }
        }
        Phase::LiftFirst | Phase::LiftSecond if progress > limits.leaving => Expects::Nothing,
        Phase::Begin | Phase::StepAside | Phase::Look | Phase::Decide => Expects::Nothing,
        Phase::Check | Phase::Confirm | Phase::Carry | Phase::Hold | Phase::Verify => Expects::Nothing,
        _ => Expects::Contact,
    }
}

/// How many of the two objects should be in the hand, and lifted.
pub fn held(limits: &HandLimits, phase: Phase, progress: f64) -> usize {
    let lifted = |before: usize| if progress > limits.leaving { before + 1 } else { before };
    match phase {
        Phase::LiftFirst => lifted(0),
        Phase::LiftSecond => lifted(1),
        Phase::Look | Phase::Decide => 1,
        phase if phase > Phase::LiftSecond => 2,
        phase if phase > Phase::Decide => 1,
        _ => 0,
    }
}
