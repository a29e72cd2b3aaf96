//! Profile of trials: wall time by activity.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Activity of a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Physics of the scene, ticks without images.
    Physics,
    /// Ticks that end with tactile images, mostly their rendering.
    Images,
    /// The executor: paths, inverse kinematics, tensions.
    Control,
    /// The referee's view of the scene and the recording.
    Referee,
    /// Perception: touches from images, the held object's pose, and the content of the hand.
    Perception,
    /// The choice of a grasp: reach, clearance along the path, score.
    Choice,
}

impl Activity {
    /// All activities, in the order of tables.
    pub const ALL: [Self; 6] =
        [Self::Physics, Self::Images, Self::Control, Self::Referee, Self::Perception, Self::Choice];

    /// Returns the name in tables.
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

/// Wall time so far, summed over all threads.
#[derive(Debug, Default)]
pub struct Profile([AtomicU64; Activity::ALL.len()]);

impl Profile {
    /// Runs `work` and adds its time to `activity`.
    pub fn measure<T>(&self, activity: Activity, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let done = work();
        self.0[activity as usize].fetch_add(begun.elapsed().as_nanos() as u64, Ordering::Relaxed);
        done
    }

    /// Returns the time of each activity, s.
    pub fn seconds(&self) -> Vec<(Activity, f64)> {
        Activity::ALL
            .into_iter()
            .map(|activity| (activity, 1e-9 * self.0[activity as usize].load(Ordering::Relaxed) as f64))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_to_the_part_that_took_it() {
        let profile = Profile::default();
        let value = profile.measure(Activity::Choice, || (0..100_000u64).map(|n| n % 7).sum::<u64>());
        assert_eq!(value, 299_995);
        for (activity, seconds) in profile.seconds() {
            assert_eq!(seconds > 0.0, activity == Activity::Choice, "{}", activity.name());
        }
    }
}
