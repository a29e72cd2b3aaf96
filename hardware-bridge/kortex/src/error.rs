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
#[derive(Debug, thiserror::Error)]
pub enum KortexError {
    /// The connection itself failed.
    #[error("connection to the arm: {0}")]
    Link(#[from] LinkError),
    /// No answer in time. On UDP a single one means little; on TCP the arm or the network is in trouble.
    #[error("{call}: no answer within {after:?}")]
    Timeout {
        call: Call,
        /// How long was waited.
        after: Duration,
    },
    /// The arm does not know our session any more, though nothing was left undone to keep it: the arm restarted, or
    /// somebody ended it. A new session is needed.
    #[error("{call}: the arm does not know session {session} any more, which was kept in time")]
    SessionLost {
        call: Call,
        /// The session's number.
        session: u16,
    },
    /// Our session ended because this program did not keep it. A new session is needed.
    #[error("{call}: session {session} ran out: this program was silent for {silent:?}, and it allows {allowed:?}")]
    SessionExpired {
        call: Call,
        /// The session's number.
        session: u16,
        /// How long this program sent nothing, or no call.
        silent: Duration,
        /// How long the session lasts without.
        allowed: Duration,
    },
    /// Another client has ended our low-level servoing: our session is open, and no fault is active.
    #[error("another client took over: the servoing mode is {found:?}, expected {:?}", ServoingMode::LowLevel)]
    TakenOver {
        /// The mode it was changed to.
        found: ServoingMode,
    },
    /// The arm stopped itself because no command reached it in time, and this program sent none in time.
    #[error("the arm stopped itself for want of commands: this program sent none for {gap:?} ({report})")]
    HostLate {
        /// The longest time between two commands of the last second or so.
        gap: Duration,
        report: Box<Report>,
    },
    /// The arm stopped itself because no command reached it in time, though they were sent in time.
    #[error(
        "the arm stopped itself for want of commands, which were sent at most {gap:?} apart: the network lost them or \
         held them up ({missed} of the last {sent} unanswered in time; {report})"
    )]
    CommandsLost {
        /// The longest time between two commands of the last second or so.
        gap: Duration,
        /// Commands of that time, and those without an answer in their cycle.
        sent: u64,
        missed: u64,
        report: Box<Report>,
    },
    /// Keep-alives are not answered.
    #[error("the arm has been silent for {silent:?}, longer than the session's {allowed:?}")]
    Silent {
        /// Since when nothing came.
        silent: Duration,
        /// What the session allows.
        allowed: Duration,
    },
    /// The arm refused.
    #[error("{call}: {refusal}")]
    Refused { call: Call, refusal: Refusal },
    /// An invalid answer.
    #[error("{call}: {field} is {found}, expected {expected}")]
    Answer {
        call: Call,
        /// Which part of the answer.
        field: &'static str,
        found: String,
        expected: String,
    },
    /// A joint is not in position mode.
    #[error("joint {joint} is in control mode {found:?}, expected {:?}", ControlMode::Position)]
    ControlMode {
        /// From 1.
        joint: usize,
        found: ControlMode,
    },
    /// The emergency stop is pressed, or the emergency line open.
    #[error("emergency stop: release it, then clear the faults ({0})")]
    EmergencyStop(Box<Report>),
    /// The arm is in fault.
    #[error("the arm is in fault: {0}")]
    Fault(Box<Report>),
    /// The arm is no longer driven by us, without a fault.
    #[error("the arm is in state {found:?}, expected {expected:?}")]
    State {
        found: ArmState,
        /// The state it should be in.
        expected: ArmState,
    },
    /// Answers to the cyclic commands stopped coming.
    #[error("no feedback for {ticks} cycles, at most {allowed} allowed")]
    FeedbackLost {
        /// Cycles without an answer.
        ticks: u32,
        /// How many are tolerated.
        allowed: u32,
    },
    /// The command was refused before it was sent.
    #[error(transparent)]
    Command(#[from] CommandError),
}

impl KortexError {
    /// The reason of a refusal.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            Self::Refused { refusal, .. } => Some(refusal.reason),
            _ => None,
        }
    }
}

/// A joint command that was not sent. One bad joint refuses the whole command.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// No number.
    #[error("joint {joint}: command {found}, expected a number")]
    NotFinite {
        /// From 1.
        joint: usize,
        /// What was commanded.
        found: f64,
    },
    /// Outside the joint's range.
    #[error("joint {joint}: command {found:.4} rad, expected {lower:.4} to {upper:.4}")]
    Range {
        /// From 1.
        joint: usize,
        /// What was commanded, rad.
        found: f64,
        /// Lowest, rad.
        lower: f64,
        /// Highest, rad.
        upper: f64,
    },
    /// Too far from the command before.
    #[error("joint {joint}: step of {found:.5} rad in a cycle, at most {allowed:.5} expected")]
    Step {
        /// From 1.
        joint: usize,
        /// Step from the command before, rad.
        found: f64,
        /// Largest step, rad.
        allowed: f64,
    },
    /// Too far from where the joint is: the arm would trip over its following error.
    #[error("joint {joint}: command {found:.4} rad away from the measured angle, at most {allowed:.4} expected")]
    Lead {
        /// From 1.
        joint: usize,
        /// Distance to the measured angle, rad.
        found: f64,
        /// Largest distance, rad.
        allowed: f64,
    },
    /// Too fast.
    #[error("joint {joint}: speed {found:.4} rad/s, at most {allowed:.4} expected")]
    Speed {
        /// From 1.
        joint: usize,
        /// What was commanded, rad/s.
        found: f64,
        /// Highest, rad/s.
        allowed: f64,
    },
}
