//! The emulated arm's base: state, faults, watchdogs, time.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::fault_injection::{Injection, NetworkFaults};
use super::peer::{Outgoing, Peer};
use super::plant::{Drive, Plant};
use super::playing::Playing;
use super::refusals::{IN_EMERGENCY_STOP, IN_FAULT, MANUAL_STOP};
use super::sessions::Sessions;
use super::subscription::Subscription;
use crate::frame::{Frame, FrameKind};
use crate::joints::{JOINTS, JointMotion};
use crate::message::ArmState;
use crate::message::action::ActionNotification;
use crate::message::base::ServoingMode;
use crate::message::device::ControlMode;
use crate::safety_bank::{self, Report};
use crate::session::Credentials;

/// Length of a tick, s.
const TICK: f64 = 1e-3;

/// Settings of an emulated arm.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The only user and password that may log in. Default: `admin`, `admin`.
    pub credentials: Credentials,
    /// Watchdog timeout: time without a cyclic command after which the arm stops, ms.
    pub cyclic_deadline: u64,
    /// Following error threshold: distance between command and joint, rad.
    pub following_error: f64,
    /// Standstill threshold of a joint, rad/s.
    pub standstill: f64,
    /// Seed of the random draws: lost and delayed datagrams.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            credentials: Credentials { user: "admin".to_owned(), password: "admin".to_owned() },
            cyclic_deadline: 50,
            following_error: 5_f64.to_radians(),
            standstill: 1e-3,
            seed: 1,
        }
    }
}

/// Kind of event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EventKind {
    /// A host logged in.
    SessionOpened(u16),
    /// A host logged out.
    SessionClosed(u16),
    /// A session ended after a timeout.
    SessionExpired(u16),
    /// The servoing mode changed.
    Mode(ServoingMode),
    /// Commands stopped coming, and the watchdog stopped the arm.
    Watchdog,
    /// Faults were raised.
    Fault,
    /// Faults were cleared.
    Cleared,
    /// All joints came to a standstill.
    StandsStill,
}

/// An event with its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Time since the arm was switched on, ms.
    pub time: u64,
    /// Kind of the event.
    pub what: EventKind,
}

/// Statistics of the cyclic commands since low-level servoing was last entered.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Commands {
    /// Number of commands followed.
    pub followed: u64,
    /// Time of the last command, ms.
    pub last: u64,
    /// Largest distance of the first command from the joints, rad.
    pub seed_error: f64,
    /// Largest step of each joint from one command to the next, rad. If commands between were lost, the step is divided
    /// among them.
    pub largest_step: [f64; JOINTS],
}

/// State of the emulated arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// Time since the arm was switched on, ms.
    pub time: u64,
    /// Operating state, as the arm reports it.
    pub state: ArmState,
    /// Servoing mode: who moves the arm.
    pub mode: ServoingMode,
    /// Motion of the joints.
    pub motion: JointMotion,
    /// Active faults.
    pub faults: Report,
    /// Open sessions.
    pub sessions: Vec<u16>,
    /// Statistics of the cyclic commands.
    pub commands: Commands,
    /// All events so far.
    pub events: Vec<Event>,
}

/// The arm's base, without sockets or clock.
///
/// # Example
/// ```
/// use kinova_kortex::emulator::{Controller, FirstOrderJoints, Peer, Settings};
/// use kinova_kortex::frame::{Frame, FrameKind, Header};
/// use kinova_kortex::call;
///
/// let mut arm = Controller::new(Settings::default(), Box::new(FirstOrderJoints::gen3()));
/// let (kind, call) = (FrameKind::Request, call::GET_ARM_STATE);
/// let header = Header { kind, device: 0, error: 0, sub_error: 0, session: 1, message: 7, call };
/// let answers = arm.receive(Peer::Tcp(1), &Frame { header, payload: Vec::new() });
/// // Nobody is logged in.
/// assert_ne!(answers[0].1.header.error, 0);
/// arm.tick();
/// assert_eq!(arm.status().time, 1);
/// ```
pub struct Controller {
    pub(super) settings: Settings,
    pub(super) plant: Box<dyn Plant>,
    pub(super) time: u64,
    pub(super) mode: ServoingMode,
    pub(super) drive: Drive,
    pub(super) faults: Report,
    pub(super) emergency_stop_pressed: bool,
    lasting_faults: u32,
    pub(super) control_modes: [i32; JOINTS],
    pub(super) sessions: Sessions,
    pub(super) in_control: Option<u16>,
    pub(super) subscriptions: Vec<Subscription>,
    /// Number of the last command followed, and its angles, rad.
    pub(super) last_command: Option<(u16, [f64; JOINTS])>,
    pub(super) commands: Commands,
    network: NetworkFaults,
    random: ChaCha8Rng,
    delayed: Vec<(u64, Outgoing)>,
    pub(super) playing: Option<Playing>,
    /// Action events that were not announced yet.
    pub(super) action_events: Vec<ActionNotification>,
    pub(super) announced: (ArmState, ServoingMode),
    moving: bool,
    events: Vec<Event>,
}

