//! The Kortex client and the emulated Gen3 in lock-step: each emulated millisecond exchanges one command and one answer
//! over the loopback interface before the next one begins.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hand_model::arm::Arm as ArmModel;
use hand_model::robot::ArmState;
use kinova_kortex::emulator::{Emulator, Injection, Pace, Settings, Status};
use kinova_kortex::joints::JOINTS;
use kinova_kortex::servoing::{Servoing, ServoingLimits};
use kinova_kortex::{Arm, CommandError, KortexError, Timeouts};
use robot_session_log::LinkPacket;

use super::plant_arm::SharedArm;
use crate::arm_link::{ArmLink, ArmLinkError};
use crate::kortex_link::{arm_link_error, arm_state, limits, tap, to_gen3};
use crate::lock::lock;
use crate::safety::checks::ArmReading;
use crate::safety::state::ArmTrouble;

/// Longest wait for an answer on loopback; generous, for busy machines.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(20);
/// Longest wait for a call's answer.
const CALL_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest wait for an answer while answers are dropped on purpose: those that are not dropped come at once.
const LOSSY_ANSWER_TIMEOUT: Duration = Duration::from_millis(3);

enum ClientOrder {
    Engage,
    /// Time to spend on the way to these set-points (rad), ms; the flag is true if answers may be missing.
    Move(u64, [f64; JOINTS], bool),
    /// Measurement during which no time passes; the flag is true if the answer may be missing.
    Measure(bool),
    Disengage,
}

/// The newest measurements, with a flag that is true if they are new, or the reason why servoing ended.
type ClientAnswer = Result<(ArmState, bool), ArmLinkError>;

/// Handle of the client's thread.
struct Client {
    orders: Sender<ClientOrder>,
    answers: Receiver<ClientAnswer>,
    engaged: bool,
    target: Option<[f64; JOINTS]>,
    state: ArmState,
    measured_at: f64,
    fault: Option<ArmLinkError>,
}

impl Client {
    fn ask(&mut self, order: ClientOrder) -> ClientAnswer {
        let gone = || servoing_ended("its client is gone");
        self.orders.send(order).map_err(|_| gone())?;
        self.answers.recv().map_err(|_| gone())?
    }

    fn ask_and_note(&mut self, order: ClientOrder, now: f64) {
        match self.ask(order) {
            Ok((state, fresh)) => {
                self.state = state;
                self.measured_at = if fresh { now } else { self.measured_at };
            }
            Err(error) => self.fault = Some(error),
        }
    }
}

/// An emulated arm and its client, advanced together.
pub struct LockstepArm {
    emulator: Arc<Emulator>,
    client: Option<Arc<Mutex<Client>>>,
    thread: Option<JoinHandle<()>>,
    /// Remainder of a millisecond, s.
    remainder: f64,
    lossy: bool,
    wait_count: Arc<AtomicU64>,
}

impl LockstepArm {
    /// Switches on an arm of this model and logs in. Packets that cross after the login are copied to `packets`.
    ///
    /// # Errors
    /// There is no free port, or the client fails.
    pub fn start(
        joints: SharedArm,
        model: &ArmModel,
        seed: u64,
        packets: Option<&Sender<LinkPacket>>,
    ) -> Result<Self, KortexError> {
        let near = joints.state().position;
        let settings = Settings { seed, ..Settings::default() };
        let credentials = settings.credentials.clone();
        let emulator = Emulator::start(settings, Box::new(joints), Pace::Stepped)
            .map_err(|error| KortexError::Link(error.into()))?;
        let emulator = Arc::new(emulator);
        // Many emulated seconds may pass between two keep-alives of the host. A keep-alive at a time of the host's
        // clock would be one more datagram for which a lossy network draws a random number.
        let hour = Duration::from_secs(3600);
        let timeouts = Timeouts { call: CALL_TIMEOUT, session: hour, connection: hour, keep_alive: hour };
        let mut arm = Arm::connect(emulator.address(), &credentials, timeouts, to_gen3(&near))?;
        if let Some(packets) = packets {
            tap(&mut arm, packets);
        }
        let state = arm_state(arm.cyclic.feedback()?.motion);
        let (orders, inbox) = mpsc::channel();
        let (outbox, answers) = mpsc::channel();
        let waited = Arc::new(AtomicU64::new(0));
        let (for_thread, counter) = (emulator.clone(), waited.clone());
        let limits = limits(model);
        let thread = std::thread::spawn(move || serve(arm, limits, &for_thread, (&inbox, &outbox), &counter));
        let client = Client { orders, answers, engaged: false, target: None, state, measured_at: 0.0, fault: None };
        let client = Some(Arc::new(Mutex::new(client)));
        Ok(Self { emulator, client, thread: Some(thread), remainder: 0.0, lossy: false, wait_count: waited })
    }

