//! Model of one object: shape, mass, friction, and resting pose on a table.

use std::f64::consts::{PI, TAU};

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::symmetry::Symmetry;
use crate::geometry::{GeometryError, ObjectShape};

/// Tilt beyond which an object no longer counts as standing in its resting pose, rad.
const MAX_RESTING_TILT: f64 = 0.15;
/// Number of directions in which an object is tipped to test its stability.
const TIP_DIRECTION_COUNT: u32 = 16;
/// Greatest drop of a round object's centre on tipping that still counts as stable, relative to its size: a faceted
/// mesh is not perfectly round.
const FACET_TOLERANCE: f64 = 4e-3;
/// z component of a unit axis above which the axis counts as vertical.
const VERTICAL_COSINE: f64 = 0.99;

#[derive(Debug, Clone)]
pub struct ObjectModel {
    /// Unique name, such as `golf_ball`.
    pub name: String,
    /// Shape in the frame `object/<name>`, whose origin is the centre of mass.
    pub shape: ObjectShape,
    /// Mass, kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand's elastomer.
    pub friction: f64,
    /// Colour, RGB.
    pub color: [u8; 3],
    /// Resting orientation on the table at yaw 0, `table_from_object`.
    pub rest: UnitQuaternion<f64>,
    /// Rotational symmetry.
    pub symmetry: Symmetry,
}

impl ObjectModel {
    /// Returns the object scaled by `factor`, with the same density.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        Ok(Self { shape: self.shape.scaled(factor)?, mass: self.mass * factor.powi(3), ..self.clone() })
    }

    /// True if the object, in the orientation `world_from_object`, is rotationally symmetric about the vertical: a
    /// ball, or an object that stands on its axis.
    pub fn round_about_vertical(&self, rotation: &UnitQuaternion<f64>) -> bool {
        match self.symmetry {
            Symmetry::Full => true,
            Symmetry::Axis { .. } => (rotation * Vector3::z()).z.abs() > VERTICAL_COSINE,
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => false,
        }
    }

    /// Returns the yaw from the resting orientation to the orientation `world_from_object`, rad; the smallest one that
    /// the symmetry allows. `None` if the object is not in its resting pose.
    pub fn resting_yaw(&self, rotation: &UnitQuaternion<f64>) -> Option<f64> {
        self.resting_yaws(rotation).into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// Returns all such yaws that the symmetry allows, rad; empty if the object is not in its resting pose.
    pub fn resting_yaws(&self, rotation: &UnitQuaternion<f64>) -> Vec<f64> {
        let candidate = |turn: &UnitQuaternion<f64>| match self.symmetry {
            Symmetry::Full => (0.0, 0.0),
            Symmetry::Axis { .. } => {
                let (now, rest) = (rotation * turn * Vector3::z(), self.rest * Vector3::z());
                let azimuth =
                    |axis: &Vector3<f64>| if axis.z.abs() > VERTICAL_COSINE { 0.0 } else { axis.y.atan2(axis.x) };
                let yaw = azimuth(&now) - azimuth(&rest);
                ((now.z.acos() - rest.z.acos()).abs(), yaw - TAU * (yaw / TAU).round())
            }
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => {
                let moved = rotation * turn * self.rest.inverse();
                let ahead = moved * Vector3::x();
                ((moved * Vector3::z()).angle(&Vector3::z()), ahead.y.atan2(ahead.x))
            }
        };
        let mut turns = self.symmetry.rotations();
        if self.symmetry == (Symmetry::Axis { flip: true }) {
            turns.push(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        }
        let standing = turns.iter().map(candidate).filter(|(tilt, _)| *tilt < MAX_RESTING_TILT);
        standing.map(|(_, yaw)| yaw).collect()
    }

    /// Returns the resting pose as text in the syntax of an object's file.
    pub fn rest_text(&self) -> String {
        let (roll, pitch, yaw) = self.rest.euler_angles();
        format!("{{ turned = [{roll:.4}, {pitch:.4}, {yaw:.4}] }}")
    }

    /// Returns the height of the frame's origin over the table in the resting pose, m.
    pub fn rest_height(&self) -> f64 {
        -self.shape.lowest_height(&self.rest)
    }

    /// True if the resting pose is stable: tipped slightly to any side, the centre does not drop. An object that can
    /// roll counts as stable.
    pub fn rests_stably(&self) -> bool {
        let (height, size) = (self.rest_height(), self.shape.bounding_radius());
        (0..TIP_DIRECTION_COUNT).all(|k| {
            let angle = TAU * f64::from(k) / f64::from(TIP_DIRECTION_COUNT);
            let axis = Unit::new_normalize(Vector3::new(angle.cos(), angle.sin(), 0.0));
            let tipped = UnitQuaternion::from_axis_angle(&axis, MAX_RESTING_TILT) * self.rest;
            -self.shape.lowest_height(&tipped) - height > -FACET_TOLERANCE * size
        })
    }
}
