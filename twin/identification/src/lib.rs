//! Which one of the robots built from one drawing this is.
//!
//! The story in order: a [`script`] says how to move a robot so that its motion shows what it is made of, and how to press its pads on a
//! [`ball`], and to lift a [`weight`]; [`excitation`] does all that, [`pressing`] aims the presses. [`trace`] reads such a session back and cuts the [`free_motion`]s and the [`touches`] out of it.
//! [`kinematic_calibration`] finds from touches how arm, mount and links differ, [`weighing`] what the arm's torque sensors show of a known weight. [`free_digit`] is the twin of one digit that moves
//! freely, a [`chain`] on its servo; [`fit`] finds the parameters with which it moves as the session shows, and [`identify`](mod@identify) does so for all actuators;
//! [`interval`] says how surely they are known; [`evaluation`] sets what was found beside the truth, where there is one to read.

pub mod arm_load;
pub mod ball;
pub mod chain;
pub mod error;
pub mod evaluation;
pub mod excitation;
pub mod fit;
pub mod free_digit;
pub mod free_motion;
pub mod identify;
pub mod interval;
pub mod kinematic_calibration;
pub mod means;
pub mod pad_mechanics;
pub mod pressing;
pub mod row;
pub mod script;
pub mod task;
pub mod touches;
pub mod trace;
pub mod weighing;
pub mod weight;

pub use error::IdentificationError;
pub use identify::{Identification, identify};
pub use script::Script;
pub use trace::Trace;
