//! Recovery: what to do next, given what touch says is in the hand after a grasp was tried.

use scenarios::phase::Phase;

use crate::perception::Grip;

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// On as planned.
    GoOn,
    /// The hand is empty: the first object again.
    FirstAgain,
    /// Only the first object is held: the second one again.
    SecondAgain,
    /// Only the second object is held, by digits that are needed for it last: lay it down and start over.
    StartOver,
}

impl Next {
    /// After the look that ends in `phase`: [`Phase::Decide`], [`Phase::Confirm`] or [`Phase::Done`].
    pub fn after(phase: Phase, grip: Grip) -> Self {
        match (phase, grip.first, grip.second) {
            (Phase::Confirm | Phase::Done, true, false) => Self::SecondAgain,
            (Phase::Confirm | Phase::Done, false, true) => Self::StartOver,
            (_, false, _) => Self::FirstAgain,
            _ => Self::GoOn,
        }
    }

    /// The reason in words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::GoOn => "touch feels what should be in the hand",
            Self::FirstAgain => "touch feels nothing that ring and little finger hold: the first object again",
            Self::SecondAgain => {
                "touch feels nothing that thumb, index and middle finger hold: the second object again"
            }
            Self::StartOver => "touch feels the second object but no longer the first: laying down and starting over",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case() {
        let grip = |first, second| Grip { first, second };
        assert_eq!(Next::after(Phase::Decide, grip(true, false)), Next::GoOn);
        assert_eq!(Next::after(Phase::Decide, grip(false, false)), Next::FirstAgain);
        assert_eq!(Next::after(Phase::Confirm, grip(true, true)), Next::GoOn);
        assert_eq!(Next::after(Phase::Confirm, grip(true, false)), Next::SecondAgain);
        assert_eq!(Next::after(Phase::Confirm, grip(false, false)), Next::FirstAgain);
        assert_eq!(Next::after(Phase::Confirm, grip(false, true)), Next::StartOver);
        assert_eq!(Next::after(Phase::Done, grip(true, true)), Next::GoOn);
        assert_eq!(Next::after(Phase::Done, grip(true, false)), Next::SecondAgain);
        assert_eq!(Next::after(Phase::Done, grip(false, true)), Next::StartOver);
        assert_eq!(Next::after(Phase::Done, grip(false, false)), Next::FirstAgain);
    }
}
