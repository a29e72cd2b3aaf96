//! One object: shape, mass, friction, and how it rests on a table.

use std::f64::consts::{PI, TAU};

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::symmetry::Symmetry;
use crate::geometry::{GeometryError, Shape};

/// Tilt from which an object no longer stands as at rest, rad.
const LEANING: f64 = 0.15;
/// Directions in which an object is tipped to see whether it falls over.
const DIRECTIONS: u32 = 16;
/// How far the centre of something round may come down when it is tipped, over its size: facets of a mesh are not round.
const FACET: f64 = 4e-3;
/// Height of a unit axis's end from which the axis counts as vertical.
const UPRIGHT: f64 = 0.99;

#[derive(Debug, Clone)]
pub struct ObjectModel {
    /// Unique, such as `golf_ball`.
    pub name: String,
    /// In the frame `object/<name>`, origin at the centre of mass.
    pub shape: Shape,
    /// kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand's elastomer.
    pub friction: f64,
    /// RGB.
    pub color: [u8; 3],
    /// `table_from_object`: how it stands or lies on the table at yaw 0.
    pub rest: UnitQuaternion<f64>,
    /// Turns that leave it looking the same.
    pub symmetry: Symmetry,
}

impl ObjectModel {
    /// The same thing of the same stuff, `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        Ok(Self { shape: self.shape.scaled(factor)?, mass: self.mass * factor.powi(3), ..self.clone() })
    }

    /// Whether the object, oriented as `world_from_object`, looks the same from all sides: a ball, or what stands on its axis.
    pub fn round_about_vertical(&self, rotation: &UnitQuaternion<f64>) -> bool {
        match self.symmetry {
            Symmetry::Full => true,
            Symmetry::Axis { .. } => (rotation * Vector3::z()).z.abs() > UPRIGHT,
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => false,
        }
    }

    /// The turn about the vertical by which the object, oriented as `world_from_object`, differs from its rest pose, rad; of
    /// turns that leave it looking the same the smallest. `None` if it lies otherwise than at rest.
    pub fn standing_yaw(&self, rotation: &UnitQuaternion<f64>) -> Option<f64> {
        self.standing_yaws(rotation).into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// All those turns; none if it lies otherwise than at rest.
    pub fn standing_yaws(&self, rotation: &UnitQuaternion<f64>) -> Vec<f64> {
        let candidate = |turn: &UnitQuaternion<f64>| match self.symmetry {
            Symmetry::Full => (0.0, 0.0),
            Symmetry::Axis { .. } => {
                let (now, rest) = (rotation * turn * Vector3::z(), self.rest * Vector3::z());
                let azimuth = |axis: &Vector3<f64>| if axis.z.abs() > UPRIGHT { 0.0 } else { axis.y.atan2(axis.x) };
                let yaw = azimuth(&now) - azimuth(&rest);
                ((now.z.acos() - rest.z.acos()).abs(), yaw - TAU * (yaw / TAU).round())
            }
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => {
                let moved = rotation * turn * self.rest.inverse();
                let ahead = moved * Vector3::x();
                ((moved * Vector3::z()).angle(&Vector3::z()), ahead.y.atan2(ahead.x))
            }
        };
        let mut turns = self.symmetry.turns();
        if self.symmetry == (Symmetry::Axis { flip: true }) {
            turns.push(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        }
        let standing = turns.iter().map(candidate).filter(|(tilt, _)| *tilt < LEANING);
        standing.map(|(_, yaw)| yaw).collect()
    }

    /// How it rests, as an object's file has it.
    pub fn rest_text(&self) -> String {
        let (roll, pitch, yaw) = self.rest.euler_angles();
        format!("{{ turned = [{roll:.4}, {pitch:.4}, {yaw:.4}] }}")
    }

    /// Height of the frame's origin over the table when at rest, m.
    pub fn rest_height(&self) -> f64 {
        -self.shape.lowest(&self.rest)
    }

    /// Whether the object stays as it rests: tipped a little to any side, its centre does not come down. What rolls stays.
    pub fn rests_stably(&self) -> bool {
        let (height, size) = (self.rest_height(), self.shape.bounding_radius());
        (0..DIRECTIONS).all(|k| {
            let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
            let axis = Unit::new_normalize(Vector3::new(angle.cos(), angle.sin(), 0.0));
            let tipped = UnitQuaternion::from_axis_angle(&axis, LEANING) * self.rest;
            -self.shape.lowest(&tipped) - height > -FACET * size
        })
    }
}
