//! The cyclic exchange over UDP at 1 kHz: one command to all joints, one answer.
//!
//! UDP loses, delays and reorders datagrams. A cycle without an answer in time is *missed*. The answer may still arrive
//! *late*, *out of order* (after the answer to a newer command, so it is not used), or never (*lost*). All of these are
//! counted and none is an error. Only many missed cycles in a row are an error, which [`crate::servoing`] raises.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use crate::call;
use crate::degrees::{self, Turns};
use crate::error::KortexError;
use crate::frame::{Frame, is_younger};
use crate::joints::{JOINTS, JointMotion};
use crate::link::UdpLink;
use crate::message::cyclic::{ActuatorCommand, ActuatorFeedback, Command, Feedback as WireFeedback, SERVO_ENABLE};
use crate::message::{ArmState, Empty};
use crate::refusal::Refusal;
use crate::safety_bank::{Banks, Report};
use crate::session::{Credentials, Session, Timeouts, decode};
use crate::tap::Tap;

/// Number of unanswered commands beyond which the oldest counts as lost.
const OUTSTANDING: usize = 256;

/// Time after which missing measurements are requested again.
const ASK_AGAIN: Duration = Duration::from_millis(20);

/// Measurements of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feedback {
    /// Number of the command that they answer.
    pub frame: u16,
    /// Operating state of the arm.
    pub state: ArmState,
    /// Angles (rad, unwrapped over full turns), speeds, torques.
    pub motion: JointMotion,
    /// Motor currents, A.
    pub current: [f64; JOINTS],
    /// Motor temperatures, degrees Celsius.
    pub temperature: [f64; JOINTS],
    /// Supply voltage of the arm, V.
    pub voltage: f64,
    /// Active faults.
    pub faults: Report,
    /// Active warnings.
    pub warnings: Report,
}

/// Counts of cycles by result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Commands sent.
    pub sent: u64,
    /// Answers used.
    pub answered: u64,
    /// Cycles without an answer at their deadline.
    pub missed: u64,
    /// Answers that came after their cycle.
    pub late: u64,
    /// Answers not used because one to a younger command had arrived before.
    pub out_of_order: u64,
    /// Commands never answered.
    pub lost: u64,
    /// Answers to no command of ours.
    pub stray: u64,
    /// Datagrams that were no valid frame.
    pub damaged: u64,
}

/// The arm's cyclic interface.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// let feedback = arm.cyclic.feedback()?;
/// println!("{:?} rad, {:?} degrees Celsius", feedback.motion.position, feedback.temperature);
/// assert!(feedback.faults.is_empty(), "{}", feedback.faults);
/// assert_eq!(arm.cyclic.counters().damaged, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Cyclic {
    session: Session<UdpLink>,
    turns: Turns,
    frame: u16,
    outstanding: VecDeque<u16>,
    newest: Option<u16>,
    counters: Counters,
}

impl Cyclic {
    /// Binds a port and logs in. `near` (rad) selects the turn in which the first angles are read.
    ///
    /// # Errors
    /// The link's and the login's.
    pub fn connect(
        address: SocketAddr,
        credentials: &Credentials,
        timeouts: Timeouts,
        near: [f64; JOINTS],
    ) -> Result<Self, KortexError> {
        let session = Session::create(UdpLink::connect(address)?, credentials, timeouts, call::REFRESH_FEEDBACK)?;
        let (turns, counters) = (Turns::near(near), Counters::default());
        Ok(Self { session, turns, frame: 0, outstanding: VecDeque::new(), newest: None, counters })
    }

    /// Returns the counts since the login.
    pub fn counters(&self) -> Counters {
        let Counters { stray, .. } = self.counters;
        Counters { stray: stray + self.session.stray(), damaged: self.session.damaged(), ..self.counters }
    }

    /// Returns the session of this interface, for its number and counts.
    pub fn session(&self) -> &Session<UdpLink> {
        &self.session
    }

    /// Copies everything that crosses the connection from now on into `tap`.
    pub fn tap(&mut self, tap: Tap) {
        self.session.tap(tap);
    }

    /// Keeps the session alive without waiting. A stream of commands also does so.
    ///
    /// # Errors
    /// As [`Session::keep_up`].
    pub fn keep_up(&mut self) -> Result<(), KortexError> {
        self.session.keep_up()
    }

