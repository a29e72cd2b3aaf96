//! Thinning of a stream: a maximum rate, and no repetition of unchanged data.

use std::collections::HashMap;

use nalgebra::Isometry3;

/// Rate limiter: lets an event through at most at `rate` Hz per key.
#[derive(Debug)]
pub struct RateLimiter {
    interval: f64,
    last: HashMap<usize, f64>,
}

impl RateLimiter {
    /// Creates a limiter with `rate` in Hz; an infinite rate lets everything through.
    pub fn new(rate: f64) -> Self {
        Self { interval: if rate > 0.0 { rate.recip() } else { f64::INFINITY }, last: HashMap::new() }
    }

    /// True if `key` is due at `time`; it then counts as processed. If time runs backwards, the limiter restarts.
    pub fn due(&mut self, key: usize, time: f64) -> bool {
        // A tolerance of a tenth of the interval avoids aliasing with ticks that do not divide it evenly.
        let due = self.last.get(&key).is_none_or(|last| time < *last || time - last >= 0.9 * self.interval);
        if due {
            self.last.insert(key, time);
        }
        due
    }
}

/// Memory of the last pose of each path, to detect motion.
#[derive(Debug, Default)]
pub struct LastPoses(HashMap<String, Isometry3<f64>>);

impl LastPoses {
    /// True if `pose` differs from the last one of `path` by more than 20 um or 0.2 mrad; it then becomes the last one.
    pub fn has_moved(&mut self, path: &str, pose: &Isometry3<f64>) -> bool {
        if let Some(last) = self.0.get(path) {
            let still = (last.translation.vector - pose.translation.vector).norm() < 2e-5
                && last.rotation.angle_to(&pose.rotation) < 2e-4;
            if still {
                return false;
            }
        }
        self.0.insert(path.to_owned(), *pose);
        true
    }

    /// Forgets `path`. Returns true if it was known.
    pub fn forget(&mut self, path: &str) -> bool {
        self.0.remove(path).is_some()
    }

    /// True if `path` is known.
    pub fn knows(&self, path: &str) -> bool {
        self.0.contains_key(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pace_holds_its_rate() {
        let mut pace = RateLimiter::new(30.0);
        let passed = (0..500).filter(|i| pace.due(0, *i as f64 * 0.01)).count();
        assert!((125..=170).contains(&passed), "5 s at 100 Hz thinned to {passed}");
        assert!(pace.due(1, 4.99), "another key has its own clock");
        assert!(pace.due(0, 0.0), "a new run starts anew");
    }

    #[test]
    fn only_motion_passes() {
        let mut moved = LastPoses::default();
        assert!(moved.has_moved("a", &Isometry3::translation(0.0, 0.0, 0.0)));
        assert!(!moved.has_moved("a", &Isometry3::translation(1e-5, 0.0, 0.0)));
        assert!(moved.has_moved("a", &Isometry3::translation(3e-5, 0.0, 0.0)));
        assert!(moved.forget("a") && !moved.knows("a"));
    }
}
