//! The Gen3 as the bridge's arm. [`ServoLoop`]'s thread exchanges commands at 1 kHz; the bridge reads and sets its
//! state once per servo cycle.

use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use hand_model::arm::Arm as ArmModel;
use hand_model::robot::ArmState;
use kinova_kortex::joints::JOINTS;
use kinova_kortex::link::LinkError;
use kinova_kortex::refusal::Reason;
use kinova_kortex::safety_bank::{self, Report};
use kinova_kortex::servo_loop::{Pacing, ServoLoop};
use kinova_kortex::servoing::{ServoingLimits, fault_of};
use kinova_kortex::{Arm, JointMotion, KortexError};
use robot_session_log::LinkPacket;

use crate::arm_link::{ArmLink, ArmLinkError};
use crate::safety::checks::ArmReading;
use crate::safety::state::ArmTrouble;

/// Returns the limits of the commands to an arm of this model, which are sent at 1 kHz.
pub fn limits(arm: &ArmModel) -> ServoingLimits {
    let joints = &arm.tree.joints;
    let (lower, upper) = (std::array::from_fn(|i| joints[i].lower), std::array::from_fn(|i| joints[i].upper));
    let speed = std::array::from_fn(|i| arm.velocity_limits[i]);
    ServoingLimits::at_1_khz(lower, upper, speed)
}

/// Converts joint values to those of a Gen3; [`check_supported`](crate::supported_robot::check_supported) has refused
/// other arms.
pub fn to_gen3(joints: &[f64]) -> [f64; JOINTS] {
    std::array::from_fn(|joint| joints[joint])
}

/// Converts the client's measurement to the state that the robot reports.
pub fn arm_state(motion: JointMotion) -> ArmState {
    let JointMotion { position, velocity, torque } = motion;
    ArmState { position: position.into(), velocity: velocity.into(), torque: torque.into() }
}

/// Records both links of `arm` from now on, as `arm_tcp` and `arm_udp`.
pub fn tap(arm: &mut Arm, packets: &Sender<LinkPacket>) {
    let tap = |link| {
        let tap = robot_session_log::LinkTap::new(link, packets.clone());
        kinova_kortex::Tap::new(move |direction, bytes| {
            let direction = match direction {
                kinova_kortex::Direction::Sent => robot_session_log::Direction::Sent,
                kinova_kortex::Direction::Received => robot_session_log::Direction::Received,
            };
            tap.copy_packet(direction, bytes);
        })
    };
    arm.tap(tap("arm_tcp"), tap("arm_udp"));
}

/// Interval between readings of an arm that is not servoing; each costs a round trip.
const READ_INTERVAL: Duration = Duration::from_millis(20);

/// The owner of the arm.
enum ArmOwner {
    /// None: the arm's base holds it.
    Idle(Box<Arm>),
    Servoing(Box<ServoLoop>),
    /// Lost while changing the owner.
    Lost,
}

/// A connected Gen3.
pub struct KortexLink {
    owner: ArmOwner,
    limits: ServoingLimits,
    pacing: Pacing,
    reading: Option<ArmReading>,
    last_read: Option<Instant>,
    answered: u64,
    /// Reason why the servo loop ended, once it has, or the fault that an arm that is not servoing reports.
    fault: Option<ArmLinkError>,
}

impl KortexLink {
    /// Wraps a connected arm of this model. `tick` is the time between two set-points; the arm is stopped if none comes
    /// within `deadline`.
    pub fn new(arm: Arm, model: &ArmModel, tick: Duration, deadline: Duration) -> Self {
        let limits = limits(model);
        // The arm may be silent for as long as the controller may.
        let silent_cycles = (deadline.as_secs_f64() / limits.cycle.as_secs_f64()).round() as u32;
        let limits = ServoingLimits { silent_cycles, ..limits };
        let pacing = Pacing { tick, host_deadline: deadline };
        Self {
            owner: ArmOwner::Idle(Box::new(arm)),
            limits,
            pacing,
            reading: None,
            last_read: None,
            answered: 0,
            fault: None,
        }
    }

    /// Ends the servo loop, if one runs, and takes the arm back. Returns the error with which the loop had ended, if
    /// any.
    fn take_back(&mut self) -> Option<ArmLinkError> {
        match std::mem::replace(&mut self.owner, ArmOwner::Lost) {
            ArmOwner::Servoing(servo_loop) => {
                let (arm, result) = servo_loop.finish();
                let failed = result.err().map(|error| arm_link_error(&error));
                self.owner = ArmOwner::Idle(Box::new(arm));
                failed
            }
            other => {
                self.owner = other;
                None
            }
        }
    }
}

/// Converts an error of the client to the trouble that the operator has to resolve, and its text.
pub fn arm_link_error(error: &KortexError) -> ArmLinkError {
    ArmLinkError { trouble: arm_trouble(error), text: error.to_string() }
}

