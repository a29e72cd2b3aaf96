//! Low-level servoing: the host commands all joint angles at 1 kHz.
//!
//! # Entry
//! Faults are cleared and every joint must be in position mode. Then the mode is changed, and the first commands are
//! the measured angles themselves (*seeded entry*), so that the arm does not move until the controller commands it.
//!
//! # Commands
//! Each command is checked before it is sent. It must be finite, within the joints' ranges, at most one cycle's step
//! from the previous command (not from the lagging measurement), and not so far ahead of the arm that it would raise a
//! following error. A single invalid joint refuses the whole command. The caller then sends [`Servoing::hold`].
//!
//! # Exit
//! [`Servoing::leave`] returns control to the arm's base. If the host dies, commands stop and the arm's own watchdog
//! has to stop it. How a real Gen3 does that, and how fast, remains to be measured.

use std::time::{Duration, Instant};

use crate::arm::Arm;
use crate::cyclic::Feedback;
use crate::degrees::difference;
use crate::error::{CommandError, KortexError};
use crate::gen3;
use crate::joints::JOINTS;
use crate::message::ArmState;
use crate::message::base::ServoingMode;
use crate::message::device::ControlMode;
use crate::recent::{Cycles, Recent};
use crate::refusal::Reason;

/// Interval between commands, in cycles, from which they are late enough to starve the arm.
const LATE_CYCLES: u32 = 10;

/// Limits of a command.
///
/// # Example
/// ```
/// use kinova_kortex::servoing::ServoingLimits;
/// use kinova_kortex::{CommandError, gen3};
///
/// let limits = ServoingLimits::gen3();
/// let mut next = gen3::HOME;
/// next[1] += 0.001;
/// assert_eq!(limits.check(&next, &gen3::HOME, &gen3::HOME), Ok(()));
/// // 0.1 rad in a millisecond is too fast.
/// next[1] += 0.1;
/// assert!(matches!(limits.check(&next, &gen3::HOME, &gen3::HOME), Err(CommandError::Step { joint: 2, .. })));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoingLimits {
    /// Lower limits of the angles, rad.
    pub lower: [f64; JOINTS],
    /// Upper limits of the angles, rad.
    pub upper: [f64; JOINTS],
    /// Largest step from one command to the next, rad.
    pub step: [f64; JOINTS],
    /// Largest distance from the measured angle, rad.
    pub lead: [f64; JOINTS],
    /// Largest number of consecutive cycles without feedback.
    pub silent_cycles: u32,
    /// Length of a cycle.
    pub cycle: Duration,
}

impl ServoingLimits {
    /// Returns limits at 1 kHz for joints with these ranges (rad) and top speeds (rad/s): a lead of 3 degrees, and 100
    /// cycles of silence (loopback UDP has been seen to stall for 92 ms).
    pub fn at_1_khz(lower: [f64; JOINTS], upper: [f64; JOINTS], top_speed: [f64; JOINTS]) -> Self {
        let cycle = Duration::from_millis(1);
        Self {
            lower,
            upper,
            step: top_speed.map(|speed| speed * cycle.as_secs_f64()),
            lead: [3_f64.to_radians(); JOINTS],
            silent_cycles: 100,
            cycle,
        }
    }

    /// Returns limits at 1 kHz for a Gen3, with the ranges and top speeds in [`gen3`].
    pub fn gen3() -> Self {
        Self::at_1_khz(gen3::LOWER, gen3::UPPER, gen3::TOP_SPEED)
    }

    /// Checks that `angles` are finite and within the joints' ranges.
    ///
    /// # Errors
    /// [`CommandError::NotFinite`], [`CommandError::Range`].
    pub fn check_range(&self, angles: &[f64; JOINTS]) -> Result<(), CommandError> {
        for (i, &found) in angles.iter().enumerate() {
            let (joint, lower, upper) = (i + 1, self.lower[i], self.upper[i]);
            if !found.is_finite() {
                return Err(CommandError::NotFinite { joint, found });
            }
            if !(lower..=upper).contains(&found) {
                return Err(CommandError::Range { joint, found, lower, upper });
            }
        }
        Ok(())
    }

    /// Checks that `command` may follow `previous` while the arm is at `measured`.
    ///
    /// # Errors
    /// [`CommandError`] of the first joint that violates a limit.
    pub fn check(
        &self,
        command: &[f64; JOINTS],
        previous: &[f64; JOINTS],
        measured: &[f64; JOINTS],
    ) -> Result<(), CommandError> {
        self.check_range(command)?;
        for (i, &found) in command.iter().enumerate() {
            let joint = i + 1;
            let step = (found - previous[i]).abs();
            // Rounding may enlarge the step of a command at exactly the top speed.
            if step > self.step[i] * (1.0 + 1e-9) {
                return Err(CommandError::Step { joint, found: step, allowed: self.step[i] });
            }
            let lead = difference(found, measured[i]).abs();
            if lead > self.lead[i] {
                return Err(CommandError::Lead { joint, found: lead, allowed: self.lead[i] });
            }
        }
        Ok(())
    }
}