impl Controller {
    /// Creates an arm at rest and ready, with nobody logged in.
    pub fn new(settings: Settings, plant: Box<dyn Plant>) -> Self {
        let random = ChaCha8Rng::seed_from_u64(settings.seed);
        Self {
            settings,
            plant,
            time: 0,
            mode: ServoingMode::SingleLevel,
            drive: Drive::Hold,
            faults: Report::default(),
            emergency_stop_pressed: false,
            lasting_faults: 0,
            control_modes: [ControlMode::Position as i32; JOINTS],
            sessions: Sessions::default(),
            in_control: None,
            subscriptions: Vec::new(),
            last_command: None,
            commands: Commands::default(),
            network: NetworkFaults::default(),
            random,
            delayed: Vec::new(),
            playing: None,
            action_events: Vec::new(),
            announced: (ArmState::ServoingReady, ServoingMode::SingleLevel),
            moving: false,
            events: Vec::new(),
        }
    }

    /// Returns the state of the emulated arm.
    pub fn status(&self) -> Status {
        Status {
            time: self.time,
            state: self.state(),
            mode: self.mode,
            motion: self.motion(),
            faults: self.faults,
            sessions: self.sessions.numbers(),
            commands: self.commands,
            events: self.events.clone(),
        }
    }

    pub(super) fn motion(&self) -> JointMotion {
        self.plant.state()
    }

    pub(super) fn state(&self) -> ArmState {
        match (self.faults.is_empty(), self.mode, self.drive) {
            (false, ..) => ArmState::InFault,
            (_, ServoingMode::LowLevel, _) => ArmState::ServoingLowLevel,
            _ if self.playing.is_some() => ArmState::ServoingPlayingSequence,
            (_, _, Drive::Velocity(_)) => ArmState::ServoingManuallyControlled,
            _ => ArmState::ServoingReady,
        }
    }

    pub(super) fn log(&mut self, what: EventKind) {
        self.events.push(Event { time: self.time, what });
    }

    /// Handles a frame from `peer`. Returns the frames to send.
    pub fn receive(&mut self, peer: Peer, frame: &Frame) -> Vec<Outgoing> {
        let over_udp = matches!(peer, Peer::Udp(_));
        if self.network.deaf || over_udp && self.network.loses_command(&mut self.random) {
            return Vec::new();
        }
        let answer = (frame.header.kind == FrameKind::Request).then(|| (peer, self.answer(peer, frame)));
        let mut outgoing: Vec<Outgoing> = answer.into_iter().collect();
        if over_udp {
            outgoing.retain(|_| !self.network.loses_reply(&mut self.random));
            if self.network.delay > 0 {
                let due =
                    outgoing.drain(..).map(|outgoing| (self.time + self.network.delay(&mut self.random), outgoing));
                self.delayed.extend(due);
            }
        }
        outgoing.extend(self.announce());
        outgoing
    }

    /// Advances by a millisecond. Returns the frames to send.
    pub fn tick(&mut self) -> Vec<Outgoing> {
        self.time += 1;
        self.play();
        self.plant.advance(&self.drive, TICK);
        self.watch_following();
        self.watch_commands();
        for session in self.sessions.expire(self.time) {
            self.log(EventKind::SessionExpired(session));
            self.session_ended(session);
        }
        self.watch_standstill();
        let mut outgoing: Vec<Outgoing> =
            self.delayed.extract_if(.., |(due, _)| *due <= self.time).map(|(_, outgoing)| outgoing).collect();
        outgoing.extend(self.announce());
        if self.network.deaf { Vec::new() } else { outgoing }
    }

