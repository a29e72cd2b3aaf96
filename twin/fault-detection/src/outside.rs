//! What acts on the hand from outside, by which a digit's cable may seem to have failed.

/// How something pushes the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Pushed {
    #[default]
    No,
    Yes,
    /// So hard that it may hold digits closed that grip something.
    Hard,
}

/// What acts on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Outside {
    pub pushed: Pushed,
    /// By how much its force changed at the most from one of the newest ticks to the next where contact is expected, N; zero where it is not.
    pub jolt: f64,
}
