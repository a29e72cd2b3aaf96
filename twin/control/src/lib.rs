//! The brain: everything that moves the robot, interprets what it feels and decides what comes next.
//!
//! - **Motion.** [`trajectory`] makes palm paths within Cartesian limits, [`inverse_kinematics`] turns palm poses into joint set-points
//!   within the arm's, [`motion`] follows one path after another with cables and cameras. [`executor`] carries out a queue of skills
//!   on it, for any number of objects; [`action`] carries out what a policy asks for step by step, with [`pad_images`] of one size; [`outage`] says how long it holds for a robot that fails. [`guarded`] stops where a pad feels something,
//!   [`slip`] answers slip while carrying; `watch` takes the images of a recording, by which nothing is decided.
//! - **Perception.** A [`look`] is all that perception takes. [`perception`] says what is in the hand and where, [`closure`] what a cable tells of that, [`sensing`] what an
//!   ablation leaves of the senses. [`percept`] is how objects on the table are reported, [`palpation`] how one is touched to find out
//!   where it is. [`registration`] finds where the arm stands from known points that were touched.
//! - **Decision.** [`collision`] and [`arm_clearance`] measure distances along a planned motion, [`odds`] says what rehearsals after holds of some [`extent`] and under
//!   errors make of an aim under the [`uncertainty`] that is expected, [`foresight`] what a twin of the scene does, [`strategy`] chooses a grasp and its aim by them. [`recovery`] says what follows a failed one, [`stand_in`]
//!   finds grasps for what fell over, and [`worth`] holds the factors by which grasps are ranked.
//!   [`policy`] puts it together.
//!
//! [`workcell`] is the robot as the controller knows it. This crate never knows the simulator, the bridge or the scene's truth.

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
