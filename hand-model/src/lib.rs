//! The robot model: the F-TAC Hand's kinematic tree, cable transmission and tactile pads, the Kinova Gen3 arm, and the
//! [`robot::RobotBackend`] interface through which every controller drives every body.
//!
//! The modules in reading order: [`robot_model`] reads a robot file, which names a hand and an arm. [`parameters`]
//! reads the file with all numbers of the hand (`data/ftac_hand.toml`), and [`hand`] turns it into a
//! [`kinematics::Tree`] with covers, [`pads`] and a [`transmission`]. [`arm`] does the same for the Gen3. [`urdf_name`]
//! writes both as URDF and reads any URDF back. [`hand_mechanism`] is the view of a hand that physics and grasp
//! synthesis use; it is built from a parameter file, or by [`urdf_hand`] from a URDF. [`statics`] computes the postures
//! at which the digits come to rest, and [`gravity`] the static loads on the arm's joints. [`robot`] defines what a body
//! measures and which commands it takes.
//!
//! # Frames
//! Right-handed, SI. `palm_description`: y towards the fingertips, x towards the thumb side, -z out of the palm. Link frames: x along the
//! phalanx to the tip, y out of its palmar side, z the joint axis; a positive angle flexes. `pad/<name>`: origin in the
//! centre of the sensing surface, y along the digit, z out of the surface. A pose `a_from_b` maps coordinates in b to a.

pub mod arm;
pub mod digit;
pub mod gravity;
pub mod hand;
pub mod hand_mechanism;
pub mod kinematics;
pub mod pads;
pub mod parameters;
pub mod robot;
pub mod robot_model;
pub mod statics;
pub mod transmission;
pub mod urdf;
pub mod urdf_hand;

pub use arm::{Arm, ArmVector};
pub use digit::{Digit, Phalanx};
pub use hand::{ActuatorVector, DigitVector, Hand, HandVector};
pub use robot_model::{RobotModel, RobotSources};

/// Gravity, m/s2.
pub const GRAVITY: f64 = 9.81;
