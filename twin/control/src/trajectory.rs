//! Cartesian palm paths: straight lines and constant-axis turns between waypoints, with minimum-jerk time scaling.
//!
//! The motion rests at every waypoint, so that a path is smooth (continuous acceleration) whatever its corners.

use nalgebra::{Isometry3, Translation3, Vector3};
use thiserror::Error;

use crate::Twist;

/// Ratio of peak speed to mean speed of the minimum-jerk profile.
const PEAK_SPEED_RATIO: f64 = 1.875;
/// Peak acceleration of the minimum-jerk profile relative to length / duration^2 (10 / sqrt 3).
const PEAK_ACCELERATION_RATIO: f64 = 5.773_502_691_896_258;
/// Shortest duration of a segment that moves at all, s.
const MIN_SEGMENT_DURATION: f64 = 1e-3;

/// Invalid path or limits.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PathError {
    /// A path needs at least its start.
    #[error("a path needs at least one waypoint")]
    Empty,
    /// A duration is negative or not finite, or a pose is not finite.
    #[error("waypoint {index}: duration {duration} s and pose must be finite, duration not negative")]
    Waypoint {
        /// Index of the waypoint.
        index: usize,
        /// Its duration, s.
        duration: f64,
    },
    /// Two different poses have no time between them.
    #[error("waypoint {index}: no time is given to reach it from a different pose")]
    NoTime {
        /// Index of the waypoint.
        index: usize,
    },
    /// A limit is not a positive number.
    #[error("path limits must be positive and finite")]
    Limits,
}

/// Cartesian limits of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLimits {
    /// Largest speed, m/s.
    pub speed: f64,
    /// Largest angular speed, rad/s.
    pub turn_speed: f64,
    /// Largest acceleration, m/s2.
    pub acceleration: f64,
    /// Largest angular acceleration, rad/s2.
    pub turn_acceleration: f64,
}

impl Default for PathLimits {
    /// The published twist speeds of the Gen3. Its joints reach them only in favourable motions (not in a sideways
    /// motion with a turn, for example). `ArmServo::roll_out` predicts the tracking of a path, and
    /// [`PathLimits::scaled`] slows it down.
    fn default() -> Self {
        Self { speed: 0.5, turn_speed: 1.74, acceleration: 1.5, turn_acceleration: 4.0 }
    }
}

impl PathLimits {
    /// Scales speeds by `factor` and accelerations by its square: the same path takes `1 / factor` times as long.
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            speed: self.speed * factor,
            turn_speed: self.turn_speed * factor,
            acceleration: self.acceleration * factor * factor,
            turn_acceleration: self.turn_acceleration * factor * factor,
        }
    }

    fn is_valid(self) -> bool {
        [self.speed, self.turn_speed, self.acceleration, self.turn_acceleration]
            .iter()
            .all(|limit| limit.is_finite() && *limit > 0.0)
    }

    /// Shortest minimum-jerk duration (s) of a motion of `length` (m) and `angle` (rad).
    pub fn duration(self, length: f64, angle: f64) -> f64 {
        if length == 0.0 && angle == 0.0 {
            return 0.0;
        }
        [
            PEAK_SPEED_RATIO * length / self.speed,
            PEAK_SPEED_RATIO * angle / self.turn_speed,
            (PEAK_ACCELERATION_RATIO * length / self.acceleration).sqrt(),
            (PEAK_ACCELERATION_RATIO * angle / self.turn_acceleration).sqrt(),
            MIN_SEGMENT_DURATION,
        ]
        .into_iter()
        .fold(0.0, f64::max)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    /// Start time and duration, s.
    start: f64,
    duration: f64,
    from: Isometry3<f64>,
    to: Isometry3<f64>,
    /// Displacement, m.
    shift: Vector3<f64>,
    /// Rotation vector in world axes, rad.
    turn: Vector3<f64>,
}

/// Upper bounds of the speeds over an interval of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedBound {
    /// Linear speed of the moving frame's origin, m/s.
    pub linear: f64,
    /// Angular speed, rad/s.
    pub angular: f64,
    /// Path time up to which the bound holds, s.
    pub until: f64,
}

/// A timed path of a frame (usually `world_from_palm`); see the module documentation.
#[derive(Debug, Clone, PartialEq)]
pub struct PosePath {
    start: Isometry3<f64>,
    segments: Vec<Segment>,
}

