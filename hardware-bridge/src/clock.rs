//! The clock that the bridge goes by: the one on the wall, or an emulated one that somebody moves on.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Seconds since the bridge's start.
#[derive(Debug, Clone)]
pub enum Clock {
    /// Passes by itself.
    Wall(Instant),
    /// Passes by [`Clock::advance`] alone (the bits of an `f64`); clones show the same time.
    Emulated(Arc<AtomicU64>),
}

impl Clock {
    /// A clock that starts now and passes by itself.
    pub fn wall() -> Self {
        Self::Wall(Instant::now())
    }

    /// A clock that shows 0 until somebody moves it on.
    pub fn emulated() -> Self {
        Self::Emulated(Arc::new(AtomicU64::new(0.0_f64.to_bits())))
    }

    /// s.
    pub fn now(&self) -> f64 {
        match self {
            Self::Wall(start) => start.elapsed().as_secs_f64(),
            Self::Emulated(bits) => f64::from_bits(bits.load(Ordering::Acquire)),
        }
    }

    /// Moves an emulated clock on by `seconds`; one on the wall moves by itself, and this does nothing to it.
    pub fn advance(&self, seconds: f64) {
        if let Self::Emulated(bits) = self {
            bits.store((self.now() + seconds).to_bits(), Ordering::Release);
        }
    }
}
