//! The controller: moves the robot, interprets what it feels and decides what comes next.
//!
//! - **Motion.** [`trajectory`] makes palm paths within Cartesian limits. [`inverse_kinematics`] turns palm poses into
//!   joint set-points within the limits of the arm. [`motion`] follows one path after another and drives cables and
//!   cameras. On top of it, [`executor`] carries out a queue of skills for any number of objects. [`action`] carries
//!   out the commands of a policy that acts step by step, with tactile images of one size from [`pad_images`].
//!   [`outage`] defines how long the controller holds when the robot fails. [`guarded`] stops a motion when a pad
//!   feels a contact, [`slip`] reacts to slip while carrying, and `image_requests` takes the images of a recording, on
//!   which no decision depends.
//! - **Perception.** A [`tactile_snapshot`] is the input of perception. [`perception`] estimates which objects are in
//!   the hand and their poses, [`closure`] adds the evidence of the cables, and [`sensing`] restricts the senses for an
//!   ablation. [`detection`] is the report of an object on the table, and [`palpation`] touches an object to locate it.
//!   [`registration`] finds the pose of the arm's base from known points that were touched.
//! - **Decision.** [`collision`] and [`arm_clearance`] measure distances along a planned motion. [`outcome_model`]
//!   predicts the outcome of an aim from rollouts under errors and after holds of some [`extent`], given the expected
//!   [`uncertainty`]. [`look_ahead`] adds rollouts from the estimated state of the scene. From these, [`strategy`]
//!   chooses a grasp and its aim. [`recovery`] decides what follows a failed grasp, [`fallback_grasp`] finds grasps for
//!   objects that fell over, and [`score`] holds the factors by which grasps are ranked. [`policy`] combines all of
//!   this.
//!
//! [`workcell`] is the controller's model of the robot. This crate depends on neither the simulator nor the bridge and
//! has no access to ground truth.

pub mod action;
pub mod arm_clearance;
pub mod closure;
pub mod collision;
pub mod detection;
pub mod executor;
pub mod extent;
pub mod fallback_grasp;
pub mod guarded;
mod image_requests;
pub mod inverse_kinematics;
pub mod look_ahead;
pub mod motion;
pub mod outage;
pub mod outcome_model;
pub mod pad_images;
pub mod palpation;
pub mod perception;
pub mod policy;
pub mod recovery;
pub mod registration;
pub mod score;
pub mod sensing;
pub mod slip;
pub mod strategy;
pub mod tactile_snapshot;
pub mod trajectory;
pub mod uncertainty;
pub mod workcell;

/// A twist: linear velocity (m/s) of the moving frame's origin, then angular velocity (rad/s), both in world axes.
pub type Twist = nalgebra::Vector6<f64>;
