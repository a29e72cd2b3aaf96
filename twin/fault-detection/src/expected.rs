//! Expected contact state and number of held objects per phase.

use control::executor::{Phase, Skill, SkillStage};

use super::limits::HandLimits;

/// Expected forces on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExpectedContact {
    /// The hand moves through the air, or stands still.
    NoContact,
    /// The hand meets objects or the table.
    Contact,
}

/// Returns the forces to expect in `phase` once `progress` (0 to 1) of it is over.
pub fn expected_contact(limits: &HandLimits, phase: Phase, progress: f64) -> ExpectedContact {
    match (phase.skill, phase.stage) {
        (Skill::Approach, _) | (Skill::Palpate, SkillStage::Reach) if progress < limits.arriving => {
            ExpectedContact::NoContact
        }
        (Skill::Lift, _) if progress > limits.leaving => ExpectedContact::NoContact,
        (Skill::Begin | Skill::StepAside | Skill::Snapshot | Skill::Carry | Skill::Hold, _) => {
            ExpectedContact::NoContact
        }
        (Skill::Verify, SkillStage::Run) | (Skill::PutDown, SkillStage::Decide) => ExpectedContact::NoContact,
        _ => ExpectedContact::Contact,
    }
}

/// Returns how many of the trial's `objects` should be in the hand and lifted.
pub fn expected_held(limits: &HandLimits, phase: Phase, progress: f64, objects: usize) -> usize {
    match phase.skill {
        Skill::Lift if progress > limits.leaving => phase.object + 1,
        Skill::Lift | Skill::Palpate | Skill::Approach | Skill::Grasp => phase.object,
        Skill::Snapshot => phase.object + 1,
        Skill::Carry | Skill::Hold | Skill::Verify => objects,
        Skill::Begin | Skill::PutDown | Skill::StepAside => usize::from(phase.has_begun_lift(0)),
    }
}
