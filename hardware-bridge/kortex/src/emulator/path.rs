//! Path of the joints to a posture: all together along minimum-jerk curves, at rest at both ends.

use crate::joints::JOINTS;

/// Limits if the host requests no duration: rad/s of the fastest joint, and rad/s2. Our reading.
const MODEST: PathLimits = PathLimits { speed: 0.5, acceleration: 1.5 };
/// Limits if the host requests a duration: the slowest joint's top speed (published: 69.9 degrees per second), and our
/// reading of the acceleration.
const TOP: PathLimits = PathLimits { speed: TOP_SPEED, acceleration: 5.0 };
/// Top speed, rad/s.
pub(super) const TOP_SPEED: f64 = 1.22;
/// Top speed of a minimum-jerk curve, as a multiple of distance / duration.
const PEAK_SPEED: f64 = 1.875;
/// Largest acceleration of a minimum-jerk curve, as a multiple of distance / duration².
const PEAK_ACCELERATION: f64 = 5.773_502_691_896_258;

#[derive(Debug, Clone, Copy)]
struct PathLimits {
    speed: f64,
    acceleration: f64,
}

/// Requested speed of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Haste {
    /// The arm's own speed.
    Modest,
    /// Duration, s. A time too short for the joints is extended.
    Duration(f64),
    /// Top speed of the fastest joint, rad/s.
    Speed(f64),
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Path {
    from: [f64; JOINTS],
    to: [f64; JOINTS],
    /// Start on the arm's clock, ms.
    start: u64,
    /// Duration, ms.
    duration: u64,
}

impl Path {
    /// Creates the path between two postures (rad) that starts at `start` (ms).
    pub(super) fn new(from: [f64; JOINTS], to: [f64; JOINTS], haste: Haste, start: u64) -> Self {
        let seconds = match haste {
            Haste::Modest => shortest(&from, &to, MODEST),
            Haste::Duration(seconds) => seconds.max(soonest(&from, &to)),
            Haste::Speed(speed) => shortest(&from, &to, PathLimits { speed, ..MODEST }),
        };
        Self { from, to, start, duration: (seconds * 1e3).ceil() as u64 }
    }

    /// Returns the end of the path, ms. At a very low requested speed the path never ends.
    pub(super) fn end(&self) -> u64 {
        self.start.saturating_add(self.duration)
    }

    /// Returns the joint angles at `now` (ms), rad. After the end they are exactly the target.
    pub(super) fn at(&self, now: u64) -> [f64; JOINTS] {
        if now >= self.end() {
            return self.to;
        }
        let u = now.saturating_sub(self.start) as f64 / self.duration as f64;
        let share = u * u * u * (10.0 - u * (15.0 - 6.0 * u));
        std::array::from_fn(|i| self.from[i] + (self.to[i] - self.from[i]) * share)
    }
}

/// Returns the shortest time in which the joints can reach the target, s.
pub(super) fn soonest(from: &[f64; JOINTS], to: &[f64; JOINTS]) -> f64 {
    shortest(from, to, TOP)
}

fn shortest(from: &[f64; JOINTS], to: &[f64; JOINTS], limits: PathLimits) -> f64 {
    let way = (0..JOINTS).map(|i| (to[i] - from[i]).abs()).fold(0.0, f64::max);
    (PEAK_SPEED * way / limits.speed).max((PEAK_ACCELERATION * way / limits.acceleration).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FROM: [f64; JOINTS] = [0.0, 0.1, -0.2, 0.3, 0.0, 0.0, 3.0];

    proptest! {
        /// Every path starts and ends at its given postures and keeps its speed and acceleration.
        #[test]
        fn keeps_its_limits(to in prop::array::uniform7(-3.0..3.0_f64), speed in 0.05..1.2_f64) {
            let path = Path::new(FROM, to, Haste::Speed(speed), 500);
            prop_assert_eq!(path.at(500), FROM);
            prop_assert_eq!(path.at(path.end()), to);
            prop_assert_eq!(path.at(path.end() + 1000), to);
            let mut before = [0.0; JOINTS];
            for now in 500..path.end() {
                let (here, next) = (path.at(now), path.at(now + 1));
                for i in 0..JOINTS {
                    let rate = (next[i] - here[i]) * 1e3;
                    prop_assert!(rate.abs() <= speed * 1.0001, "{rate}");
                    prop_assert!((rate - before[i]).abs() * 1e3 <= MODEST.acceleration * 1.01, "{rate} after {}", before[i]);
                    before[i] = rate;
                }
            }
        }
    }

    #[test]
    fn durations() {
        let to = FROM.map(|angle| angle + 0.5);
        assert_eq!(Path::new(FROM, to, Haste::Duration(4.0), 0).end(), 4000);
        assert_eq!(Path::new(FROM, to, Haste::Duration(0.01), 0).end(), 769);
        assert_eq!(Path::new(FROM, FROM, Haste::Modest, 7).end(), 7);
        assert_eq!(Path::new(FROM, FROM, Haste::Modest, 7).at(7), FROM);
    }

    /// A joint speed near zero asks for a time beyond the clock's range, which once overflowed.
    #[test]
    fn a_path_of_nearly_no_speed_never_ends() {
        let path = Path::new(FROM, FROM.map(|angle| angle + 0.5), Haste::Speed(1e-30), 500);
        assert_eq!(path.end(), u64::MAX);
        assert!(path.at(500_000).iter().zip(FROM).all(|(angle, from)| (angle - from).abs() < 1e-12));
    }
}
