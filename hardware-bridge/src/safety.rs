//! The safety supervisor between controller and motors.
//!
//! Every command passes [`supervisor::Supervisor`]. It tracks the robot's [`state::SupervisorState`], limits each
//! command relative to the one sent before ([`limits`]), checks each measurement ([`checks`]), and returns the command
//! that may be sent. It does no input or output and reads no clock, so that tests can reach all of its behaviour.
//!
//! # Limits of the arm
//! Set-points are limited in speed, acceleration and jerk ([`set_points`]). A command that would send arm or hand below
//! the table, out of the workspace or into each other is stopped before it is sent ([`workspace`]). An arm that presses
//! against something is stopped when its torque sensors show it ([`torque_monitor`]). It then also yields: it is sent
//! to its measured position and no longer to its goal. These limits supplement the arm's own protection zones and
//! thresholds, which work without this program.
//!
//! # Two stops
//! The springs open the hand. *Hold* keeps the last goals with the current capped, so that the grasp is kept. *Release*
//! fades the current and then switches the torque off, so that the hand opens. Every fault ends in *hold*; only an
//! operator can *release*.
//!
//! # Three watchdogs
//! The servos' own bus watchdog (register 98) stops them when the whole computer falls silent. The arm's session does
//! the same for the arm. The supervisor holds when the controller is silent for too long ([`limits::WatchdogTimeouts`]).

mod arm_course;
pub mod checks;
pub mod collision_bodies;
pub mod limits;
pub mod set_points;
pub mod state;
pub mod supervisor;
pub mod torque_monitor;
pub mod workspace;

pub use limits::SafetyLimits;
pub use state::{StopCause, SupervisorState};
pub use supervisor::Supervisor;
