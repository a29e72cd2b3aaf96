//! Phases of a trial: what the executive reports it is doing, by which the referee judges.

use serde::{Deserialize, Serialize};

/// Phases of a trial, in order. A trial that recovers from a failure goes back to an earlier one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Laying everything down, after a failure, to start again.
    PutDown,
    /// Out of the eyes' way, to look again.
    StepAside,
    /// Waiting for the decision how to begin, before anything moves.
    Begin,
    /// Over the first object, to touch it with free digits.
    ReachFirst,
    /// Slowly onto it, until a pad feels it.
    TouchFirst,
    /// Still, taking tactile images of it.
    FeelFirst,
    /// Waiting for the decision how to take what was felt.
    LocateFirst,
    /// To the first object.
    ApproachFirst,
    /// Closing on it.
    GraspFirst,
    /// Raising it.
    LiftFirst,
    /// Still, taking tactile images of the first object.
    Look,
    /// Waiting for the decision how to go on.
    Decide,
    /// Over the second object, to touch it with free digits.
    ReachSecond,
    /// Slowly onto it, until a pad feels it.
    TouchSecond,
    /// Still, taking tactile images of it.
    FeelSecond,
    /// Waiting for the decision how to take what was felt.
    LocateSecond,
    /// To the second object.
    ApproachSecond,
    /// Closing on it.
    GraspSecond,
    /// Raising both.
    LiftSecond,
    /// Still, taking tactile images of both objects.
    Check,
    /// Waiting for confirmation that both are held.
    Confirm,
    /// Carrying both.
    Carry,
    /// Holding both still.
    Hold,
    /// Still, taking tactile images of both objects once more.
    Verify,
    /// Over, unless the last images show that something was lost.
    Done,
}

impl Phase {
    /// All phases in order.
    pub const ALL: [Self; 25] = [
        Self::PutDown,
        Self::StepAside,
        Self::Begin,
        Self::ReachFirst,
        Self::TouchFirst,
        Self::FeelFirst,
        Self::LocateFirst,
        Self::ApproachFirst,
        Self::GraspFirst,
        Self::LiftFirst,
        Self::Look,
        Self::Decide,
        Self::ReachSecond,
        Self::TouchSecond,
        Self::FeelSecond,
        Self::LocateSecond,
        Self::ApproachSecond,
        Self::GraspSecond,
        Self::LiftSecond,
        Self::Check,
        Self::Confirm,
        Self::Carry,
        Self::Hold,
        Self::Verify,
        Self::Done,
    ];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::PutDown => "put down",
            Self::StepAside => "step aside",
            Self::Begin => "begin",
            Self::ReachFirst => "reach first",
            Self::TouchFirst => "touch first",
            Self::FeelFirst => "feel first",
            Self::LocateFirst => "locate first",
            Self::ApproachFirst => "approach first",
            Self::GraspFirst => "grasp first",
            Self::LiftFirst => "lift first",
            Self::Look => "look",
            Self::Decide => "decide",
            Self::ReachSecond => "reach second",
            Self::TouchSecond => "touch second",
            Self::FeelSecond => "feel second",
            Self::LocateSecond => "locate second",
            Self::ApproachSecond => "approach second",
            Self::GraspSecond => "grasp second",
            Self::LiftSecond => "lift second",
            Self::Check => "check",
            Self::Confirm => "confirm",
            Self::Carry => "carry",
            Self::Hold => "hold",
            Self::Verify => "verify",
            Self::Done => "done",
        }
    }
}

impl std::fmt::Display for Phase {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}
