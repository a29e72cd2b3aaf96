//! The bridge's clock: the host's monotonic clock, or an emulated one that is advanced in steps.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Clock that counts seconds since the bridge's start.
#[derive(Debug, Clone)]
pub enum Clock {
    /// Real time since this instant.
    Wall(Instant),
    /// Advanced only by [`Clock::advance`]. Holds the bits of an `f64`; clones share the time.
    Emulated(Arc<AtomicU64>),
}

impl Clock {
    /// Creates a real-time clock that starts now.
    pub fn wall() -> Self {
        Self::Wall(Instant::now())
    }

    /// Creates an emulated clock at 0 s.
    pub fn emulated() -> Self {
        Self::Emulated(Arc::new(AtomicU64::new(0.0_f64.to_bits())))
    }

    /// Returns the present time, s.
    pub fn now(&self) -> f64 {
        match self {
            Self::Wall(start) => start.elapsed().as_secs_f64(),
            Self::Emulated(bits) => f64::from_bits(bits.load(Ordering::Acquire)),
        }
    }

    /// Advances an emulated clock by `seconds`; has no effect on a real-time clock.
    pub fn advance(&self, seconds: f64) {
        if let Self::Emulated(bits) = self {
            bits.store((self.now() + seconds).to_bits(), Ordering::Release);
        }
    }
}
