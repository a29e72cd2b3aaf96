//! The controller: moves the robot, interprets what it feels and decides what comes next.
//!
//! - **Motion.** [`trajectory`] makes palm paths within Cartesian limits. [`inverse_kinematics`] turns palm poses into
//!   joint set-points within the limits of the arm. [`motion`] follows one path after another and drives cables and
//!   cameras. On top of it, [`executor`] carries out a queue of skills for any number of objects. [`action`] carries
//!   out the commands of a policy that acts step by step, with tactile images of one size from [`pad_images`].
//!   [`outage`] defines how long the controller holds when the robot fails. [`guarded`] stops a motion when a pad feels
//!   a contact, [`slip`] reacts to slip while carrying, and `watch` takes the images of a recording, on which no
//!   decision depends.
//! - **Perception.** A [`look`] is the input of perception. [`perception`] estimates which objects are in the hand and
//!   their poses, [`closure`] adds the evidence of the cables, and [`sensing`] restricts the senses for an ablation.
//!   [`percept`] is the report of an object on the table, and [`palpation`] touches an object to locate it.
//!   [`registration`] finds the pose of the arm's base from known points that were touched.
//! - **Decision.** [`collision`] and [`arm_clearance`] measure distances along a planned motion. [`odds`] predicts the
//!   outcome of an aim from rehearsals under errors and after holds of some [`extent`], given the expected
//!   [`uncertainty`]. [`foresight`] adds rollouts in a twin of the scene. From these, [`strategy`] chooses a grasp and
//!   its aim. [`recovery`] decides what follows a failed grasp, [`stand_in`] finds grasps for objects that fell over,
//!   and [`worth`] holds the factors by which grasps are ranked. [`policy`] puts it together.
//!
//! [`workcell`] is the robot as the controller knows it. This crate never knows the simulator, the bridge or the
//! scene's truth.

pub mod action;
pub mod arm_clearance;
pub mod closure;
pub mod collision;
pub mod executor;
pub mod extent;
pub mod foresight;
pub mod guarded;
pub mod inverse_kinematics;
pub mod look;
pub mod motion;
pub mod odds;
pub mod outage;
pub mod pad_images;
pub mod palpation;
pub mod percept;
pub mod perception;
pub mod policy;
pub mod recovery;
pub mod registration;
pub mod sensing;
pub mod slip;
pub mod stand_in;
pub mod strategy;
pub mod trajectory;
pub mod uncertainty;
mod watch;
pub mod workcell;
pub mod worth;

/// A twist: linear velocity (m/s) of the moving frame's origin, then angular velocity (rad/s), both in world axes.
pub type Twist = nalgebra::Vector6<f64>;
