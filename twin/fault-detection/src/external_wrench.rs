//! External wrench on the hand, which can look like a failed cable.

/// Strength of an external push on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum WrenchLevel {
    #[default]
    Absent,
    Moderate,
    /// So strong that it may keep closed a digit that grips something.
    Strong,
}

/// External wrench on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExternalWrench {
    pub level: WrenchLevel,
    /// Largest change of the force between two consecutive recent ticks, N, if contact is expected; otherwise zero.
    pub jolt: f64,
}
