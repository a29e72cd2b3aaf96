//! What "in the hand" means, once: something holds the object up that is not the table, and it is within reach of the palm.
//!
//! Who asks sets the figures: the referee has its distance from the scenario file; rehearsals and transports ask
//! besides that the object has been lifted, and take a little more distance, because larger things count for them.

/// How one object is at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// The hand, or something that the hand holds, touches it.
    pub held: bool,
    /// The table touches it.
    pub on_table: bool,
    /// Distance of its origin from the palm's, m.
    pub distance: f64,
    /// Height of its origin over the table, m.
    pub height: f64,
}

/// From where on an object counts as in the hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldingRule {
    /// Greatest distance from the palm's origin, m.
    pub reach: f64,
    /// Height over the table above which the object counts as lifted, m; negative infinity where it need not be.
    pub lifted: f64,
}

/// Of a grasp's proof, and of a trial's policy that is told what it holds: lifted.
pub const LIFTED: HoldingRule = HoldingRule { reach: 0.16, lifted: 0.08 };
/// The same, however low.
pub const GRIPPED: HoldingRule = HoldingRule { lifted: f64::NEG_INFINITY, ..LIFTED };
/// Of balls in a transport, which may be small, or lie behind others.
pub const TRANSPORTED: HoldingRule = HoldingRule { reach: 0.17, lifted: 0.07 };

impl HoldingRule {
    /// The rule that asks for the distance alone.
    pub fn within(reach: f64) -> Self {
        Self { reach, lifted: f64::NEG_INFINITY }
    }

    /// Whether the object is in the hand.
    pub fn holds(&self, object: &Support) -> bool {
        object.held && !object.on_table && object.distance <= self.reach && object.height > self.lifted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELD: Support = Support { held: true, on_table: false, distance: 0.1, height: 0.2 };

    #[test]
    fn every_part_of_the_rule_is_needed() {
        assert!(LIFTED.holds(&HELD));
        assert!(!LIFTED.holds(&Support { held: false, ..HELD }));
        assert!(!LIFTED.holds(&Support { on_table: true, ..HELD }));
        assert!(!LIFTED.holds(&Support { distance: 0.17, ..HELD }));
        assert!(!LIFTED.holds(&Support { height: 0.05, ..HELD }));
    }

    #[test]
    fn what_hangs_low_is_gripped_and_not_lifted() {
        let low = Support { height: 0.03, ..HELD };
        assert!(GRIPPED.holds(&low) && HoldingRule::within(0.15).holds(&low) && !LIFTED.holds(&low));
    }
}
