//! Recovery: the next action, given the objects that touch finds in the hand after a grasp was tried.

use dexterous_grasping::digit_sets::describe_digits;
use hand_model::Digit;
use nalgebra::Vector3;
use world::phase::{Phase, ordinal};

use crate::perception::HoldState;

/// Length of a probe of the aim, in standard deviations of the arm's error.
const PROBE_REACH: f64 = 1.5;

/// Offset of the aim from the detected position after `failures` failed grasps in a row, m. The arm has an unknown
/// constant error with standard deviation `sigma` (m), so the same aim would fail again. The first retry trusts the new
/// detection. The following ones go through the six directions along the axes and the eight between them, over and
/// over.
pub fn probe_offset(failures: usize, sigma: f64) -> Vector3<f64> {
    let Some(n) = failures.checked_sub(2) else { return Vector3::zeros() };
    let direction = match n % 14 {
        axis @ 0..6 => {
            // Up first, because a hand that is too low is stopped by the table.
            let mut direction = Vector3::zeros();
            direction[2 - axis / 2] = if axis % 2 == 0 { 1.0 } else { -1.0 };
            direction
        }
        corner => {
            let sign = |bit: usize| if (corner - 6) >> bit & 1 == 0 { 1.0 } else { -1.0 };
            Vector3::new(sign(0), sign(1), sign(2)).normalize()
        }
    };
    direction * (PROBE_REACH * sigma)
}

/// Next action after a tactile snapshot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextAction {
    /// Go on as planned.
    Continue,
    /// Take this object again: all objects before it are held, or nothing is.
    Retry(usize),
    /// An earlier object was lost: lay down everything that is held and start over.
    StartOver,
}

impl NextAction {
    /// Next action after the snapshot that ends in `phase`, in a trial whose `last` object has this index.
    pub fn after(phase: Phase, grip: HoldState, last: usize) -> Self {
        let taken = (0..=last).rev().find(|object| phase.has_lifted(*object)).unwrap_or(0);
        match grip.first_missing(taken) {
            None => Self::Continue,
            Some(object) if object == taken => Self::Retry(object),
            Some(_) if (0..=taken).any(|object| grip.holds(object)) => Self::StartOver,
            Some(_) => Self::Retry(0),
        }
    }

    /// Object that touch finds missing, if there is one.
    pub fn missing_object(self) -> Option<usize> {
        match self {
            Self::Continue => None,
            Self::Retry(object) => Some(object),
            Self::StartOver => Some(0),
        }
    }

    /// Describes the reason in words; `digits` should hold the object that is taken again.
    pub fn reason(self, digits: &[Digit]) -> String {
        match self {
            Self::Continue => "touch feels what should be in the hand".to_owned(),
            Self::Retry(object) => {
                let hold = if digits.len() == 1 { "holds" } else { "hold" };
                let (digits, object) = (describe_digits(digits), ordinal(object));
                format!("touch feels nothing that {digits} {hold}: the {object} object again")
            }
            Self::StartOver => {
                "touch feels the second object but no longer the first: laying down and starting over".to_owned()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use world::phase::Skill;

    use super::*;

    /// No offset at first, then fourteen different directions of the same length, then the same again.
    #[test]
    fn probes_go_everywhere() {
        assert!(probe_offset(0, 0.004).norm() == 0.0 && probe_offset(1, 0.004).norm() == 0.0);
        let probes: Vec<_> = (2..16).map(|n| probe_offset(n, 0.004)).collect();
        assert!(probes.iter().all(|p| (p.norm() - 0.006).abs() < 1e-12));
        assert!(probes.iter().enumerate().all(|(n, p)| probes[..n].iter().all(|q| (p - q).norm() > 0.002)));
        assert!(probes.iter().sum::<Vector3<f64>>().norm() < 1e-12);
        assert_eq!(probe_offset(16, 0.004), probes[0]);
    }

    #[test]
    fn every_case() {
        let grip = |first, second| HoldState::from_iter([first, second]);
        let [decide, confirm] = [0, 1].map(|object| Phase::decide(Skill::Snapshot, object));
        let done = Phase::decide(Skill::Verify, 0);
        assert_eq!(NextAction::after(decide, grip(true, false), 1), NextAction::Continue);
        assert_eq!(NextAction::after(decide, grip(false, false), 1), NextAction::Retry(0));
        assert_eq!(NextAction::after(confirm, grip(true, true), 1), NextAction::Continue);
        assert_eq!(NextAction::after(confirm, grip(true, false), 1), NextAction::Retry(1));
        assert_eq!(NextAction::after(confirm, grip(false, false), 1), NextAction::Retry(0));
        assert_eq!(NextAction::after(confirm, grip(false, true), 1), NextAction::StartOver);
        assert_eq!(NextAction::after(done, grip(true, true), 1), NextAction::Continue);
        assert_eq!(NextAction::after(done, grip(true, false), 1), NextAction::Retry(1));
        assert_eq!(NextAction::after(done, grip(false, true), 1), NextAction::StartOver);
        assert_eq!(NextAction::after(done, grip(false, false), 1), NextAction::Retry(0));
    }
}
