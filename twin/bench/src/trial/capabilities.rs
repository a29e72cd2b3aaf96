//! Capabilities of a policy: senses, retries and exploration.

use control::policy::Recovery;
use scenarios::record::Condition;
use world::Sensing;

/// Capabilities of the policy `touch`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PolicyCapabilities {
    /// Available senses of the hand.
    pub sensing: Sensing,
    /// Permitted further tries.
    pub recovery: Recovery,
    /// True if the policy chooses the first grasp, and palpates an object before grasping it if it has pads for that.
    pub explores: bool,
}

impl PolicyCapabilities {
    /// Returns the capabilities of a condition that decides, and none for those that carry out the planned grasps.
    pub fn for_condition(condition: Condition) -> Option<Self> {
        let sensing = match condition {
            Condition::Ideal | Condition::Blind => return None,
            Condition::Reflex => Sensing::ServosOnly,
            Condition::Touch | Condition::External => Sensing::Full,
        };
        Some(Self { sensing, recovery: Recovery::FULL, explores: condition != Condition::External })
    }

    /// True if the senses include tactile images.
    pub fn use_images(self) -> bool {
        self.sensing != Sensing::ServosOnly
    }

    /// True if a trial may begin with anything but the planned first grasp.
    pub fn may_skip_planned_grasp(self) -> bool {
        self.explores
    }
}
