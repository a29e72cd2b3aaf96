//! Layout: places of the objects of a trial, one to [`MAX_OBJECTS`].
//!
//! The centre of the first object is at `layout.first`, the second's at `layout.second`, the third's at `layout.third`
//! (world x, y; m). Each object is rotated from its resting pose by `yaw` about the vertical, and its lowest point
//! touches the table. Plans are made for these places. In a trial, each object is shifted by a uniform draw within
//! `spread_xy` and `spread_yaw`, the same draw under every noisy condition. Everything must stay within `reach_x` and
//! `reach_y`, and the objects must stand clear of each other.

use std::path::Path;

use ftac_platform::data::DataError;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::objects::ObjectModel;

/// Greatest number of objects in a trial.
pub const MAX_OBJECTS: usize = 3;

/// Nominal place of an object on the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TablePlacement {
    /// x in the world frame, m.
    pub x: f64,
    /// y in the world frame, m.
    pub y: f64,
    /// Yaw about the vertical, rad.
    pub yaw: f64,
}

impl TablePlacement {
    /// Returns the place moved by `shift`.
    #[must_use]
    pub fn shifted(&self, shift: &PlacementShift) -> Self {
        Self { x: self.x + shift.x, y: self.y + shift.y, yaw: self.yaw + shift.yaw }
    }

    /// Returns the pose `world_from_object` of an object that rests here.
    pub fn pose(&self, object: &ObjectModel) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x, self.y, object.rest_height()),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw) * object.rest,
        )
    }
}

/// Shift of an object from its place in the layout.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PlacementShift {
    /// Along x of the world frame, m.
    pub x: f64,
    /// Along y of the world frame, m.
    pub y: f64,
    /// Yaw about the vertical, rad.
    pub yaw: f64,
}

/// Places of all objects and the limits of their shifts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// Place of the first object.
    pub first: TablePlacement,
    /// Place of the second object; ignored in a trial of one.
    pub second: TablePlacement,
    /// Place of the third object; none if no trial has three.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub third: Option<TablePlacement>,
    /// Greatest shift along x and along y, m.
    pub spread_xy: f64,
    /// Greatest yaw shift, rad.
    pub spread_yaw: f64,
    /// Lowest and highest x within reach, m.
    pub reach_x: [f64; 2],
    /// Lowest and highest y within reach, m.
    pub reach_y: [f64; 2],
}

impl Layout {
    /// Returns all places, in the order in which their objects are picked.
    pub fn places(&self) -> Vec<TablePlacement> {
        [self.first, self.second].into_iter().chain(self.third).collect()
    }

    /// Returns the least possible distance between the centres of objects in two of the places, given the shifts, m.
    pub fn min_distance(&self, one: &TablePlacement, other: &TablePlacement) -> f64 {
        (one.x - other.x).hypot(one.y - other.y) - 2.0 * std::f64::consts::SQRT_2 * self.spread_xy
    }

    /// Checks that every place, including its shifts, is within reach; `path` is named in errors.
    pub fn check(&self, path: &Path) -> Result<(), DataError> {
        for (which, place) in ["first", "second", "third"].into_iter().zip(self.places()) {
            for (axis, value, [low, high]) in [("x", place.x, self.reach_x), ("y", place.y, self.reach_y)] {
                if !(value - self.spread_xy >= low && value + self.spread_xy <= high) {
                    let expected = format!("within reach, {low} to {high} m, with shifts of {} m", self.spread_xy);
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
