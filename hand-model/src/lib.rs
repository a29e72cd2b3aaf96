//! Models of robot hands and arms, and the interface between controllers and robots.
//!
//! The crate answers the questions that perception, grasp synthesis, simulation and control ask about a hand: poses of
//! links and tactile pads, moment arms, joint torques of the actuators, postures at rest, static loads on the arm. A
//! hand is data: a parameter file, or a URDF and an actuation file. The F-TAC Hand on a Kinova Gen3 is built in.
//!
//! # Example
//! ```
//! use hand_model::statics::free_equilibrium;
//! use hand_model::{Digit, RobotModel};
//!
//! // `RobotModel::read(Path::new("robot.toml"))` reads a robot of your own.
//! let robot = RobotModel::ftac_gen3();
//! let hand = &robot.hand;
//!
//! // The index finger closes under a cable tension of 4 N.
//! let mut tensions = hand.slack_tensions();
//! tensions[Digit::Index.index()] = 4.0;
//! let angles = free_equilibrium(hand, &tensions, 0.0);
//!
//! // Its fingertip pad, in the palm frame and in the base frame of the arm at home.
//! let palm_from_link = hand.tree.forward(&angles);
//! let pad = hand.find_pad("index_distal").expect("a pad of this name");
//! let palm_from_pad = hand.pad_poses(&palm_from_link)[pad];
//! let base_from_palm = robot.arm.tool_pose(&robot.arm.home) * hand.palm_from_flange.inverse();
//! println!("{:.3?} m", (base_from_palm * palm_from_pad).translation.vector.as_slice());
//! ```
//!
//! # Modules
//! Models, from the whole to its parts:
//! - [`robot_model`]: a robot file, which names an arm and a hand. [`arm`]: a serial arm. [`hand`]: a hand from its
//!   parameter file ([`parameters`]), with its [`digit`]s, its [`transmission`] and its [`pads`].
//! - [`hand_mechanism`]: the view of a hand that physics and grasp synthesis use: collision shapes, joints, actuators.
//!   It is built from a [`Hand`], or by [`urdf_hand`] from a URDF and an actuation file.
//! - [`kinematics`]: the tree of joints under all of them. [`urdf`]: writing and reading of URDF.
//!
//! Computations: [`statics`]: postures at which the digits come to rest, free or against an obstacle. [`gravity`]:
//! static loads on the arm's joints. [`bisection`]: roots of rising functions.
//!
//! Interface: [`robot`]: what a robot measures and which commands it takes ([`robot::RobotBackend`]).
//!
//! # Two views of a hand
//! | | [`Hand`] | [`hand_mechanism::HandMechanism`] |
//! |---|---|---|
//! | source | parameter file | parameter file, or URDF and actuation file |
//! | joints | at most [`MAX_HAND_JOINTS`](hand::MAX_HAND_JOINTS) | any number |
//! | actuators | one for each of at most five digits, and the thumb's opposition | any number, each pulling any joints |
//! | shapes | a rounded box for each link | any number of primitives and convex hulls |
//! | tactile pads and cameras | yes | no |
//! | drives an arm and a [`robot::RobotBackend`] | yes, as part of a [`RobotModel`] | no |
//!
//! # Frames and units
//! Right-handed; SI units throughout: m, rad, kg, N, N m, s (only [`parameters::GraspRanges`] has degrees). A pose
//! `a_from_b` maps coordinates in b to a.
//! - `palm`: y towards the fingertips, x towards the thumb side, -z out of the palm.
//! - Links of a [`Hand`]: x along the phalanx to the tip, y out of its palmar side, z the joint axis; a positive angle
//!   flexes. Links of a URDF keep the frames of the URDF.
//! - `pad/<name>`: origin in the centre of the sensing surface, y along the digit, z out of the surface.
//!
//! # Limitations
//! A [`Hand`] has at most five digits, each closed by one actuator, so a hand with a motor in each joint is
//! approximated: the motors of a digit pull together, and joints that move sideways are held. Cables cross at most
//! [`MAX_SPANS`](transmission::MAX_SPANS) joints. An arm has at most [`MAX_ARM_JOINTS`](arm::MAX_ARM_JOINTS) joints,
//! all of them revolute. Tactile images have one size, [`IMAGE_SIZE`](pads::IMAGE_SIZE) pixels a side. There is no
//! dynamics: couple a [`HandMechanism`](hand_mechanism::HandMechanism) to a physics engine.
//!
//! Only Unix systems.

#![deny(missing_docs, unreachable_pub)]

pub mod arm;
pub mod bisection;
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

/// Error of reading a file of a robot, with file, field, value and expectation.
pub use ftac_platform::DataError;
/// Restricts the files that a robot file may name.
pub use ftac_platform::file_access::FileAccess;
/// Vectors, points and poses of this crate's interface.
pub use nalgebra;

/// Gravity, m/s2.
pub const GRAVITY: f64 = 9.81;

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