    /// Returns the bridge's end of the link.
    pub fn link(&self) -> LockstepLink {
        LockstepLink { client: self.client.as_ref().map(Arc::downgrade).unwrap_or_default() }
    }

    /// Returns the status of the emulated arm.
    pub fn status(&self) -> Status {
        self.emulator.status()
    }

    /// Injects a fault of the arm or its network.
    pub fn inject(&mut self, injection: Injection) {
        let lossy = matches!(injection, Injection::Deaf(_) | Injection::LoseReplies(_) | Injection::LoseCommands(_));
        self.lossy |= lossy || matches!(injection, Injection::DelayReplies(_));
        self.emulator.inject(injection);
    }

    /// Returns the number of cycles in which the client waited because the arm lagged too far behind.
    pub fn wait_count(&self) -> u64 {
        self.wait_count.load(Ordering::Relaxed)
    }

    /// Lets `seconds` pass until `now` (s). If the host is dead, the arm gets no commands.
    pub fn advance(&mut self, seconds: f64, now: f64, host_alive: bool) {
        let milliseconds = whole_milliseconds(&mut self.remainder, seconds);
        let Some(client) = self.client.as_ref().filter(|_| host_alive) else {
            self.emulator.step(milliseconds);
            return;
        };
        let mut client = lock(client);
        match client.target.filter(|_| client.engaged && client.fault.is_none()) {
            Some(target) => client.ask_and_note(ClientOrder::Move(milliseconds, target, self.lossy), now),
            None => {
                self.emulator.step(milliseconds);
                if !client.engaged {
                    client.measured_at = now;
                }
            }
        }
    }

    /// Measures the arm at `now` (s): the plant has moved since its last command.
    pub fn measure(&mut self, now: f64) {
        let Some(client) = &self.client else { return };
        let mut client = lock(client);
        if client.engaged && client.fault.is_none() {
            client.ask_and_note(ClientOrder::Measure(self.lossy), now);
        }
    }
}

