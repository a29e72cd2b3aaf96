//! Senses, retries and exploration that a policy has.

use control::policy::Recovery;
use scenarios::record::Condition;
use world::Sensing;

/// Senses and retries of the policy `touch`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Means {
    /// Of the hand's senses.
    pub sensing: Sensing,
    /// Of further tries.
    pub recovery: Recovery,
    /// True if it chooses the first grasp, and touches an object before it grasps it where it has pads for that.
    pub explores: bool,
}

impl Means {
    /// Of a condition that decides; none of those that carry out the plan.
    pub fn of(condition: Condition) -> Option<Self> {
        let sensing = match condition {
            Condition::Ideal | Condition::Blind => return None,
            Condition::Reflex => Sensing::ServosOnly,
            Condition::Touch | Condition::Own => Sensing::Full,
        };
        Some(Self { sensing, recovery: Recovery::FULL, explores: condition != Condition::Own })
    }

    /// True if the senses include tactile images.
    pub fn see_images(self) -> bool {
        self.sensing != Sensing::ServosOnly
    }

    /// True if a trial may begin with anything but the planned first grasp.
    pub fn begin_otherwise(self) -> bool {
        self.explores
    }
}
