//! Limits of a search: the parts of the hand that may touch the object, and the ranges of its joints.

use hand_model::{Digit, Hand};
use serde::{Deserialize, Serialize};

use super::mechanism::Mechanism;
use super::surface::HandSurface;

/// Largest angle of the two outer joints of a digit that stays straight, rad.
const MAX_STRAIGHT_ANGLE: f64 = 0.45;

/// Digits and palm in use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandUse {
    /// Digits that may touch the object. The others stay still.
    pub digits: Vec<Digit>,
    /// True if the palm may touch it too.
    #[serde(default)]
    pub palm: bool,
    /// True if digits touch it with their last phalanges only.
    #[serde(default)]
    pub tips: bool,
    /// Smallest and largest opposition angle of the thumb, rad.
    #[serde(default)]
    pub opposition: Option<[f64; 2]>,
    /// Digits whose two outer joints stay nearly straight.
    #[serde(default)]
    pub straight: Vec<Digit>,
    /// Smallest and largest tension with which a cable closes, N.
    #[serde(default)]
    pub tension: Option<[f64; 2]>,
}

impl HandUse {
    /// Allows any part of these digits in any posture, and the palm if `palm` is true.
    pub fn with_digits(digits: Vec<Digit>, palm: bool) -> Self {
        Self { digits, palm, tips: false, opposition: None, straight: Vec::new(), tension: None }
    }

    /// Limits the contact candidates and the joints of `hand`. Joints of other digits stay at `still`, rad or m.
    pub fn limit(&self, hand: &Hand, still: &[f64], surface: &mut HandSurface, mechanism: &mut Mechanism) {
        let chains = || self.digits.iter().map(|digit| hand.links(*digit));
        let joints: Vec<usize> = chains().flatten().copied().collect();
        let touching =
            chains().flat_map(|links| if self.tips { &links[links.len().saturating_sub(1)..] } else { links });
        // The palm is link 0 of a surface.
        let links: Vec<usize> = touching.map(|link| link + 1).chain(self.palm.then_some(0)).collect();
        surface.touch_only(&links);
        mechanism.hold_others(|joint| joints.contains(&joint), still);
        if let (Some(range), Some(joint)) = (self.opposition, hand.transmission.opposition) {
            mechanism.narrow_limits(joint, range);
        }
        for joint in self.straight.iter().flat_map(|digit| hand.links(*digit).iter().skip(1)) {
            mechanism.narrow_limits(*joint, [f64::NEG_INFINITY, MAX_STRAIGHT_ANGLE]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Candidates are on the last phalanges alone, the outer joints of the index finger stay straight, and idle fingers
    /// do not move.
    #[test]
    fn links_and_joints_are_limited() {
        let hand = Hand::ftac();
        let mut surface = HandSurface::new(&hand, 400);
        let mut mechanism = Mechanism::from_hand(&hand);
        let in_use = HandUse {
            tips: true,
            opposition: Some([0.8, 1.0]),
            straight: vec![Digit::Index],
            ..HandUse::with_digits(vec![Digit::Thumb, Digit::Index], false)
        };
        in_use.limit(&hand, &hand.open_angles(), &mut surface, &mut mechanism);
        let tips = [Digit::Thumb, Digit::Index].map(|digit| hand.links(digit)[2] + 1);
        assert!(!surface.candidates.is_empty());
        assert!(surface.candidates.iter().all(|candidate| tips.contains(&candidate.link)));
        let limits = |digit: Digit, n: usize| mechanism.limits[hand.links(digit)[n]];
        let opposition = mechanism.limits[hand.transmission.opposition.expect("the thumb opposes")];
        assert_eq!(opposition, (0.8, 1.0));
        assert!(limits(Digit::Index, 1).1 == MAX_STRAIGHT_ANGLE && limits(Digit::Index, 0).1 > MAX_STRAIGHT_ANGLE);
        assert!(limits(Digit::Ring, 0).0 == limits(Digit::Ring, 0).1);
        assert_eq!(mechanism.lines.len(), 2);
    }
}
