//! Expected contact state and number of held objects per phase.

use control::executor::{Phase, Skill, Stage};

use super::limits::HandLimits;

/// Expected forces on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expects {
    /// The hand moves through the air, or stands still.
    Nothing,
    /// The hand meets objects or the table.
    Contact,
}

/// Returns the forces to expect in `phase` once `progress` (0 to 1) of it is over.
pub fn expects(limits: &HandLimits, phase: Phase, progress: f64) -> Expects {
    match (phase.skill, phase.stage) {
        (Skill::Approach, _) | (Skill::Palpate, Stage::Reach) if progress < limits.arriving => Expects::Nothing,
        (Skill::Lift, _) if progress > limits.leaving => Expects::Nothing,
        (Skill::Begin | Skill::StepAside | Skill::Look | Skill::Carry | Skill::Hold, _) => Expects::Nothing,
        (Skill::Verify, Stage::Run) | (Skill::PutDown, Stage::Decide) => Expects::Nothing,
        _ => Expects::Contact,
    }
}

/// Returns how many of the trial's `objects` should be in the hand and lifted.
pub fn held(limits: &HandLimits, phase: Phase, progress: f64, objects: usize) -> usize {
    match phase.skill {
        Skill::Lift if progress > limits.leaving => phase.object + 1,
        Skill::Lift | Skill::Palpate | Skill::Approach | Skill::Grasp => phase.object,
        Skill::Look => phase.object + 1,
        Skill::Carry | Skill::Hold | Skill::Verify => objects,
        Skill::Begin | Skill::PutDown | Skill::StepAside => usize::from(phase.lifts(0)),
    }
}
