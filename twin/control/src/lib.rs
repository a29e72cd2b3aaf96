//! What moves the robot: arm servoing, Cartesian paths, and the geometric check of a planned motion.
//!
//! [`executive`] runs a trial tick by tick; [`perception`] says what touch makes of its images, [`strategy`] which grasp takes the
//! next object, [`sensing`] what an ablation leaves of touch, [`recovery`] what to do when a grasp has failed, [`stand_in`] how to
//! take what fell over, [`slip`] how hard to hold what slips;
//! [`inverse_kinematics`] turns palm poses into joint set-points that never jump and never leave the arm's limits;
//! [`trajectory`] makes palm paths that hold Cartesian speed and acceleration limits; [`collision`] says how close the
//! hand and what it holds come to what stands around them along such a path, [`arm_clearance`] how near the arm comes to itself.

pub mod arm_clearance;
pub mod carrier;
pub mod collision;
pub mod executive;
pub mod inverse_kinematics;
pub mod load;
pub mod perception;
pub mod recovery;
pub mod sensing;
pub mod slip;
pub mod stand_in;
pub mod strategy;
pub mod trajectory;

/// A twist: linear velocity (m/s) of the moving frame's origin, then angular velocity (rad/s), both in world axes.
pub type Twist = nalgebra::Vector6<f64>;