/// An arm in low-level servoing. Dropping it tries to leave the mode.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// use std::time::Instant;
///
/// use kinova_kortex::servoing::{Servoing, ServoingLimits};
///
/// let limits = ServoingLimits::gen3();
/// # let limits = ServoingLimits { silent_cycles: 60_000, ..limits };
/// let mut servoing = Servoing::enter(&mut arm, limits)?;
/// let mut angles = *servoing.command();
/// let mut next = Instant::now();
/// for _ in 0..100 {
///     next += limits.cycle;
///     angles[6] += 0.0005;
///     servoing.command_angles(&angles, next)?;
///     std::thread::sleep(next.saturating_duration_since(Instant::now()));
/// }
/// servoing.leave()?;
/// arm.close()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Servoing<'a> {
    arm: &'a mut Arm,
    limits: ServoingLimits,
    command: [f64; JOINTS],
    latest: Feedback,
    silent: u32,
    recent: Recent,
    left: bool,
}

impl<'a> Servoing<'a> {
    /// Enters low-level servoing. The arm stands still, whatever it did before.
    ///
    /// # Errors
    /// A refusal or fault; [`KortexError::ControlMode`]; [`KortexError::State`] if the arm does not follow the change
    /// of mode. The arm is then back in high-level mode, unless that fails too.
    pub fn enter(arm: &'a mut Arm, limits: ServoingLimits) -> Result<Self, KortexError> {
        arm.base.clear_faults()?;
        for (i, address) in arm.base.actuators()?.into_iter().enumerate() {
            let found = arm.base.control_mode(address)?;
            if found != ControlMode::Position {
                return Err(KortexError::ControlMode { joint: i + 1, found });
            }
        }
        let before = without_faults(arm)?;
        arm.base.set_servoing_mode(ServoingMode::LowLevel)?;
        let mut servoing = Self {
            arm,
            limits,
            command: before.motion.position,
            latest: before,
            silent: 0,
            recent: Recent::new(Instant::now()),
            left: false,
        };
        servoing.seed()?;
        Ok(servoing)
    }

    /// Commands the measured angles until the arm reports that it follows.
    fn seed(&mut self) -> Result<(), KortexError> {
        let deadline = Instant::now() + self.arm.base.session().timeouts().call;
        self.latest = self.arm.cyclic.feedback()?;
        self.command = self.latest.motion.position;
        loop {
            let cycle = Instant::now() + self.limits.cycle;
            self.exchange(cycle)?;
            if self.latest.state == ArmState::ServoingLowLevel {
                return Ok(());
            }
            if Instant::now() > deadline {
                return Err(KortexError::State { found: self.latest.state, expected: ArmState::ServoingLowLevel });
            }
            std::thread::sleep(cycle.saturating_duration_since(Instant::now()));
        }
    }

    /// Returns the newest measurements.
    pub fn latest(&self) -> &Feedback {
        &self.latest
    }

    /// Returns the command last sent, rad.
    pub fn command(&self) -> &[f64; JOINTS] {
        &self.command
    }

    /// Returns the limits that commands are checked against.
    pub fn limits(&self) -> &ServoingLimits {
        &self.limits
    }

    /// Returns the arm, for its counters and notifications.
    pub fn arm(&mut self) -> &mut Arm {
        self.arm
    }

    /// Commands `angles` (rad) and waits for the arm's answer until `deadline`. Returns true if measurements came.
    ///
    /// # Errors
    /// [`KortexError::Command`] before anything is sent: the caller then owes the arm a [`Servoing::hold`] in this
    /// cycle. Any other error ends servoing: a fault, an emergency stop, another state, too many consecutive cycles
    /// without feedback, a link's errors. The arm has then stopped or is about to stop by itself.
    pub fn command_angles(&mut self, angles: &[f64; JOINTS], deadline: Instant) -> Result<bool, KortexError> {
        self.limits.check(angles, &self.command, &self.latest.motion.position)?;
        self.command = *angles;
        self.cycle(deadline)
    }

    /// Sends the last command again.
    ///
    /// # Errors
    /// As [`Servoing::command_angles`], never [`KortexError::Command`].
    pub fn hold(&mut self, deadline: Instant) -> Result<bool, KortexError> {
        self.cycle(deadline)
    }

    fn cycle(&mut self, deadline: Instant) -> Result<bool, KortexError> {
        let fresh = self.exchange(deadline)?;
        if self.latest.state != ArmState::ServoingLowLevel {
            return Err(self.turned_out());
        }
        Ok(fresh)
    }