impl Drop for LockstepArm {
    fn drop(&mut self) {
        // Otherwise the client would wait for the answer to its farewell.
        self.emulator.inject(Injection::Deaf(false));
        self.client = None;
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

/// The bridge's end of the lock-step arm.
pub struct LockstepLink {
    client: Weak<Mutex<Client>>,
}

impl LockstepLink {
    fn client(&self) -> Result<Arc<Mutex<Client>>, ArmLinkError> {
        self.client.upgrade().ok_or_else(|| servoing_ended("the emulated arm is switched off"))
    }
}

impl ArmLink for LockstepLink {
    fn read(&mut self, _now: f64) -> Result<ArmReading, ArmLinkError> {
        let client = self.client()?;
        let client = lock(&client);
        Ok(ArmReading {
            received_at: client.measured_at,
            state: client.state,
            fault: client.fault.as_ref().map(|fault| fault.trouble),
        })
    }

    fn engage(&mut self) -> Result<(), ArmLinkError> {
        let client = self.client()?;
        let mut client = lock(&client);
        let (state, _) = client.ask(ClientOrder::Engage)?;
        (client.state, client.engaged, client.target) = (state, true, None);
        Ok(())
    }

    fn command(&mut self, set_points: &[f64]) -> Result<(), ArmLinkError> {
        let client = self.client()?;
        let mut client = lock(&client);
        if let Some(fault) = &client.fault {
            return Err(fault.clone());
        }
        client.target = Some(to_gen3(set_points));
        Ok(())
    }

    fn disengage(&mut self) -> Result<(), ArmLinkError> {
        let client = self.client()?;
        let mut client = lock(&client);
        client.engaged = false;
        client.ask(ClientOrder::Disengage).map(drop)
    }
}

/// Runs the client's thread: owns the arm, enters and leaves low-level servoing, and cycles.
fn serve(
    mut arm: Arm,
    limits: ServoingLimits,
    emulator: &Emulator,
    (orders, answers): (&Receiver<ClientOrder>, &Sender<ClientAnswer>),
    waited: &AtomicU64,
) {
    while let Ok(order) = orders.recv() {
        let answer = match order {
            ClientOrder::Engage => match Servoing::enter(&mut arm, limits) {
                Ok(servoing) => {
                    if answers.send(Ok((arm_state(servoing.latest().motion), true))).is_err() {
                        return;
                    }
                    run_orders(servoing, emulator, orders, answers, waited)
                }
                Err(error) => Err(arm_link_error(&error)),
            },
            ClientOrder::Move(milliseconds, ..) => {
                emulator.step(milliseconds);
                Err(ArmLinkError::unready())
            }
            ClientOrder::Measure(_) => Err(ArmLinkError::unready()),
            ClientOrder::Disengage => Ok((ArmState::default(), false)),
        };
        if answers.send(answer).is_err() {
            return;
        }
    }
}

/// Carries out orders until servoing is over; returns the last answer.
fn run_orders(
    mut servoing: Servoing<'_>,
    emulator: &Emulator,
    orders: &Receiver<ClientOrder>,
    answers: &Sender<ClientAnswer>,
    waited: &AtomicU64,
) -> ClientAnswer {
    loop {
        let Ok(order) = orders.recv() else { return Err(servoing_ended("servoing is over")) };
        let answer = match order {
            ClientOrder::Engage => Ok((arm_state(servoing.latest().motion), true)),
            ClientOrder::Disengage => {
                let state = arm_state(servoing.latest().motion);
                return servoing.leave().map(|()| (state, true)).map_err(|error| arm_link_error(&error));
            }
            ClientOrder::Move(milliseconds, target, lossy) => {
                move_to_target(&mut servoing, emulator, (milliseconds, target, lossy), waited)
            }
            ClientOrder::Measure(lossy) => {
                servoing.hold(deadline(lossy)).map(|fresh| (arm_state(servoing.latest().motion), fresh))
            }
        };
        match answer {
            Ok(answer) if answers.send(Ok(answer)).is_err() => return Err(servoing_ended("servoing is over")),
            Ok(_) => {}
            Err(error) => return Err(arm_link_error(&error)),
        }
    }
}

fn servoing_ended(text: &str) -> ArmLinkError {
    ArmLinkError { trouble: ArmTrouble::Closed, text: text.to_owned() }
}

/// Returns the deadline of an answer.
fn deadline(lossy: bool) -> Instant {
    Instant::now() + if lossy { LOSSY_ANSWER_TIMEOUT } else { ANSWER_TIMEOUT }
}

/// Returns the whole milliseconds in `seconds` and in the remainder from before; `rest` (s) becomes the new remainder.
pub(super) fn whole_milliseconds(rest: &mut f64, seconds: f64) -> u64 {
    *rest += seconds;
    let milliseconds = (*rest * 1e3 + 1e-9).floor();
    *rest -= milliseconds * 1e-3;
    milliseconds as u64
}

/// Returns the next of `left` equal steps from `from` to `target`, none longer than `most`, rad.
pub(super) fn step_towards(target: &[f64], from: &[f64], left: u64, most: &[f64]) -> [f64; JOINTS] {
    std::array::from_fn(|i| from[i] + ((target[i] - from[i]) / left as f64).clamp(-most[i], most[i]))
}

/// Moves to the target in equal steps, one per millisecond.
fn move_to_target(
    servoing: &mut Servoing<'_>,
    emulator: &Emulator,
    (milliseconds, target, lossy): (u64, [f64; JOINTS], bool),
    waited: &AtomicU64,
) -> Result<(ArmState, bool), KortexError> {
    let mut fresh = false;
    for n in 0..milliseconds {
        let next = step_towards(&target, servoing.command(), milliseconds - n, &servoing.limits().step);
        let deadline = deadline(lossy);
        let result = match servoing.command_angles(&next, deadline) {
            Err(KortexError::Command(CommandError::Lead { .. })) => {
                waited.fetch_add(1, Ordering::Relaxed);
                servoing.hold(deadline)
            }
            result => result,
        };
        emulator.step(1);
        match result {
            Ok(new) => fresh |= new,
            Err(error) => {
                emulator.step(milliseconds - n - 1);
                return Err(error);
            }
        }
    }
    Ok((arm_state(servoing.latest().motion), fresh))
}
