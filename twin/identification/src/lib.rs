//! System identification: how a robot instance differs from its nominal model.
//!
//! A [`script`] defines how to excite a robot so that its motion reveals its parameters, how to press its pads on a
//! [`ball`] with a [`ball_clearance`], and how to lift a [`payload`]. [`excitation`] runs the script, and [`pressing`]
//! aims the presses. [`trace`] reads such a session back and extracts its [`free_motion`]s and [`deepest_touches`].
//!
//! From touches, [`kinematic_calibration`] estimates the deviations of arm, mount and links; [`payload_calibration`]
//! estimates the gains of the arm's torque sensors from a known weight. [`free_digit`] is the model of one digit that
//! moves freely, a [`chain`] on its servo. [`fit_actuator`] finds the parameters with which it moves as in the session,
//! and [`identify`](mod@identify) does so for all actuators. [`interval`] computes their uncertainty. [`evaluation`]
//! compares the result with the truth, if known.

pub mod arm_load;
pub mod ball;
pub mod ball_clearance;
pub mod chain;
pub mod error;
pub mod evaluation;
pub mod excitation;
pub mod excitation_setup;
pub mod fit;
pub mod free_digit;
pub mod free_motion;
pub mod identify;
pub mod interval;
pub mod kinematic_calibration;
pub mod pad_mechanics;
pub mod payload;
pub mod payload_calibration;
pub mod pressing;
pub mod script;
pub mod task;
pub mod tick_record;
pub mod touches;
pub mod trace;

pub use error::IdentificationError;
pub use identify::{Identification, identify};
pub use script::ExcitationScript;
pub use trace::Trace;
