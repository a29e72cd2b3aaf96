//! What stands between a controller and the motors.
//!
//! Every command passes [`supervisor::Supervisor`], which knows in which [`state::State`] the robot is, compares each command with
//! the one sent before ([`limits`]) and each measurement with what is allowed ([`checks`]), and answers with what may be sent. It does no input or
//! output and reads no clock, so that everything it can do is in its tests.
//!
//! # Two stops
//! The springs open the hand. *Hold* keeps the last goals with the current capped: what is held stays held. *Release* lets the
//! current fade and then takes the torque away: the hand opens. Whatever goes wrong ends in *hold*; *release* is always somebody's wish.
//!
//! # Three watchdogs
//! The servos' own (register 98) stops them when the whole computer falls silent; the arm's session does the same for the arm; and the
//! supervisor holds when the controller has not spoken for a while ([`limits::Watchdogs`]).

pub mod checks;
pub mod limits;
pub mod state;
pub mod supervisor;

pub use limits::Limits;
pub use state::{Cause, State};
pub use supervisor::Supervisor;