impl PosePath {
    /// A path through `waypoints`, each with the time (s) to reach it from the one before. The first is the start, and
    /// its time is a rest there. Equal neighbours with time between them are a rest.
    pub fn new(waypoints: Vec<(f64, Isometry3<f64>)>) -> Result<Self, PathError> {
        let (_, start) = *waypoints.first().ok_or(PathError::Empty)?;
        let mut segments = Vec::with_capacity(waypoints.len());
        let (mut time, mut from) = (0.0, start);
        for (index, &(duration, to)) in waypoints.iter().enumerate() {
            if !(duration.is_finite() && duration >= 0.0 && to.to_homogeneous().iter().all(|v| v.is_finite())) {
                return Err(PathError::Waypoint { index, duration });
            }
            let (shift, turn) = displacement(&from, &to);
            if duration == 0.0 {
                if shift.norm() > 1e-12 || turn.norm() > 1e-12 {
                    return Err(PathError::NoTime { index });
                }
                continue;
            }
            segments.push(Segment { start: time, duration, from, to, shift, turn });
            time += duration;
            from = to;
        }
        Ok(Self { start, segments })
    }

    /// The fastest path through `waypoints` (the first is the start) within `limits`.
    pub fn fastest(waypoints: &[Isometry3<f64>], limits: PathLimits) -> Result<Self, PathError> {
        Self::new(slow_to_limits(waypoints.iter().map(|pose| (0.0, *pose)).collect(), limits)?)
    }

    /// Stretches every segment as far as `limits` require. Rests stay as they are.
    pub fn slowed_to_limits(&self, limits: PathLimits) -> Result<Self, PathError> {
        let waypoints: Vec<_> =
            std::iter::once((0.0, self.start)).chain(self.segments.iter().map(|s| (s.duration, s.to))).collect();
        Self::new(slow_to_limits(waypoints, limits)?)
    }

    /// Total time, s.
    pub fn duration(&self) -> f64 {
        self.segments.last().map_or(0.0, |segment| segment.start + segment.duration)
    }

    /// Pose at time 0.
    pub fn start(&self) -> Isometry3<f64> {
        self.start
    }

    pub fn end(&self) -> Isometry3<f64> {
        self.segments.last().map_or(self.start, |segment| segment.to)
    }

    /// Pose and twist at time `t` (s). The path rests before its start and after its end.
    pub fn sample(&self, t: f64) -> (Isometry3<f64>, Twist) {
        let Some(segment) = self.segment(t) else {
            return (if t <= 0.0 { self.start } else { self.end() }, Twist::zeros());
        };
        let tau = (t - segment.start) / segment.duration;
        let s = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
        let rate = 30.0 * tau * tau * (1.0 - tau) * (1.0 - tau) / segment.duration;
        let pose = Isometry3::from_parts(
            Translation3::from(segment.from.translation.vector + segment.shift * s),
            nalgebra::UnitQuaternion::from_scaled_axis(segment.turn * s) * segment.from.rotation,
        );
        let (v, w) = (segment.shift * rate, segment.turn * rate);
        (pose, Twist::new(v.x, v.y, v.z, w.x, w.y, w.z))
    }

    /// Upper bounds of the speeds from time `t` to the end of the segment that contains `t`.
    pub fn speed_bound(&self, t: f64) -> SpeedBound {
        self.segment(t.max(0.0)).map_or(SpeedBound { linear: 0.0, angular: 0.0, until: f64::INFINITY }, |segment| {
            SpeedBound {
                linear: PEAK_SPEED_RATIO * segment.shift.norm() / segment.duration,
                angular: PEAK_SPEED_RATIO * segment.turn.norm() / segment.duration,
                until: segment.start + segment.duration,
            }
        })
    }

    /// Transforms the path to another frame: every pose becomes `left * pose * right`.
    pub fn transformed(&self, left: &Isometry3<f64>, right: &Isometry3<f64>) -> Result<Self, PathError> {
        let waypoints = std::iter::once((0.0, left * self.start * right))
            .chain(self.segments.iter().map(|s| (s.duration, left * s.to * right)));
        Self::new(waypoints.collect())
    }

    /// Segment that contains `t`; `None` if `t` is outside the path.
    fn segment(&self, t: f64) -> Option<&Segment> {
        if !(t >= 0.0 && t < self.duration()) {
            return None;
        }
        let after = self.segments.partition_point(|segment| segment.start <= t);
        self.segments.get(after.checked_sub(1)?)
    }
}

