//! Definition of "in the hand": something other than the table supports the object, and it is within reach of the palm.
//!
//! The thresholds depend on the user of the rule. The referee takes its distance from the scenario file. Rollouts
//! and transports also require that the object has been lifted, and allow a slightly greater distance,
//! because they count larger objects.

/// State of one object at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportState {
    /// True if the hand, or something that the hand holds, touches it.
    pub held: bool,
    /// True if the table touches it.
    pub on_table: bool,
    /// Distance of its origin from the palm's origin, m.
    pub distance: f64,
    /// Height of its origin over the table, m.
    pub height: f64,
}

/// Thresholds for an object to count as in the hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldingRule {
    /// Greatest distance from the palm's origin, m.
    pub max_distance: f64,
    /// Height over the table above which the object counts as lifted, m; negative infinity if no lift is required.
    pub min_height: f64,
}

/// Rule of grasp verification, and of a policy with the true content of the hand: the object must be lifted.
pub const LIFTED_RULE: HoldingRule = HoldingRule { max_distance: 0.16, min_height: 0.08 };
/// Like [`LIFTED_RULE`], but at any height.
pub const GRIPPED_RULE: HoldingRule = HoldingRule { min_height: f64::NEG_INFINITY, ..LIFTED_RULE };
/// Rule for balls in a transport, which may be small or lie behind others.
pub const TRANSPORTED_RULE: HoldingRule = HoldingRule { max_distance: 0.17, min_height: 0.07 };

impl HoldingRule {
    /// Returns the rule that tests the distance only.
    pub fn distance_only(reach: f64) -> Self {
        Self { max_distance: reach, min_height: f64::NEG_INFINITY }
    }

    /// True if the object is in the hand.
    pub fn holds(&self, object: &SupportState) -> bool {
        object.held && !object.on_table && object.distance <= self.max_distance && object.height > self.min_height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELD: SupportState = SupportState { held: true, on_table: false, distance: 0.1, height: 0.2 };

    #[test]
    fn every_part_of_the_rule_is_needed() {
        assert!(LIFTED_RULE.holds(&HELD));
        assert!(!LIFTED_RULE.holds(&SupportState { held: false, ..HELD }));
        assert!(!LIFTED_RULE.holds(&SupportState { on_table: true, ..HELD }));
        assert!(!LIFTED_RULE.holds(&SupportState { distance: 0.17, ..HELD }));
        assert!(!LIFTED_RULE.holds(&SupportState { height: 0.05, ..HELD }));
    }

    #[test]
    fn what_hangs_low_is_gripped_and_not_lifted() {
        let low = SupportState { height: 0.03, ..HELD };
        assert!(GRIPPED_RULE.holds(&low) && HoldingRule::distance_only(0.15).holds(&low) && !LIFTED_RULE.holds(&low));
    }
}
