//! The course of the arm's set-points, from which the arm must not depart.
//!
//! An arm follows its set-points with a lag. Its posture is therefore compared with all set-points of the last moments:
//! each joint must be near the range that they have covered. An arm that stands still, or that moves without being sent
//! anywhere, departs from it.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use hand_model::ArmVector;

use super::limits::ArmLimits;

/// Least time between two remembered set-points, s.
const SPACING: f64 = 0.005;
/// Greatest number of remembered set-points: more than the oldest measurement and the longest lag need.
const MAX_REMEMBERED: usize = 1000;

/// Set-points of the last moments.
#[derive(Debug, Clone, Default)]
pub struct ArmCourse {
    /// Times (s) and set-points (rad), in order.
    past: VecDeque<(f64, ArmVector)>,
}

impl ArmCourse {
    /// Remembers the set-points sent at `now` (s), rad.
    pub fn note(&mut self, now: f64, sent: &ArmVector) {
        if self.past.back().is_none_or(|(at, _)| now - at >= SPACING) {
            self.past.push_back((now, *sent));
        }
        if self.past.len() > MAX_REMEMBERED {
            self.past.pop_front();
        }
    }

    /// Returns the joint that is farthest from the set-points since the arm's lag before the measurement, and its
    /// distance (rad), if that is more than the limit. `measured_at` (s) is the time of the `posture` (rad). Whole turns
    /// of a joint do not count.
    pub fn departure(&mut self, posture: &ArmVector, measured_at: f64, limits: &ArmLimits) -> Option<(usize, f64)> {
        while self.past.len() > 1 && self.past[1].0 <= measured_at - limits.lag {
            self.past.pop_front();
        }
        let (_, first) = self.past.front()?;
        let distance = |joint: usize| {
            let covered = self.past.iter().map(|(_, sent)| sent[joint]);
            let (low, high) = covered.fold((first[joint], first[joint]), |(low, high), at| (low.min(at), high.max(at)));
            let middle = 0.5 * (low + high);
            (joint, (nearest_turn(posture[joint], middle) - middle).abs() - 0.5 * (high - low))
        };
        let farthest = (0..posture.len()).map(distance).max_by(|a, b| a.1.total_cmp(&b.1))?;
        (farthest.1 > limits.following).then_some(farthest)
    }
}

/// Returns an angle (rad) plus the whole turns that bring it nearest to another.
pub fn nearest_turn(angle: f64, other: f64) -> f64 {
    other + (angle - other + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::super::limits::USUAL_FOLLOWING;
    use super::super::limits::tests::limits;
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
            // The measurement is somewhat old.
            let measured_at = (now - 0.05).max(0.0);
            course.departure(&posture(arm(measured_at)), measured_at, &limits().arm)
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
        assert!(joint == 0 && (USUAL_FOLLOWING..0.12).contains(&off), "{off}");
        let (_, off) = departs(0.0, |now| 3.0 * now).expect("it runs away");
        assert!((USUAL_FOLLOWING..0.12).contains(&off), "{off}");
        assert!(departs(0.5, |now| -0.5 * now).is_some(), "it goes the other way");
    }
}
