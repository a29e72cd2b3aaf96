//! Limits of the acceleration and jerk of the arm's set-points.
//!
//! A stream of set-points within the limits passes unchanged, to the last bit. One that exceeds them (a jump, or a
//! motion that starts or stops from one tick to the next) is followed on a profile within the limits, without overshoot
//! from rest, until the profile has caught up. The limits apply relative to the set-points sent before, not to the
//! measured arm. Time is counted in control ticks, so that a late tick changes nothing.

use hand_model::ArmVector;

/// Length of a control tick, s: one command each.
pub const TICK: f64 = 1.0 / 120.0;
/// Bisection steps in the search for a profile's next acceleration.
const BISECTION_STEPS: usize = 40;
/// Tolerance for rounding in sums of many ticks, as a share of a limit.
const ROUNDING_TOLERANCE: f64 = 1e-6;

/// Motion limits of one joint's set-points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionLimits {
    /// Maximum speed, rad/s.
    pub speed: f64,
    /// Maximum acceleration, rad/s2.
    pub acceleration: f64,
    /// Maximum jerk, rad/s3.
    pub jerk: f64,
}

/// State of one joint's set-point.
#[derive(Debug, Clone, Copy, Default)]
struct JointSetPoint {
    /// Set-point, rad.
    angle: f64,
    /// Speed, rad/s.
    speed: f64,
    /// Acceleration, rad/s2.
    acceleration: f64,
    /// Last requested set-point, rad.
    requested: f64,
    catching_up: bool,
}

/// The set-points of all joints.
#[derive(Debug, Clone, Copy)]
pub struct SetPoints(ArmVector<JointSetPoint>);

impl SetPoints {
    /// Creates set-points at rest at `angles`, rad.
    pub fn at(angles: &[f64]) -> Self {
        Self(angles.iter().map(|&at| JointSetPoint { angle: at, requested: at, ..JointSetPoint::default() }).collect())
    }

    /// Returns the same set-points at rest.
    #[must_use]
    pub fn at_rest(&self) -> Self {
        Self::at(&self.angles())
    }

    /// Returns the angles of the set-points, rad.
    pub fn angles(&self) -> ArmVector {
        self.0.iter().map(|joint| joint.angle).collect()
    }

    /// Returns the speeds of the set-points, rad/s.
    pub fn speeds(&self) -> ArmVector {
        self.0.iter().map(|joint| joint.speed).collect()
    }

    /// Returns the set-points of the next tick when `wanted` (rad) is requested.
    #[must_use]
    pub fn follow(&self, wanted: &[f64], limits: &[MotionLimits]) -> Self {
        Self(
            self.0
                .iter()
                .zip(wanted)
                .zip(limits)
                .map(|((joint, wanted), limits)| joint.follow(*wanted, *limits))
                .collect(),
        )
    }
}

impl MotionLimits {
    fn allows(&self, speed: f64, acceleration: f64, jerk: f64) -> bool {
        let within = |value: f64, limit: f64| value.abs() <= limit * (1.0 + ROUNDING_TOLERANCE);
        within(speed, self.speed) && within(acceleration, self.acceleration) && within(jerk, self.jerk)
    }

    /// Computes the signed stopping distance, rad, of a joint with this speed and acceleration that comes to rest as
    /// fast as the limits allow.
    fn stopping_distance(&self, speed: f64, acceleration: f64) -> f64 {
        let (time, gained) = (acceleration.abs() / self.jerk, 0.5 * acceleration * acceleration.abs() / self.jerk);
        let left = speed + gained;
        if acceleration * speed < 0.0 && left * speed >= 0.0 {
            // The joint is in the middle of braking that began at a higher speed with zero acceleration.
            let began = speed - gained;
            let gone = began * time + acceleration * time * time / 6.0;
            return self.steady_stopping_distance(began) - gone;
        }
        speed * time + acceleration * time * time / 3.0 + self.steady_stopping_distance(left)
    }

    fn steady_stopping_distance(&self, speed: f64) -> f64 {
        if speed == 0.0 {
            return 0.0;
        }
        let peak = self.acceleration.min((speed.abs() * self.jerk).sqrt());
        0.5 * speed * (speed.abs() / peak + peak / self.jerk)
    }
}

impl JointSetPoint {
    fn follow(&self, wanted: f64, limits: MotionLimits) -> Self {
        let speed = (wanted - self.angle) / TICK;
        let acceleration = (speed - self.speed) / TICK;
        let within = limits.allows(speed, acceleration, (acceleration - self.acceleration) / TICK);
        // Speed of the requested set-points themselves; a jump counts as no motion.
        let stream = Some((wanted - self.requested) / TICK).filter(|speed| speed.abs() <= limits.speed).unwrap_or(0.0);
        // Having caught up, the joint must be able to go on at their speed, and without acceleration.
        let next = (stream - speed) / TICK;
        let goes_on =
            limits.allows(stream, next, (next - acceleration) / TICK) && limits.allows(stream, 0.0, next / TICK);
        if within && (!self.catching_up || goes_on) {
            return Self { angle: wanted, speed, acceleration, requested: wanted, catching_up: false };
        }
        let acceleration = self.catch_up(wanted, stream, limits);
        let speed = self.speed + acceleration * TICK;
        Self { angle: self.angle + speed * TICK, speed, acceleration, requested: wanted, catching_up: true }
    }

