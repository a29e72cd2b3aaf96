//! External load on the hand, which can look like a failed cable.

/// Strength of an external push on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum WrenchLevel {
    #[default]
    Absent,
    Moderate,
    /// So hard that it may hold closed a digit that grips something.
    Strong,
}

/// External load on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExternalWrench {
    pub level: WrenchLevel,
    /// Largest change of the force between two consecutive recent ticks, N, if contact is expected; zero if not.
    pub jolt: f64,
}
