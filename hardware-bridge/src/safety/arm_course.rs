//! The course of the arm's set-points, from which the arm must not depart.
//!
//! An arm follows its set-points with a lag. Its posture is therefore compared with all set-points of the last moments:
//! each joint must be near the range that they have covered. An arm that stands still, or that moves without being sent
//! anywhere, departs from it.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use hand_model::ArmVector;

/// Time for which set-points are remembered, s: more than an arm's lag.
const MEMORY: f64 = 0.2;
/// Tolerance of a joint outside the range of its set-points, rad: 6 deg.
const TOLERANCE: f64 = 0.1;
/// Least time between two remembered set-points, s.
const SPACING: f64 = 0.005;

/// Set-points of the last moments.
#[derive(Debug, Clone, Default)]
pub struct ArmCourse {
    /// Times (s) and set-points (rad), in order.
    past: VecDeque<(f64, ArmVector)>,
}

impl ArmCourse {
    /// Remembers the set-points sent at `now` (s), rad.
    pub fn note(&mut self, now: f64, sent: &ArmVector) {
        while self.past.len() > 1 && self.past[1].0 <= now - MEMORY {
            self.past.pop_front();
        }
        if self.past.back().is_none_or(|(at, _)| now - at >= SPACING) {
            self.past.push_back((now, *sent));
        }
    }

    /// Returns the joint that is farthest from the set-points of the last moments, and its distance (rad), if it is more
    /// than the tolerance. Whole turns of a joint do not count.
    pub fn departure(&self, posture: &ArmVector) -> Option<(usize, f64)> {
        let (_, first) = self.past.front()?;
        let distance = |joint: usize| {
            let turned = |angle: f64| (angle - first[joint] + PI).rem_euclid(TAU) - PI;
            let covered = self.past.iter().map(|(_, sent)| sent[joint] - first[joint]);
            let (low, high) = covered.fold((0.0_f64, 0.0_f64), |(low, high), at| (low.min(at), high.max(at)));
            let middle = first[joint] + 0.5 * (low + high);
            let off = turned(posture[joint] - middle + first[joint]).abs() - 0.5 * (high - low);
            (joint, off)
        };
        let farthest = (0..posture.len()).map(distance).max_by(|a, b| a.1.total_cmp(&b.1))?;
        (farthest.1 > TOLERANCE).then_some(farthest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn posture(first: f64) -> ArmVector {
        [first, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].into()
    }

    /// Runs set-points at `speed` (rad/s) for two seconds, and returns the first departure of an arm that is at `arm` of
    /// the time.
    fn departs(speed: f64, arm: impl Fn(f64) -> f64) -> Option<(usize, f64)> {
        let mut course = ArmCourse::default();
        (0..2000).find_map(|n| {
            let now = 0.001 * f64::from(n);
            course.note(now, &posture(speed * now));
            course.departure(&posture(arm(now)))
        })
    }

    #[test]
    fn an_arm_that_follows_with_a_lag_is_on_its_course() {
        assert_eq!(departs(1.4, |now| 1.4 * (now - 0.15_f64).max(0.0)), None);
        assert_eq!(departs(-1.4, |now| -1.4 * (now - 0.15_f64).max(0.0) + 0.05), None);
        // A joint that turns freely reports its angle within one turn.
        assert_eq!(departs(4.0, |now| (4.0 * now + PI).rem_euclid(TAU) - PI), None);
    }

    #[test]
    fn an_arm_that_stands_still_or_runs_away_is_not() {
        let (joint, off) = departs(1.0, |_| 0.0).expect("it stands still");
        assert!(joint == 0 && (TOLERANCE..0.12).contains(&off), "{off}");
        let (_, off) = departs(0.0, |now| 3.0 * now).expect("it runs away");
        assert!((TOLERANCE..0.12).contains(&off), "{off}");
        assert!(departs(0.5, |now| -0.5 * now).is_some(), "it goes the other way");
    }
}
