//! The arm's low-level controller, which turns the set-points it is sent into those it follows.
//!
//! A stream of set-points within the joints' speed limits passes unchanged, to the last bit; a slightly faster one is
//! limited to that speed. A set-point farther away than a joint can move in two ticks is a jump. It is followed along a
//! profile with bounded speed and acceleration until the joint has caught up with the stream. Without the profile a
//! jump would be a step in speed, to which a stiff position control responds by overshooting the speed limit.

/// Fraction of a joint's greatest acceleration used to catch up; the rest is reserved for gravity and the motion of
/// other joints.
const ACCELERATION_SHARE: f64 = 0.5;
/// Jump threshold: a set-point farther away than this many times the motion per tick at the speed limit is a jump. A
/// client that sends a thousand set-points a second fits eight or nine of them into a tick, so up to 1.08 belongs to
/// its stream.
const JUMP_THRESHOLD: f64 = 2.0;

/// Motion limits of one joint.
#[derive(Debug, Clone, Copy)]
pub struct SetPointLimits {
    /// Speed limit, rad/s.
    pub speed: f64,
    /// Acceleration limit, rad/s2.
    pub acceleration: f64,
}

/// The set-point that one joint follows.
#[derive(Debug, Clone, Copy, Default)]
pub struct SetPoint {
    /// Angle that is followed, rad.
    pub angle: f64,
    /// Speed of the followed set-point, rad/s.
    speed: f64,
    /// The last set-point sent, rad.
    commanded: f64,
    catching_up: bool,
}

impl SetPoint {
    /// Creates a set-point at rest at `at` (rad).
    pub fn new(at: f64) -> Self {
        Self { angle: at, speed: 0.0, commanded: at, catching_up: false }
    }

    /// Computes the angle that the joint follows in the next tick of length `tick` (s) when `wanted` (rad) is
    /// commanded.
    pub fn follow(&mut self, wanted: f64, limits: SetPointLimits, tick: f64) -> f64 {
        let reach = limits.speed * tick;
        let change = ACCELERATION_SHARE * limits.acceleration * tick;
        let way = wanted - self.angle;
        let within = way.abs() <= JUMP_THRESHOLD * reach;
        // Speed of the stream of set-points itself; a jump does not count as motion.
        let stream = Some((wanted - self.commanded) / tick).filter(|speed| speed.abs() <= limits.speed).unwrap_or(0.0);
        self.commanded = wanted;
        let near = |speed: f64| (way / tick - speed).abs() <= change;
        self.catching_up = !within || self.catching_up && !(near(self.speed) && near(stream));
        let next = if self.catching_up {
            // The largest v with v dt + v^2 / 2a within the remaining distance beyond the stream's, on top of the
            // stream's speed.
            let left = way - stream * tick;
            let brakeable = -change + (change * change + 2.0 * change / tick * left.abs()).sqrt();
            let aim = (stream + left.signum() * brakeable).clamp(-limits.speed, limits.speed);
            self.angle + aim.clamp(self.speed - change, self.speed + change) * tick
        } else {
            wanted.clamp(self.angle - reach, self.angle + reach)
        };
        self.speed = (next - self.angle) / tick;
        self.angle = next;
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TICK: f64 = 1.0 / 120.0;
    const LIMITS: SetPointLimits = SetPointLimits { speed: 1.4, acceleration: 8.6 };

    proptest! {
        /// A stream within the speed limit is followed bit for bit.
        #[test]
        fn a_stream_passes_unchanged(speeds in prop::collection::vec(-1.4f64..1.4, 1..60)) {
            let mut joint = SetPoint::new(0.3);
            let mut wanted = 0.3;
            for speed in speeds {
                wanted += speed * TICK;
                prop_assert_eq!(joint.follow(wanted, LIMITS, TICK), wanted);
            }
        }

        /// After a jump the joint respects both limits, never overshoots the goal, and reaches it.
        #[test]
        fn a_jump_is_followed_smoothly(jump in -3.0f64..3.0) {
            let mut joint = SetPoint::new(0.0);
            let (mut before, mut speed) = (0.0, 0.0f64);
            for _ in 0..600 {
                let at = joint.follow(jump, LIMITS, TICK);
                let now = (at - before) / TICK;
                prop_assert!(now.abs() <= LIMITS.speed * (1.0 + 1e-9));
                // A smaller one does not count as a jump.
                if jump.abs() > JUMP_THRESHOLD * LIMITS.speed * TICK {
                    prop_assert!((now - speed).abs() <= LIMITS.acceleration * TICK * (1.0 + 1e-9), "{} {}", speed, now);
                }
                prop_assert!(at * jump.signum() <= jump.abs() + 1e-12);
                (before, speed) = (at, now);
            }
            prop_assert_eq!(before, jump);
        }

        /// The joint catches up with a stream that jumps and then moves on.
        #[test]
        fn a_moving_stream_is_caught_up_with(jump in -1.0f64..1.0, speed in -1.0f64..1.0) {
            let mut joint = SetPoint::new(0.0);
            let mut wanted = jump;
            for _ in 0..900 {
                wanted += speed * TICK;
                joint.follow(wanted, LIMITS, TICK);
            }
            prop_assert_eq!(joint.angle, wanted);
        }
    }
}
