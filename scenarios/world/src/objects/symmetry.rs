//! Rotational symmetries of objects, and the difference of two orientations modulo a symmetry.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Rotational symmetry: the rotations that leave an object looking the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Symmetry {
    /// Every rotation: a ball.
    Full,
    /// Every rotation about z.
    Axis {
        /// True if the object can also be turned end over end, as a cylinder can.
        flip: bool,
    },
    /// Rotations about z by multiples of a full turn divided by `n`.
    Fold {
        /// Order of the symmetry, at least 1.
        n: u32,
        /// True if half turns about x are symmetries as well, as for a box.
        flip: bool,
    },
    /// The 24 rotations of a cube.
    Cube,
    /// No rotation.
    #[default]
    None,
}

impl Symmetry {
    /// Returns the smallest angle between the orientations `a` and `b` (`world_from_object`) modulo the symmetry, rad.
    pub fn angle(&self, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Full => 0.0,
            Self::Axis { flip } => {
                let angle = (a * Vector3::z()).angle(&(b * Vector3::z()));
                if *flip { angle.min(PI - angle) } else { angle }
            }
            Self::Fold { .. } | Self::Cube | Self::None => {
                self.rotations().iter().map(|turn| a.angle_to(&(b * turn))).fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// Returns the orientation nearest to `to` among those equivalent to `of` under the symmetry.
    pub fn nearest(&self, of: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        match self {
            Self::Full => *to,
            Self::Axis { flip } => {
                let (own, wanted) = (of * Vector3::z(), to * Vector3::z());
                let own = if *flip && own.dot(&wanted) < 0.0 { -own } else { own };
                UnitQuaternion::rotation_between(&wanted, &own).map_or(*of, |turn| turn * to)
            }
            Self::Fold { .. } | Self::Cube | Self::None => {
                let all = self.rotations().into_iter().map(|turn| of * turn);
                all.min_by(|a, b| a.angle_to(to).total_cmp(&b.angle_to(to))).unwrap_or(*of)
            }
        }
    }

    /// Returns the rotations of a discrete symmetry, the identity first; only the identity for a continuous one.
    pub fn rotations(&self) -> Vec<UnitQuaternion<f64>> {
        let about = |axis: &Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let folds = |n: u32| (0..n.max(1)).map(move |k| about(&z, TAU * f64::from(k) / f64::from(n.max(1))));
        match *self {
            Self::Full | Self::Axis { .. } | Self::None => vec![UnitQuaternion::identity()],
            Self::Fold { n, flip: false } => folds(n).collect(),
            Self::Fold { n, flip: true } => folds(n).flat_map(|turn| [turn, turn * about(&x, PI)]).collect(),
            Self::Cube => {
                let tops = [
                    UnitQuaternion::identity(),
                    about(&x, PI),
                    about(&x, FRAC_PI_2),
                    about(&x, -FRAC_PI_2),
                    about(&y, FRAC_PI_2),
                    about(&y, -FRAC_PI_2),
                ];
                tops.into_iter().flat_map(|top| folds(4).map(move |turn| top * turn)).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The nearest orientation is at the angle that [`Symmetry::angle`] gives, and is equivalent to the original.
    #[test]
    fn the_nearest_orientation_is_at_the_smallest_angle() {
        let (one, other) =
            (UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0), UnitQuaternion::from_euler_angles(-2.0, 0.4, -0.7));
        let fold = Symmetry::Fold { n: 4, flip: true };
        for symmetry in [
            Symmetry::Full,
            Symmetry::Axis { flip: true },
            Symmetry::Axis { flip: false },
            fold,
            Symmetry::Cube,
            Symmetry::None,
        ] {
            let nearest = symmetry.nearest(&one, &other);
            assert!((nearest.angle_to(&other) - symmetry.angle(&one, &other)).abs() < 1e-7, "{symmetry:?}");
            assert!(symmetry.angle(&nearest, &one) < 1e-7, "{symmetry:?}");
        }
    }

    #[test]
    fn symmetric_turns_cost_nothing() {
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0);
        let about = |axis: Unit<Vector3<f64>>, angle: f64| turn * UnitQuaternion::from_axis_angle(&axis, angle);
        let quarter = about(Vector3::y_axis(), FRAC_PI_2);
        assert!(Symmetry::Cube.angle(&turn, &quarter) < 1e-7);
        assert_eq!(Symmetry::Cube.rotations().len(), 24);
        assert!((Symmetry::Fold { n: 4, flip: true }.angle(&turn, &quarter) - FRAC_PI_2).abs() < 1e-7);
        assert!(Symmetry::Axis { flip: true }.angle(&turn, &about(Vector3::x_axis(), PI)) < 1e-7);
        assert!((Symmetry::Axis { flip: false }.angle(&turn, &about(Vector3::x_axis(), PI)) - PI).abs() < 1e-7);
        assert!(Symmetry::Fold { n: 8, flip: false }.angle(&turn, &about(Vector3::z_axis(), TAU / 8.0)) < 1e-7);
        assert!((Symmetry::None.angle(&turn, &about(Vector3::z_axis(), 0.4)) - 0.4).abs() < 1e-9);
    }
}
