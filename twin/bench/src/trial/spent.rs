//! Where the time of trials goes.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// A part of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Physics of the scene, ticks without images.
    Physics,
    /// Ticks that end with tactile images: their rendering, mostly.
    Images,
    /// The executive: paths, inverse kinematics, tensions.
    Control,
    /// The referee's view of the scene and the recording.
    Referee,
    /// From images to touches, the held object's pose and what is in the hand.
    Perception,
    /// The choice of a grasp: reach, clearance along the way, worth.
    Choice,
}

impl Part {
    /// All, in the order of tables.
    pub const ALL: [Self; 6] =
        [Self::Physics, Self::Images, Self::Control, Self::Referee, Self::Perception, Self::Choice];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Physics => "physics",
            Self::Images => "images",
            Self::Control => "control",
            Self::Referee => "referee",
            Self::Perception => "perception",
            Self::Choice => "choice",
        }
    }
}

/// Time spent so far, all threads together.
#[derive(Debug, Default)]
pub struct Spent([AtomicU64; Part::ALL.len()]);

impl Spent {
    /// Does `work` and counts its time as `part`'s.
    pub fn on<T>(&self, part: Part, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let done = work();
        self.0[part as usize].fetch_add(begun.elapsed().as_nanos() as u64, Ordering::Relaxed);
        done
    }

    /// Each part and its seconds.
    pub fn seconds(&self) -> Vec<(Part, f64)> {
        Part::ALL.into_iter().map(|part| (part, 1e-9 * self.0[part as usize].load(Ordering::Relaxed) as f64)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_to_the_part_that_took_it() {
        let spent = Spent::default();
        let value = spent.on(Part::Choice, || (0..100_000u64).map(|n| n % 7).sum::<u64>());
        assert_eq!(value, 299_995);
        for (part, seconds) in spent.seconds() {
            assert_eq!(seconds > 0.0, part == Part::Choice, "{}", part.name());
        }
    }
}