/// Twist of a point that is rigidly attached to a moving frame. `offset` (m, world axes) leads from the frame's origin
/// to the point.
pub fn shift_twist(twist: &Twist, offset: &Vector3<f64>) -> Twist {
    let w = Vector3::new(twist[3], twist[4], twist[5]);
    let v = Vector3::new(twist[0], twist[1], twist[2]) + w.cross(offset);
    Twist::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

/// Displacement (m) and rotation vector (rad, world axes, at most pi long) from one pose to another.
pub fn displacement(from: &Isometry3<f64>, to: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let mut turn = to.rotation * from.rotation.inverse();
    if turn.w < 0.0 {
        turn = nalgebra::UnitQuaternion::new_unchecked(-turn.into_inner());
    }
    (to.translation.vector - from.translation.vector, turn.scaled_axis())
}

/// Raises the durations of waypoints as far as `limits` require.
fn slow_to_limits(
    mut waypoints: Vec<(f64, Isometry3<f64>)>,
    limits: PathLimits,
) -> Result<Vec<(f64, Isometry3<f64>)>, PathError> {
    if !limits.is_valid() {
        return Err(PathError::Limits);
    }
    for i in 1..waypoints.len() {
        let (shift, turn) = displacement(&waypoints[i - 1].1, &waypoints[i].1);
        waypoints[i].0 = waypoints[i].0.max(limits.duration(shift.norm(), turn.norm()));
    }
    Ok(waypoints)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    fn pose(v: &[f64]) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5]))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Speed and acceleration limits hold everywhere, twists are the derivative of poses, and all waypoints are
        /// met.
        #[test]
        fn limits_hold(raw in proptest::collection::vec(-1.0f64..1.0, 24)) {
            let limits = PathLimits::default();
            let waypoints: Vec<_> = raw.chunks(6).map(|c| pose(&[c[0], c[1], c[2], 3.0 * c[3], 3.0 * c[4], 3.0 * c[5]])).collect();
            let path = PosePath::fastest(&waypoints, limits).expect("valid");
            let h = 1e-4;
            let mut t = h;
            while t < path.duration() {
                let (at, twist) = path.sample(t);
                let (next, twist_next) = path.sample(t + h);
                prop_assert!(twist.fixed_rows::<3>(0).norm() <= limits.speed * (1.0 + 1e-9));
                prop_assert!(twist.fixed_rows::<3>(3).norm() <= limits.turn_speed * (1.0 + 1e-9));
                let change = (twist_next - twist) / h;
                prop_assert!(change.fixed_rows::<3>(0).norm() <= limits.acceleration * 1.001);
                prop_assert!(change.fixed_rows::<3>(3).norm() <= limits.turn_acceleration * 1.001);
                let (v, w) = displacement(&at, &next);
                prop_assert!((v / h - (twist + twist_next).fixed_rows::<3>(0) / 2.0).norm() < 1e-5);
                prop_assert!((w / h - (twist + twist_next).fixed_rows::<3>(3) / 2.0).norm() < 1e-5);
                let bound = path.speed_bound(t);
                prop_assert!(twist.fixed_rows::<3>(0).norm() <= bound.linear + 1e-9 && bound.until > t);
                t += 0.0137;
            }
            for waypoint in &path.segments {
                let (v, w) = displacement(&path.sample(waypoint.start).0, &waypoint.from);
                prop_assert!(v.norm() < 1e-9 && w.norm() < 1e-7);
            }
            let (v, w) = displacement(&path.end(), &waypoints[3]);
            prop_assert!(v.norm() < 1e-12 && w.norm() < 1e-12);
        }
    }

    #[test]
    fn rests_stretches_and_errors() {
        let (a, b) = (Isometry3::identity(), Isometry3::translation(0.3, 0.0, 0.0));
        let path = PosePath::new(vec![(0.5, a), (0.1, b), (1.0, b)]).expect("valid");
        assert_eq!(path.duration(), 1.6);
        assert_eq!(path.sample(0.4), (a, Twist::zeros()));
        assert_eq!(path.sample(9.0), (b, Twist::zeros()));
        let slow = path.slowed_to_limits(PathLimits::default()).expect("valid");
        assert!((slow.duration() - (1.5 + 1.875 * 0.3 / 0.5)).abs() < 1e-12, "{}", slow.duration());
        assert_eq!(PosePath::new(vec![]), Err(PathError::Empty));
        assert_eq!(PosePath::new(vec![(0.0, a), (0.0, b)]), Err(PathError::NoTime { index: 1 }));
        let zero = PathLimits { speed: 0.0, ..PathLimits::default() };
        assert_eq!(PosePath::fastest(&[a, b], zero), Err(PathError::Limits));
    }

    #[test]
    fn transformed_keeps_time_and_twist_shifts() {
        let turn =
            Isometry3::from_parts(Translation3::new(0.2, 0.1, 0.3), UnitQuaternion::from_euler_angles(0.3, 1.0, 0.2));
        let path = PosePath::fastest(&[Isometry3::identity(), turn], PathLimits::default()).expect("valid");
        let offset = Vector3::new(0.1, 0.0, 0.02);
        let t = path.duration() * 0.4;
        let (pose, twist) = path.sample(t);
        let (p, q) = (
            path.sample(t - 1e-5).0 * nalgebra::Point3::from(offset),
            path.sample(t + 1e-5).0 * nalgebra::Point3::from(offset),
        );
        let shifted = shift_twist(&twist, &(pose.rotation * offset));
        assert!(((q - p) / 2e-5 - shifted.fixed_rows::<3>(0)).norm() < 1e-6);
        let left = Isometry3::translation(0.0, 0.0, -0.1);
        assert_eq!(path.transformed(&left, &Isometry3::identity()).expect("valid").duration(), path.duration());
    }
}