fn arm_trouble(error: &KortexError) -> ArmTrouble {
    let of_report = |report: &Report| {
        let stopped = report.joints.iter().any(|joint| joint.a & safety_bank::WATCHDOG != 0);
        if stopped { ArmTrouble::Watchdog } else { ArmTrouble::Fault }
    };
    match error {
        KortexError::EmergencyStop(_) => ArmTrouble::EmergencyStop,
        KortexError::Fault(report) => of_report(report),
        KortexError::Link(LinkError::Closed) => ArmTrouble::Closed,
        KortexError::Link(_)
        | KortexError::Timeout { .. }
        | KortexError::Silent { .. }
        | KortexError::FeedbackLost { .. } => ArmTrouble::Network,
        KortexError::SessionLost { .. } => ArmTrouble::SessionLost,
        KortexError::SessionExpired { .. } | KortexError::HostLate { .. } => ArmTrouble::HostLate,
        KortexError::CommandsLost { .. } => ArmTrouble::CommandsLost,
        KortexError::State { .. } | KortexError::ControlMode { .. } | KortexError::TakenOver { .. } => {
            ArmTrouble::OtherClient
        }
        KortexError::Refused { refusal, .. } => match refusal.reason {
            Reason::EmergencyStop => ArmTrouble::EmergencyStop,
            Reason::InFault => ArmTrouble::Fault,
            Reason::NotInControl | Reason::ServoingMode => ArmTrouble::OtherClient,
            _ => ArmTrouble::Refused,
        },
        KortexError::Answer { .. } | KortexError::Command(_) => ArmTrouble::Refused,
    }
}

fn lost_error() -> ArmLinkError {
    let text = "the connection was lost in a change of mode".to_owned();
    ArmLinkError { trouble: ArmTrouble::Closed, text }
}

impl ArmLink for KortexLink {
    fn read(&mut self, now: f64) -> Result<ArmReading, ArmLinkError> {
        if let ArmOwner::Servoing(servo_loop) = &self.owner
            && servo_loop.snapshot().ended
        {
            // Leaving servoing over a dead network takes a second; the servos' watchdogs do not wait that long.
            let over = servo_loop.is_over();
            let reason = if over { self.take_back() } else { None };
            let ended = || ArmLinkError { trouble: ArmTrouble::Network, text: "servoing ended".to_owned() };
            self.fault = reason.or(self.fault.take()).or_else(|| Some(ended()));
        }
        match &mut self.owner {
            ArmOwner::Servoing(servo_loop) => {
                let snapshot = servo_loop.snapshot();
                // An old measurement keeps its time.
                if snapshot.counters.answered != self.answered || self.reading.is_none() {
                    self.answered = snapshot.counters.answered;
                    self.reading =
                        Some(ArmReading { received_at: now, state: arm_state(snapshot.feedback.motion), fault: None });
                }
            }
            // After a fault the arm is not asked again: a dead network would block the servo cycle.
            ArmOwner::Idle(arm)
                if self.fault.is_none() && self.last_read.is_none_or(|looked| looked.elapsed() > READ_INTERVAL) =>
            {
                self.last_read = Some(Instant::now());
                arm.keep_up().map_err(|error| arm_link_error(&error))?;
                let feedback = arm.cyclic.feedback().map_err(|error| arm_link_error(&error))?;
                let fault = fault_of(&feedback).err().map(|error| arm_link_error(&error));
                let trouble = fault.as_ref().map(|fault| fault.trouble);
                self.reading = Some(ArmReading { received_at: now, state: arm_state(feedback.motion), fault: trouble });
                if let Some(fault) = fault {
                    return Err(fault);
                }
            }
            ArmOwner::Idle(_) => {}
            ArmOwner::Lost => return Err(lost_error()),
        }
        match (&self.fault, self.reading) {
            (Some(fault), Some(reading)) if reading.fault.is_none() => {
                self.reading = Some(ArmReading { fault: Some(fault.trouble), ..reading });
                Err(fault.clone())
            }
            (_, Some(reading)) => Ok(reading),
            (_, None) => Err(ArmLinkError { trouble: ArmTrouble::Network, text: "no measurement yet".to_owned() }),
        }
    }

    fn engage(&mut self) -> Result<(), ArmLinkError> {
        self.take_back();
        self.fault = None;
        match std::mem::replace(&mut self.owner, ArmOwner::Lost) {
            ArmOwner::Idle(arm) => {
                let servo_loop =
                    ServoLoop::start(*arm, self.limits, self.pacing).map_err(|error| arm_link_error(&error))?;
                self.answered = 0;
                self.owner = ArmOwner::Servoing(Box::new(servo_loop));
                Ok(())
            }
            _ => Err(lost_error()),
        }
    }

    fn command(&mut self, set_points: &[f64]) -> Result<(), ArmLinkError> {
        match &self.owner {
            ArmOwner::Servoing(servo_loop) => {
                servo_loop.set_target(to_gen3(set_points)).map_err(|error| arm_link_error(&error.into()))
            }
            _ => Err(self.fault.clone().unwrap_or_else(ArmLinkError::unready)),
        }
    }

    fn disengage(&mut self) -> Result<(), ArmLinkError> {
        self.take_back().map_or(Ok(()), Err)
    }
}