    /// Logs out.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn close(self) -> Result<(), KortexError> {
        self.session.close()
    }

    /// Requests measurements, in any mode, without a command. After a lost datagram the request is repeated.
    ///
    /// # Errors
    /// As [`Session::call`]; [`KortexError::Answer`] for invalid measurements.
    pub fn feedback(&mut self) -> Result<Feedback, KortexError> {
        let call = call::REFRESH_FEEDBACK;
        let after = self.session.timeouts().call;
        let deadline = Instant::now() + after;
        let mut asked = Vec::new();
        while asked.is_empty() || Instant::now() < deadline {
            asked.push(self.session.post(call, 0, &Empty {})?);
            let timeout = deadline.min(Instant::now() + ASK_AGAIN);
            while let Some(response) = self.session.next_response(timeout)? {
                if response.header.call != call || !asked.contains(&response.header.message) {
                    self.counters.stray += 1;
                    continue;
                }
                return match Refusal::of(&response) {
                    Some(refusal) => Err(self.session.refused(call, refusal)),
                    None => self.read(&decode(&response)?),
                };
            }
        }
        Err(KortexError::Timeout { call, after })
    }

    /// Commands all joints to `angles` (rad) and waits for the answer until `deadline`. Returns `None` if no new
    /// measurements came. An answer to an earlier command that came meanwhile is new.
    ///
    /// # Errors
    /// A refusal, a link's errors, a lost session, invalid measurements. A missing answer is not an error.
    pub fn refresh(&mut self, angles: &[f64; JOINTS], deadline: Instant) -> Result<Option<Feedback>, KortexError> {
        self.frame = self.frame.wrapping_add(1);
        let number = u32::from(self.frame);
        let actuator = |angle: &f64| ActuatorCommand {
            command_id: number,
            flags: SERVO_ENABLE,
            position: degrees::to_wire_angle(*angle),
        };
        let command = Command { frame_id: number, actuators: angles.iter().map(actuator).collect() };
        let message = self.session.post(call::REFRESH, 0, &command)?;
        self.counters.sent += 1;
        self.outstanding.push_back(message);
        if self.outstanding.len() > OUTSTANDING {
            self.outstanding.pop_front();
            self.counters.lost += 1;
        }
        let mut newest = None;
        loop {
            let Some(response) = self.session.next_response(deadline)? else {
                self.counters.missed += 1;
                return Ok(newest);
            };
            if let Some(feedback) = self.take(message, &response)? {
                newest = Some(feedback);
                if response.header.message == message {
                    return Ok(newest);
                }
            }
        }
    }

    /// Processes an answer. Returns its measurements if they are new.
    fn take(&mut self, current: u16, response: &Frame) -> Result<Option<Feedback>, KortexError> {
        let message = response.header.message;
        let Some(place) = self.outstanding.iter().position(|sent| *sent == message) else {
            self.counters.stray += 1;
            return Ok(None);
        };
        self.outstanding.remove(place);
        if let Some(refusal) = Refusal::of(response) {
            return Err(self.session.refused(response.header.call, refusal));
        }
        if message != current {
            self.counters.late += 1;
        }
        if self.newest.is_some_and(|newest| !is_younger(message, newest)) {
            self.counters.out_of_order += 1;
            return Ok(None);
        }
        self.newest = Some(message);
        self.counters.answered += 1;
        self.read(&decode(response)?).map(Some)
    }

    fn read(&mut self, wire: &WireFeedback) -> Result<Feedback, KortexError> {
        let answer = |field, found: String, expected: &str| KortexError::Answer {
            call: call::REFRESH,
            field,
            found,
            expected: expected.to_owned(),
        };
        let joints: &[ActuatorFeedback; JOINTS] = wire
            .actuators
            .as_slice()
            .try_into()
            .map_err(|_| answer("joints", wire.actuators.len().to_string(), "7"))?;
        let base = wire.base.ok_or_else(|| answer("base", "missing".to_owned(), "its measurements"))?;
        let state = ArmState::try_from(base.active_state)
            .map_err(|_| answer("arm state", base.active_state.to_string(), "0 to 10"))?;
        for joint in joints {
            if ![joint.position, joint.velocity, joint.torque].into_iter().all(f32::is_finite) {
                let found = format!("{}, {}, {}", joint.position, joint.velocity, joint.torque);
                return Err(answer("position, velocity, torque", found, "numbers"));
            }
        }
        let banks = |a, b| Banks { a, b };
        Ok(Feedback {
            frame: wire.frame_id as u16,
            state,
            motion: JointMotion {
                position: self.turns.read(joints.map(|joint| joint.position)),
                velocity: joints.map(|joint| degrees::to_radians(joint.velocity)),
                torque: joints.map(|joint| f64::from(joint.torque)),
            },
            current: joints.map(|joint| f64::from(joint.current)),
            temperature: joints.map(|joint| f64::from(joint.motor_temperature)),
            voltage: f64::from(base.arm_voltage),
            faults: Report {
                base: banks(base.fault_bank_a, base.fault_bank_b),
                joints: joints.map(|joint| banks(joint.fault_bank_a, joint.fault_bank_b)),
            },
            warnings: Report {
                base: banks(base.warning_bank_a, base.warning_bank_b),
                joints: joints.map(|joint| banks(joint.warning_bank_a, joint.warning_bank_b)),
            },
        })
    }
}
