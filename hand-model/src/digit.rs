//! Digits and phalanges, in the order used everywhere: thumb, index, middle, ring, little; proximal to distal. A hand
//! with fewer digits has the first ones of these: the jaws of a gripper are a thumb and an index finger.

use serde::{Deserialize, Serialize};

/// A digit. The discriminant is also the index of its actuator.
///
/// ```
/// use hand_model::{Digit, Hand};
///
/// let hand = Hand::ftac();
/// let tip = hand.links(Digit::Index).last().expect("the hand has an index finger");
/// assert_eq!(hand.tree.joints[*tip].name, "index_3");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Digit {
    /// Thumb: CMC (opposition), PIP, DIP.
    Thumb = 0,
    /// Index finger.
    Index = 1,
    /// Middle finger.
    Middle = 2,
    /// Ring finger.
    Ring = 3,
    /// Little finger.
    Little = 4,
}

impl Digit {
    /// All digits in order.
    pub const ALL: [Digit; 5] = [Digit::Thumb, Digit::Index, Digit::Middle, Digit::Ring, Digit::Little];

    /// Returns the index among the digits, which is also that of the actuator.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Returns the joints of the digit in the F-TAC Hand, proximal first. For any hand, use [`crate::Hand::links`].
    pub fn ftac_joints(self) -> [usize; 3] {
        let first = 3 * self.index();
        [first, first + 1, first + 2]
    }

    /// Returns the lower-case name, as in the parameter file.
    pub fn name(self) -> &'static str {
        ["thumb", "index", "middle", "ring", "little"][self.index()]
    }
}

/// A segment of a digit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phalanx {
    /// First link (the thumb's metacarpal).
    Proximal = 0,
    /// Second link.
    Middle = 1,
    /// Third link, with the fingertip.
    Distal = 2,
}
