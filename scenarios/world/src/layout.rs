//! Places of the objects of a trial: one to [`MOST_OBJECTS`].
//!
//! The first object's centre stands at `layout.first`, the second's at `layout.second`, the third's at `layout.third` (world x, y; m). Each is
//! turned from its rest pose by `yaw` about the vertical and touches the table with its lowest point. Plans are made for these places. In a trial
//! each object stands elsewhere by an even draw within `spread_xy` and `spread_yaw`, the same one under every noisy condition.
//! Everything must stay within `reach_x` and `reach_y`, and the objects must stand clear of each other.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use platform::data::DataError;
use serde::{Deserialize, Serialize};

use crate::objects::ObjectModel;

/// Most objects of a trial.
pub const MOST_OBJECTS: usize = 3;

/// Where an object stands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// m, world.
    pub x: f64,
    /// m, world.
    pub y: f64,
    /// rad, about the vertical.
    pub yaw: f64,
}

impl Place {
    /// The place `shift` away.
    #[must_use]
    pub fn shifted(&self, shift: &Shift) -> Self {
        Self { x: self.x + shift.x, y: self.y + shift.y, yaw: self.yaw + shift.yaw }
    }

    /// `world_from_object` of an object that rests here.
    pub fn pose(&self, object: &ObjectModel) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x, self.y, object.rest_height()),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw) * object.rest,
        )
    }
}

/// How far an object stands from its place in the layout.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Shift {
    /// m, world.
    pub x: f64,
    /// m, world.
    pub y: f64,
    /// rad, about the vertical.
    pub yaw: f64,
}

/// Where they stand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// The first object.
    pub first: Place,
    /// The second object; without a say in a trial of one.
    pub second: Place,
    /// The third object; none where no trial has three.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub third: Option<Place>,
    /// Largest shift along x and y, m.
    pub spread_xy: f64,
    /// Largest turn, rad.
    pub spread_yaw: f64,
    /// Lowest and highest x, m.
    pub reach_x: [f64; 2],
    /// Lowest and highest y, m.
    pub reach_y: [f64; 2],
}

impl Layout {
    /// All places, in the order in which their objects are taken.
    pub fn places(&self) -> Vec<Place> {
        [self.first, self.second].into_iter().chain(self.third).collect()
    }

    /// Least distance of the centres of objects in two of the places, m.
    pub fn least_distance(&self, one: &Place, other: &Place) -> f64 {
        (one.x - other.x).hypot(one.y - other.y) - 2.0 * std::f64::consts::SQRT_2 * self.spread_xy
    }

    /// Whether every place, with the spread, is within reach; `path` is used in errors.
    pub fn check(&self, path: &Path) -> Result<(), DataError> {
        for (which, place) in ["first", "second", "third"].into_iter().zip(self.places()) {
            for (axis, value, [low, high]) in [("x", place.x, self.reach_x), ("y", place.y, self.reach_y)] {
                if !(value - self.spread_xy >= low && value + self.spread_xy <= high) {
                    let expected = format!("within reach, {low} to {high} m, with the spread of {} m", self.spread_xy);
                    return Err(DataError::field(path, format!("layout.{which}.{axis}"), value, expected));
                }
            }
            if !place.yaw.is_finite() {
                return Err(DataError::field(path, format!("layout.{which}.yaw"), place.yaw, "a finite angle in rad"));
            }
        }
        Ok(())
    }
}