    /// Finds the greatest acceleration within the limits from which the joint, as seen from set-points that move at
    /// `stream` (rad/s), can still come to rest no farther than `wanted` (rad).
    fn catch_up(&self, wanted: f64, stream: f64, limits: MotionLimits) -> f64 {
        let change = limits.jerk * TICK;
        let low = (self.acceleration - change).max(-limits.acceleration).min(limits.acceleration);
        let high = (self.acceleration + change).min(limits.acceleration).max(low);
        let speed = |acceleration: f64| self.speed + acceleration * TICK;
        // Speed reached while the acceleration returns to zero.
        let top = |acceleration: f64| speed(acceleration) + 0.5 * acceleration * acceleration.abs() / limits.jerk;
        let beyond = |acceleration: f64| {
            let left = wanted - (self.angle + speed(acceleration) * TICK);
            limits.stopping_distance(speed(acceleration) - stream, acceleration) - left
        };
        let highest = bisect(low, high, |acceleration| top(acceleration) - limits.speed);
        let lowest = bisect(low, highest, |acceleration| top(acceleration) + limits.speed);
        bisect(lowest, highest, beyond)
    }
}

/// Finds the root of a rising function between `low` and `high` by bisection; without a root, returns the end nearer to
/// it.
fn bisect(mut low: f64, mut high: f64, rises: impl Fn(f64) -> f64) -> f64 {
    if rises(high) <= 0.0 {
        return high;
    }
    if rises(low) >= 0.0 {
        return low;
    }
    for _ in 0..BISECTION_STEPS {
        let middle = 0.5 * (low + high);
        if rises(middle) > 0.0 { high = middle } else { low = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: MotionLimits = MotionLimits { speed: 1.4, acceleration: 9.0, jerk: 300.0 };

    fn rest(at: f64) -> JointSetPoint {
        SetPoints::at(&[at; 7]).0[0]
    }

    proptest! {
        /// A stream within the limits is followed bit for bit.
        #[test]
        fn a_stream_passes_unchanged(jerks in prop::collection::vec(-290.0..290.0_f64, 1..60)) {
            let mut joint = rest(0.3);
            let (mut at, mut speed, mut acceleration) = (0.3, 0.0_f64, 0.0_f64);
            for jerk in jerks {
                acceleration = (acceleration + jerk * TICK).clamp(-8.9, 8.9);
                if (speed + acceleration * TICK).abs() > 1.35 {
                    acceleration = 0.0;
                    speed = joint.speed;
                }
                speed += acceleration * TICK;
                at += speed * TICK;
                joint = joint.follow(at, MotionLimits { jerk: 3000.0, ..LIMITS });
                prop_assert_eq!(joint.angle, at);
            }
        }

        /// A jump, or a motion that starts and stops from one tick to the next, is followed within all limits and
        /// reached, without going far beyond it.
        #[test]
        fn a_jump_is_followed_within_all_limits(jumps in prop::collection::vec((-2.0..2.0_f64, 1..200_usize), 1..4)) {
            let mut joint = rest(0.0);
            let (mut least, mut most) = (0.0_f64, 0.0_f64);
            let mut wanted = 0.0;
            for (jump, ticks) in jumps {
                wanted = jump;
                (least, most) = (least.min(jump), most.max(jump));
                for _ in 0..ticks {
                    let next = joint.follow(wanted, LIMITS);
                    prop_assert!(next.speed.abs() <= 1.4 * 1.001 && next.acceleration.abs() <= 9.0 * 1.001);
                    prop_assert!((next.acceleration - joint.acceleration).abs() <= 300.0 * TICK * 1.001);
                    prop_assert!((least - 0.25..=most + 0.25).contains(&next.angle), "{}", next.angle);
                    joint = next;
                }
            }
            for _ in 0..800 {
                joint = joint.follow(wanted, LIMITS);
            }
            prop_assert!((joint.angle - wanted).abs() < 1e-9 && joint.speed == 0.0, "{joint:?}, wanted {wanted}");
        }
    }

    /// From rest a jump is reached without overshoot, in about the time that the limits require.
    #[test]
    fn a_jump_from_rest_is_not_overshot() {
        let mut joint = rest(0.0);
        let ticks = (0..1000).position(|_| {
            joint = joint.follow(1.0, LIMITS);
            assert!(joint.angle <= 1.0 + 1e-4, "{joint:?}");
            joint.angle == 1.0 && joint.speed == 0.0
        });
        // 1 rad at 1.4 rad/s, 1.4 / 9 s and 9 / 300 s of ramps.
        let seconds = ticks.expect("reached") as f64 * TICK;
        assert!((seconds - (1.0 / 1.4 + 1.4 / 9.0 + 9.0 / 300.0)).abs() < 0.1, "{seconds}");
    }
}
