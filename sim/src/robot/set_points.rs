//! The arm's low-level controller between the set-points it is sent and those it follows.
//!
//! A stream of set-points within the joints' speed limits passes unchanged, to the last bit; a slightly faster one is limited to
//! that speed. A set-point farther away than a joint can move in two ticks is a jump. It is followed along a profile with bounded
//! speed and acceleration until the joint has caught up with the stream. Without the profile a jump would be a step in speed,
//! to which a stiff position control responds by overshooting the speed limit.

/// Share of a joint's greatest acceleration that is used to catch up: the rest is for gravity and the other joints' motion.
const ACCELERATION_SHARE: f64 = 0.5;
/// A set-point farther away than this many times what the speed limit allows in a tick is a jump. A client that sends a thousand
/// set-points a second fits eight or nine of them into a tick: up to 1.08 is still its stream.
const JUMP: f64 = 2.0;

/// What one joint may do.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// rad/s.
    pub speed: f64,
    /// rad/s2.
    pub acceleration: f64,
}

/// The set-point that one joint follows.
#[derive(Debug, Clone, Copy, Default)]
pub struct SetPoint {
    /// What is followed, rad.
    pub at: f64,
    /// rad/s.
    speed: f64,
    /// The last set-point sent, rad.
    wanted: f64,
    catching_up: bool,
}

impl SetPoint {
    /// At rest at `at` (rad).
    pub fn new(at: f64) -> Self {
        Self { at, speed: 0.0, wanted: at, catching_up: false }
    }

    /// What the joint follows in the next tick of `tick` (s) when `wanted` (rad) is asked for.
    pub fn follow(&mut self, wanted: f64, limits: Limits, tick: f64) -> f64 {
        let reach = limits.speed * tick;
        let change = ACCELERATION_SHARE * limits.acceleration * tick;
        let way = wanted - self.at;
        let within = way.abs() <= JUMP * reach;
        // How fast the stream of set-points itself moves; a jump is no motion.
        let stream = Some((wanted - self.wanted) / tick).filter(|speed| speed.abs() <= limits.speed).unwrap_or(0.0);
        self.wanted = wanted;
        let near = |speed: f64| (way / tick - speed).abs() <= change;
        self.catching_up = !within || self.catching_up && !(near(self.speed) && near(stream));
        let next = if self.catching_up {
            // The greatest v with v dt + v^2 / 2a within the way that is left beyond the stream's, on top of its speed.
            let left = way - stream * tick;
            let brakeable = -change + (change * change + 2.0 * change / tick * left.abs()).sqrt();
            let aim = (stream + left.signum() * brakeable).clamp(-limits.speed, limits.speed);
            self.at + aim.clamp(self.speed - change, self.speed + change) * tick
        } else {
            wanted.clamp(self.at - reach, self.at + reach)
        };
        self.speed = (next - self.at) / tick;
        self.at = next;
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TICK: f64 = 1.0 / 120.0;
    const LIMITS: Limits = Limits { speed: 1.4, acceleration: 8.6 };

    proptest! {
        /// A stream that keeps to the speed limit is followed bit for bit.
        #[test]
        fn a_stream_passes_unchanged(speeds in prop::collection::vec(-1.4f64..1.4, 1..60)) {
            let mut joint = SetPoint::new(0.3);
            let mut wanted = 0.3;
            for speed in speeds {
                wanted += speed * TICK;
                prop_assert_eq!(joint.follow(wanted, LIMITS, TICK), wanted);
            }
        }

        /// After a jump the joint keeps to both limits, never goes past the goal, and gets there.
        #[test]
        fn a_jump_is_followed_smoothly(jump in -3.0f64..3.0) {
            let mut joint = SetPoint::new(0.0);
            let (mut before, mut speed) = (0.0, 0.0f64);
            for _ in 0..600 {
                let at = joint.follow(jump, LIMITS, TICK);
                let now = (at - before) / TICK;
                prop_assert!(now.abs() <= LIMITS.speed * (1.0 + 1e-9));
                // A smaller one is no jump.
                if jump.abs() > JUMP * LIMITS.speed * TICK {
                    prop_assert!((now - speed).abs() <= LIMITS.acceleration * TICK * (1.0 + 1e-9), "{} {}", speed, now);
                }
                prop_assert!(at * jump.signum() <= jump.abs() + 1e-12);
                (before, speed) = (at, now);
            }
            prop_assert_eq!(before, jump);
        }

        /// A stream that jumps and then moves on is caught up with.
        #[test]
        fn a_moving_stream_is_caught_up_with(jump in -1.0f64..1.0, speed in -1.0f64..1.0) {
            let mut joint = SetPoint::new(0.0);
            let mut wanted = jump;
            for _ in 0..900 {
                wanted += speed * TICK;
                joint.follow(wanted, LIMITS, TICK);
            }
            prop_assert_eq!(joint.at, wanted);
        }
    }
}
