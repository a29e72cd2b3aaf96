//! Published figures of a Gen3 with seven joints, from the base on.
//!
//! Source: the maker's description of the arm (Kinovarobotics/ros2_kortex, `kortex_description/arms/gen3/7dof`).

use std::f64::consts::{FRAC_PI_2, PI};

use crate::joints::JOINTS;

/// Joint angles of the stored action "Home", rad.
pub const HOME: [f64; JOINTS] = [0.0, 0.26179939, PI, -2.26892803, 0.0, 0.95993109, FRAC_PI_2];

/// Lower limits of the joint angles, rad. Joints 1, 3, 5 and 7 have none.
pub const LOWER: [f64; JOINTS] =
    [f64::NEG_INFINITY, -2.24, f64::NEG_INFINITY, -2.57, f64::NEG_INFINITY, -2.09, f64::NEG_INFINITY];

/// Upper limits of the joint angles, rad. Joints 1, 3, 5 and 7 have none.
pub const UPPER: [f64; JOINTS] = [f64::INFINITY, 2.24, f64::INFINITY, 2.57, f64::INFINITY, 2.09, f64::INFINITY];

/// Top speeds of the joints, rad/s.
pub const TOP_SPEED: [f64; JOINTS] = [1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218];