    fn exchange(&mut self, deadline: Instant) -> Result<bool, KortexError> {
        self.arm.base.keep_up()?;
        self.recent.note_sent(Instant::now());
        let fresh = match self.arm.cyclic.refresh(&self.command, deadline) {
            // The arm left low-level servoing. If it did so by itself, its faults give the reason.
            Err(error) if error.reason() == Some(Reason::ServoingMode) => {
                self.latest = self.arm.cyclic.feedback()?;
                self.fault()?;
                return Err(self.turned_out());
            }
            result => result?,
        };
        if let Some(feedback) = fresh {
            self.latest = feedback;
            self.silent = 0;
        } else {
            self.recent.note_missed();
            self.silent += 1;
            if self.silent > self.limits.silent_cycles {
                return Err(KortexError::FeedbackLost { ticks: self.silent, allowed: self.limits.silent_cycles });
            }
        }
        self.fault()?;
        Ok(fresh.is_some())
    }

    /// Checks the newest measurements for faults. A watchdog fault is reported by its cause: this program, or the
    /// network.
    fn fault(&self) -> Result<(), KortexError> {
        let error = match fault_of(&self.latest) {
            Err(KortexError::Fault(report)) if report.is_watchdog() => {
                let Cycles { gap, sent, missed } = self.recent.cycles();
                match gap > self.limits.cycle * LATE_CYCLES {
                    true => KortexError::HostLate { gap, report },
                    false => KortexError::CommandsLost { gap, sent, missed, report },
                }
            }
            result => return result,
        };
        Err(error)
    }

    /// Returns the reason for which the arm has left low-level servoing without a fault. The end of our own session
    /// also does that, so the arm is asked.
    fn turned_out(&mut self) -> KortexError {
        match self.arm.base.servoing_mode() {
            Ok(ServoingMode::LowLevel) => {
                KortexError::State { found: self.latest.state, expected: ArmState::ServoingLowLevel }
            }
            Ok(found) => KortexError::TakenOver { found },
            Err(error) => error,
        }
    }

    /// Returns control to the arm's base, which holds the arm in place.
    ///
    /// # Errors
    /// As [`crate::session::Session::call`].
    pub fn leave(mut self) -> Result<(), KortexError> {
        self.left = true;
        self.arm.base.set_servoing_mode(ServoingMode::SingleLevel)
    }
}

impl Drop for Servoing<'_> {
    fn drop(&mut self) {
        if !self.left {
            // The caller has an error already, and the arm's watchdog will stop it.
            drop(self.arm.base.set_servoing_mode(ServoingMode::SingleLevel));
        }
    }
}

/// Waits until cleared faults are gone, which the answer to the call does not guarantee.
fn without_faults(arm: &mut Arm) -> Result<Feedback, KortexError> {
    let deadline = Instant::now() + arm.base.session().timeouts().call;
    loop {
        let feedback = arm.cyclic.feedback()?;
        match fault_of(&feedback) {
            Ok(()) => return Ok(feedback),
            Err(error) if Instant::now() > deadline => return Err(error),
            Err(_) => std::thread::sleep(Duration::from_millis(10)),
        }
        arm.keep_up()?;
    }
}

/// Checks the feedback for faults.
///
/// # Errors
/// [`KortexError::EmergencyStop`], [`KortexError::Fault`].
pub fn fault_of(feedback: &Feedback) -> Result<(), KortexError> {
    if feedback.faults.is_emergency_stop() {
        return Err(KortexError::EmergencyStop(Box::new(feedback.faults)));
    }
    if !feedback.faults.is_empty() || feedback.state == ArmState::InFault {
        return Err(KortexError::Fault(Box::new(feedback.faults)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ZERO: [f64; JOINTS] = [0.0; JOINTS];

    fn only(joint: usize, value: f64) -> [f64; JOINTS] {
        std::array::from_fn(|i| if i + 1 == joint { value } else { 0.0 })
    }

    #[test]
    fn commands_are_checked_joint_by_joint() {
        let limits = ServoingLimits::gen3();
        let check = |command, previous, measured| limits.check(&command, &previous, &measured);
        assert_eq!(check(only(1, 0.00139), ZERO, ZERO), Ok(()));
        assert!(matches!(check(only(3, f64::NAN), ZERO, ZERO), Err(CommandError::NotFinite { joint: 3, .. })));
        assert!(matches!(check(only(7, 0.0013), ZERO, ZERO), Err(CommandError::Step { joint: 7, .. })));
        assert!(matches!(check(only(2, 2.3), only(2, 2.3), only(2, 2.3)), Err(CommandError::Range { joint: 2, .. })));
        assert!(matches!(check(only(5, 0.06), only(5, 0.06), ZERO), Err(CommandError::Lead { joint: 5, .. })));
    }

    /// A joint without end stops may be commanded a full turn away from its count: the posture is the same.
    #[test]
    fn lead_is_measured_as_posture() {
        let limits = ServoingLimits::gen3();
        let turn = only(1, std::f64::consts::TAU);
        assert_eq!(limits.check(&turn, &turn, &ZERO), Ok(()));
    }
}
