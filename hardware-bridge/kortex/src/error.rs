//! Errors of the client.

use std::time::Duration;

use crate::call::Call;
use crate::link::LinkError;
use crate::message::ArmState;
use crate::message::base::ServoingMode;
use crate::message::device::ControlMode;
use crate::refusal::{Reason, Refusal};
use crate::safety_bank::Report;

/// An error of the arm's client.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// use kinova_kortex::refusal::Reason;
/// use kinova_kortex::{Credentials, KortexError};
///
/// let wrong = Credentials { user: "admin".to_owned(), password: "guess".to_owned() };
/// let refused = Arm::connect(emulator.address(), &wrong, Timeouts::default(), gen3::HOME);
/// let error = refused.err().ok_or("the emulated arm let a stranger in")?;
/// assert_eq!(error.reason(), Some(Reason::Login));
/// assert!(matches!(error, KortexError::Refused { .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum KortexError {
    /// The connection itself failed.
    #[error("connection to the arm: {0}")]
    Link(#[from] LinkError),
    /// No answer in time. On UDP a single one means little. On TCP the arm or the network is in trouble.
    #[error("{call}: no answer within {after:?}")]
    Timeout {
        /// Unanswered call.
        call: Call,
        /// Time waited.
        after: Duration,
    },
    /// The arm no longer knows our session, although this program kept it alive: the arm restarted, or another client
    /// ended the session. A new session is needed.
    #[error("{call}: the arm does not know session {session} any more, which was kept in time")]
    SessionLost {
        /// Refused call.
        call: Call,
        /// Number of the session.
        session: u16,
    },
    /// Our session ended because this program did not keep it alive. A new session is needed.
    #[error("{call}: session {session} ran out: this program was silent for {silent:?}, and it allows {allowed:?}")]
    SessionExpired {
        /// Refused call.
        call: Call,
        /// Number of the session.
        session: u16,
        /// Time for which this program sent nothing, or no call.
        silent: Duration,
        /// Timeout of the session.
        allowed: Duration,
    },
    /// Another client has ended our low-level servoing: our session is open, and no fault is active.
    #[error("another client took over: the servoing mode is {found:?}, expected {:?}", ServoingMode::LowLevel)]
    TakenOver {
        /// Servoing mode that was found.
        found: ServoingMode,
    },
    /// The arm's watchdog stopped it because this program sent no command in time.
    #[error("the arm stopped itself for want of commands: this program sent none for {gap:?} ({report})")]
    HostLate {
        /// Longest interval between two commands within the last second or so.
        gap: Duration,
        /// Faults at that time.
        report: Box<Report>,
    },
    /// The arm's watchdog stopped it although commands were sent in time: they did not arrive.
    #[error(
        "the arm stopped itself for want of commands, which were sent at most {gap:?} apart: the network lost them or \
         held them up ({missed} of the last {sent} unanswered in time; {report})"
    )]
    CommandsLost {
        /// Longest interval between two commands within the last second or so.
        gap: Duration,
        /// Number of commands sent in that time.
        sent: u64,
        /// Number of those without an answer in their cycle.
        missed: u64,
        /// Faults at that time.
        report: Box<Report>,
    },
    /// Keep-alives are not answered.
    #[error("the arm has been silent for {silent:?}, longer than the session's {allowed:?}")]
    Silent {
        /// Time since the last sign of life.
        silent: Duration,
        /// Longest silence that the session allows.
        allowed: Duration,
    },
    /// The arm refused a call.
    #[error("{call}: {refusal}")]
    Refused {
        /// Refused call.
        call: Call,
        /// Reason, and text of the arm.
        refusal: Refusal,
    },
    /// The arm gave an invalid answer.
    #[error("{call}: {field} is {found}, expected {expected}")]
    Answer {
        /// Answered call.
        call: Call,
        /// Affected part of the answer.
        field: &'static str,
        /// Value in the answer.
        found: String,
        /// Values that are valid.
        expected: String,
    },
    /// A joint is not in position mode.
    #[error("joint {joint} is in control mode {found:?}, expected {:?}", ControlMode::Position)]
    ControlMode {
        /// Number of the joint, from 1.
        joint: usize,
        /// Mode that was found.
        found: ControlMode,
    },
    /// The emergency stop is pressed, or the emergency line open.
    #[error("emergency stop: release it, then clear the faults ({0})")]
    EmergencyStop(Box<Report>),
    /// The arm is in fault.
    #[error("the arm is in fault: {0}")]
    Fault(Box<Report>),
    /// The arm has left low-level servoing without a fault.
    #[error("the arm is in state {found:?}, expected {expected:?}")]
    State {
        /// State that the arm reports.
        found: ArmState,
        /// Expected state.
        expected: ArmState,
    },
    /// Answers to the cyclic commands stopped coming.
    #[error("no feedback for {ticks} cycles, at most {allowed} allowed")]
    FeedbackLost {
        /// Number of cycles without an answer.
        ticks: u32,
        /// Largest tolerated number.
        allowed: u32,
    },
    /// The command was refused before it was sent.
    #[error(transparent)]
    Command(#[from] CommandError),
}

impl KortexError {
    /// Returns the reason of a refusal.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            Self::Refused { refusal, .. } => Some(refusal.reason),
            _ => None,
        }
    }
}

/// A joint command that was not sent. A single invalid joint refuses the whole command.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// The command is not finite.
    #[error("joint {joint}: command {found}, expected a number")]
    NotFinite {
        /// Number of the joint, from 1.
        joint: usize,
        /// Commanded value.
        found: f64,
    },
    /// The command is outside the joint's range.
    #[error("joint {joint}: command {found:.4} rad, expected {lower:.4} to {upper:.4}")]
    Range {
        /// Number of the joint, from 1.
        joint: usize,
        /// Commanded angle, rad.
        found: f64,
        /// Lower limit, rad.
        lower: f64,
        /// Upper limit, rad.
        upper: f64,
    },
    /// The step from the previous command is too large.
    #[error("joint {joint}: step of {found:.5} rad in a cycle, at most {allowed:.5} expected")]
    Step {
        /// Number of the joint, from 1.
        joint: usize,
        /// Step from the previous command, rad.
        found: f64,
        /// Largest step, rad.
        allowed: f64,
    },
    /// The command is too far from the measured angle: the arm would raise a following error.
    #[error("joint {joint}: command {found:.4} rad away from the measured angle, at most {allowed:.4} expected")]
    Lead {
        /// Number of the joint, from 1.
        joint: usize,
        /// Distance to the measured angle, rad.
        found: f64,
        /// Largest distance, rad.
        allowed: f64,
    },
    /// The commanded speed is too high.
    #[error("joint {joint}: speed {found:.4} rad/s, at most {allowed:.4} expected")]
    Speed {
        /// Number of the joint, from 1.
        joint: usize,
        /// Commanded speed, rad/s.
        found: f64,
        /// Highest allowed speed, rad/s.
        allowed: f64,
    },
}
