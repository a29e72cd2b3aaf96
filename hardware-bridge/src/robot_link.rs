//! The interface between the servo cycle and the devices of a robot.
//!
//! [`crate::bus_link`] implements it for this project's devices. A robot of another kind (a driver in another program, a
//! middleware) is driven by [`crate::hardware_robot::HardwareRobot::start`] through an implementation of its own, under
//! the same supervisor.

use robot_session_log::LinkTap;

use crate::clock::Clock;
use crate::safety::checks::Measurements;
use crate::safety::limits::WatchdogTimeouts;
use crate::safety::state::StopCause;
use crate::safety::supervisor::SafeCommand;
use crate::servo_cycle::CycleReport;

/// The devices of a robot. The servo cycle calls them; no call may block for longer than
/// [`RobotLink::standstill_limit`].
pub trait RobotLink: Send {
    /// Puts the newest measurements into `measured`, with their times on `clock`. A reading that did not arrive stays as
    /// it was: the supervisor checks its age. Errors go into `report`.
    fn measure(&mut self, clock: &Clock, measured: &mut Measurements, report: &mut CycleReport);

    /// Sends a command, which is within all limits. Returns the command that was really sent.
    fn send(&mut self, command: &SafeCommand, report: &mut CycleReport) -> SafeCommand;

    /// Switches the torque on without a jerk, with the goals `first` and the servos' own watchdog at `watchdog` (s).
    ///
    /// # Errors
    /// The reason, in words; the torque may then be on in a part of the robot.
    fn engage(&mut self, first: &SafeCommand, watchdog: f64) -> Result<(), String>;

    /// Switches the torque off and stops the arm. Returns the servos whose torque is not known to be off, with the
    /// reasons.
    fn torque_off(&mut self, report: &mut CycleReport) -> Vec<String>;

    /// Ends the stream of commands: the arm stands, and the hand keeps its last goals.
    fn park(&mut self, report: &mut CycleReport);

    /// Lets a control tick pass. Called for robots in lock-step only.
    fn step(&mut self, report: &mut CycleReport);

    /// Asks one device, the next for each `number`, for faults that its measurements do not show.
    fn audit(&mut self, number: u64) -> Option<StopCause> {
        let _ = number;
        None
    }

    /// Copies the bytes on the wires to `tap` from the next cycle on, if there are any.
    fn tap(&mut self, tap: LinkTap) {
        drop(tap);
    }

    /// Returns the time between two cycles from which on this program itself must have stood still, s.
    fn standstill_limit(&self, watchdogs: &WatchdogTimeouts) -> f64;

    /// True if the measurements of the arm hold measured torques.
    fn senses_torque(&self) -> bool;
}
