//! The safety supervisor between controller and motors.
//!
//! Every command passes [`supervisor::Supervisor`]. It tracks the robot's [`state::State`], limits each command relative to the one sent before
//! ([`limits`]), checks each measurement ([`checks`]), and returns the command that may be sent. It does no input or output and reads no
//! clock, so that tests can reach all of its behaviour.
//!
//! # What the arm does
//! Set-points are limited in speed, acceleration and jerk ([`set_points`]). A controller that sends arm or hand below the table, out of the workspace
//! or into themselves is stopped before that is sent ([`space`]), and one that presses against something when the arm feels it ([`pressing`]). Then
//! the arm also gives way: it is sent to where it is measured to be, and no longer to where it was to go. These limits stand beside the arm's own
//! protection zones and thresholds, which work without this program.
//!
//! # Two stops
//! The springs open the hand. *Hold* keeps the last goals with the current capped: what is held stays held. *Release* lets the
//! current fade and then takes the torque away: the hand opens. Every fault ends in *hold*; only an operator can *release*.
//!
//! # Three watchdogs
//! The servos' own (register 98) stops them when the whole computer falls silent; the arm's session does the same for the arm; and the
//! supervisor holds when the controller is silent for too long ([`limits::Watchdogs`]).

pub mod bodies;
pub mod checks;
pub mod limits;
pub mod pressing;
pub mod set_points;
pub mod space;
pub mod state;
pub mod supervisor;

pub use limits::Limits;
pub use state::{Cause, State};
pub use supervisor::Supervisor;