    /// Injects a fault. Returns the frames to send.
    pub fn inject(&mut self, injection: Injection) -> Vec<Outgoing> {
        match injection {
            Injection::BaseFault(bits) => self.raise(bits, [0; JOINTS]),
            Injection::LastingBaseFault(bits) => {
                self.lasting_faults = bits;
                if bits != 0 {
                    self.raise(bits, [0; JOINTS]);
                }
            }
            Injection::JointFault { joint, bits } => {
                self.raise(0, std::array::from_fn(|i| if i == joint { bits } else { 0 }));
            }
            Injection::EmergencyStop(pressed) => {
                self.emergency_stop_pressed = pressed;
                if pressed {
                    self.emergency_stop();
                }
            }
            Injection::LoseCommands(share) => self.network.lose_commands = share,
            Injection::LoseReplies(share) => self.network.lose_replies = share,
            Injection::DelayReplies(longest) => self.network.delay = longest,
            Injection::Deaf(deaf) => self.network.deaf = deaf,
            Injection::ForgetSessions => {
                for session in self.sessions.forget() {
                    self.session_ended(session);
                }
            }
            Injection::ControlMode { joint, mode } => self.control_modes[joint] = mode,
        }
        self.announce()
    }

    pub(super) fn clear_faults(&mut self) {
        if self.faults.is_empty() {
            return;
        }
        self.faults = Report::default();
        self.log(EventKind::Cleared);
        self.set_mode(ServoingMode::SingleLevel);
        if self.lasting_faults != 0 {
            self.raise(self.lasting_faults, [0; JOINTS]);
        }
    }

    pub(super) fn emergency_stop(&mut self) {
        self.raise(safety_bank::EMERGENCY_STOP, [0; JOINTS]);
        self.set_mode(ServoingMode::SingleLevel);
    }

    pub(super) fn set_mode(&mut self, mode: ServoingMode) {
        self.abort_action(MANUAL_STOP);
        if self.mode != mode {
            self.mode = mode;
            self.log(EventKind::Mode(mode));
        }
        self.drive = Drive::Hold;
        if mode == ServoingMode::LowLevel {
            self.last_command = None;
            self.commands = Commands { last: self.time, ..Commands::default() };
        }
    }

    /// Adds fault bits and stops the arm.
    fn raise(&mut self, base: u32, joints: [u32; JOINTS]) {
        self.drive = Drive::Hold;
        let joint_fault = if joints == [0; JOINTS] { 0 } else { safety_bank::JOINT_FAULT };
        self.faults.base.a |= base | joint_fault;
        for (banks, bits) in self.faults.joints.iter_mut().zip(joints) {
            banks.a |= bits;
        }
        self.abort_action(if self.faults.is_emergency_stop() { IN_EMERGENCY_STOP } else { IN_FAULT });
        self.log(EventKind::Fault);
    }

    pub(super) fn session_ended(&mut self, session: u16) {
        self.subscriptions.retain(|subscription| subscription.session != session);
        if self.in_control == Some(session) {
            self.in_control = None;
            self.set_mode(ServoingMode::SingleLevel);
        }
    }

    fn watch_following(&mut self) {
        let Drive::Position(command) = self.drive else { return };
        let position = self.motion().position;
        let late = |i: usize| (command[i] - position[i]).abs() > self.settings.following_error;
        let bits = std::array::from_fn(|i| if late(i) { safety_bank::FOLLOWING_ERROR } else { 0 });
        if bits != [0; JOINTS] {
            self.raise(0, bits);
        }
    }

    fn watch_commands(&mut self) {
        let silent = self.time - self.commands.last > self.settings.cyclic_deadline;
        if silent && self.mode == ServoingMode::LowLevel && self.faults.is_empty() {
            self.log(EventKind::Watchdog);
            self.raise(0, [safety_bank::WATCHDOG; JOINTS]);
        }
    }

    fn watch_standstill(&mut self) {
        let moves = self.motion().velocity.iter().any(|speed| speed.abs() > self.settings.standstill);
        if self.moving && !moves {
            self.log(EventKind::StandsStill);
        }
        self.moving = moves;
    }
}
