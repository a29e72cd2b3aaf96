//! The real robot as a [`RobotBackend`].
//!
//! [`HardwareRobot::connect`] opens the devices and compares them with the calibration, [`HardwareRobot::check`] checks
//! every measurement, and [`HardwareRobot::arm`] enables torque; before that, commands move nothing. A dropped robot
//! keeps holding: only an explicit release opens the hand.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Arc, MutexGuard, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::BusError;
use ftac_platform::data::DataError;
use hand_model::RobotModel;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, Tick};
use robot_session_log::{LinkPacket, LinkTap};

use crate::arm_link::ArmLink;
use crate::bus_link::{BusLink, open_hand};
use crate::calibration::HandCalibration;
use crate::cameras::{Cameras, CamerasError};
use crate::clock::Clock;
use crate::config::{BridgeConfig, ConfigError};
use crate::delivered_images::DeliveredImages;
use crate::lock::lock;
use crate::real_time::set_real_time_priority;
use crate::remote::endpoint::RemoteEndpoint;
use crate::remote::{RemoteCommand, RemoteError};
use crate::requests;
use crate::robot_link::RobotLink;
use crate::safety::limits::SafetyLimits;
use crate::safety::set_points::TICK;
use crate::safety::state::SupervisorState;
use crate::safety::supervisor::SafeCommand;
use crate::servo_cycle::{CycleOrder, CycleReport, CycleShared, DryLines, Pace, ServoCycle, SharedState, send_order};
use crate::stop_sockets::StopSockets;
use crate::supported_robot::check_supported;
use crate::tactile_link::TactileLink;

/// Longest wait for the answer of this project's devices to an order.
const ORDER_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest wait for the cycle that uses a command: a few cycles, or their time-outs on a bus that is being lost.
const MIN_SEND_TIMEOUT: Duration = Duration::from_millis(50);

/// Error of connecting to the robot.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The bridge does not drive this robot.
    #[error(transparent)]
    Model(#[from] DataError),
    /// Error of the configuration or the calibration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Error of the servo bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    #[error(transparent)]
    Cameras(#[from] CamerasError),
    /// Error of the remote stop.
    #[error(transparent)]
    Remote(#[from] RemoteError),
    /// A servo is not set up as it should be.
    #[error("{what}: found {found}, expected {expected}: see `ftac bridge doctor`")]
    Setup {
        /// Item that was checked.
        what: String,
        found: String,
        expected: String,
    },
    /// The hand is not the calibrated one.
    #[error("{name}: found homing offset {found}, expected the calibration's {expected}: {why}")]
    Mismatch {
        /// Index of the actuator.
        actuator: usize,
        /// Name of the actuator.
        name: String,
        /// Possible explanation.
        why: String,
        /// Homing offset in the servo, counts.
        found: i64,
        /// Homing offset in the calibration, counts.
        expected: i64,
    },
    /// A thread could not be started.
    #[error("thread: {0}")]
    Thread(std::io::Error),
}

/// A refused order.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct OrderError(pub String);

/// The connected robot.
pub struct HardwareRobot {
    shared: Arc<CycleShared>,
    cameras: Option<Cameras>,
    endpoints: Vec<RemoteEndpoint>,
    release_time: f64,
    /// Error of the last request for images, reported by the next observation.
    capture_error: Option<RobotError>,
    thread: Option<JoinHandle<()>>,
    clock: Clock,
    /// True if time passes with the controller's ticks only.
    lockstep: bool,
    send_timeout: Duration,
    next_tick: Instant,
    sequence: u64,
}

/// Passage of time of a robot behind a [`RobotLink`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LinkTiming {
    /// On the wall clock, with this rate of the servo cycles, Hz.
    Wall { rate: f64 },
    /// In lock-step: with the controller's ticks only.
    Lockstep,
}

/// Settings of a robot behind a [`RobotLink`].
#[derive(Debug, Clone)]
pub struct LinkSettings<'a> {
    pub limits: SafetyLimits,
    pub timing: LinkTiming,
    /// Images that the link delivers, if the robot has cameras.
    pub images: Option<DeliveredImages>,
    /// File after which the robot's stop socket is named.
    pub file: &'a Path,
    /// Longest wait until the devices are checked, or their torque is on.
    pub order_timeout: Duration,
}

impl HardwareRobot {
    /// Opens the devices and verifies that they are the calibrated ones; torque stays as it is. With `dry` (a dry run),
    /// nothing is ever written to a device, and the goals are reported there instead.
    pub fn connect(
        config: &BridgeConfig,
        arm: Box<dyn ArmLink>,
        robot: &RobotModel,
        dry: Option<DryLines>,
    ) -> Result<Self, ConnectError> {
        check_supported(robot)?;
        let calibration = HandCalibration::read(&config.calibration)?;
        let clock = Clock::wall();
        let hand = open_hand(config, &calibration, robot)?;
        let cameras = Cameras::open(config, robot.hand.cameras.len(), &clock)?;
        let limits = config.limits(&calibration.travel(), &robot.arm);
        let link = BusLink::new(config, hand, arm);
        let cycle = ServoCycle { dry, ..ServoCycle::new(link, robot, limits, clock, ORDER_TIMEOUT) };
        // A configuration that was not read from a file is named after its port.
        let file = if config.file.as_os_str().is_empty() { &config.servos.port } else { &config.file };
        let sockets = StopSockets { file, additional: config.stop_socket.as_deref() };
        let pace = Pace::Wall(Duration::from_secs_f64(1.0 / config.servos.rate));
        Self::run(cycle, pace, cameras, limits.release_time, Some(sockets))
    }

    /// Connects the devices behind `link`, which are those of `robot`; torque stays as it is.
    pub fn start(
        link: impl RobotLink + 'static,
        robot: &RobotModel,
        settings: LinkSettings,
    ) -> Result<Self, ConnectError> {
        let LinkSettings { limits, timing, images, file, order_timeout } = settings;
        let cameras = images.map(Cameras::Delivered);
        let release_time = limits.release_time;
        let new = |clock| ServoCycle::new(link, robot, limits, clock, order_timeout);
        match timing {
            LinkTiming::Lockstep => {
                Self::run(new(Clock::emulated()), Pace::Lockstep(TICK), cameras, release_time, None)
            }
            LinkTiming::Wall { rate } => {
                let pace = Pace::Wall(Duration::from_secs_f64(1.0 / rate));
                let sockets = StopSockets { file, additional: None };
                Self::run(new(Clock::wall()), pace, cameras, release_time, Some(sockets))
            }
        }
    }

    /// Runs `cycle` in a thread of its own.
    fn run<L: RobotLink + 'static>(
        cycle: ServoCycle<L>,
        pace: Pace,
        cameras: Option<Cameras>,
        release_time: f64,
        sockets: Option<StopSockets>,
    ) -> Result<Self, ConnectError> {
        let (shared, clock) = (cycle.shared.clone(), cycle.clock.clone());
        let endpoints =
            sockets.map(|sockets| sockets.open(&shared, &clock, release_time)).transpose()?.unwrap_or_default();
        let thread = std::thread::Builder::new()
            .name("servo cycle".into())
            .spawn(move || {
                let mut cycle = cycle;
                if matches!(pace, Pace::Wall(_)) {
                    cycle.report.priority_error = set_real_time_priority().err();
                }
                cycle.run(pace);
            })
            .map_err(ConnectError::Thread)?;
        Ok(Self {
            shared,
            cameras,
            endpoints,
            release_time,
            capture_error: None,
            thread: Some(thread),
            clock,
            lockstep: matches!(pace, Pace::Lockstep(_)),
            send_timeout: match pace {
                Pace::Wall(period) => MIN_SEND_TIMEOUT.max(3 * period),
                Pace::Lockstep(_) => MIN_SEND_TIMEOUT,
            },
            next_tick: Instant::now(),
            sequence: 0,
        })
    }

    /// Checks the newest measurements; the robot may be armed once they pass.
    pub fn check(&self) -> Result<(), OrderError> {
        self.order(CycleOrder::Check)
    }

    /// Enables torque at the present positions, with zero force. Requires the consent of an operator.
    pub fn arm(&self) -> Result<(), OrderError> {
        self.order(CycleOrder::Arm)
    }

    /// Stops and holds.
    pub fn hold(&self) -> Result<(), OrderError> {
        self.order(CycleOrder::Remote(RemoteCommand::Hold))
    }

    /// Fades the currents, disables torque, and reads back whether it is off. Returns for how many servos it is, in
    /// words.
    pub fn release(&self) -> Result<String, OrderError> {
        requests::execute_request(&self.shared, &self.clock, RemoteCommand::Release, self.release_time)
            .map_err(OrderError)
    }

    /// Describes the measured state in words: whether the arm is at rest, and how many servos answer.
    pub fn describe_state(&self) -> String {
        requests::describe_state(&lock(&self.shared.state), self.now())
    }

    /// Returns the sockets on which another terminal can stop this robot.
    pub fn stop_sockets(&self) -> impl Iterator<Item = &Path> {
        self.endpoints.iter().map(RemoteEndpoint::path)
    }

    /// Announces a pause: no command will come for up to `seconds`. The arm stands still, the hand keeps its last
    /// goals, and the controller's watchdog is suspended. The next command ends the pause.
    pub fn pause(&self, seconds: f64) {
        lock(&self.shared.state).quiet_until = self.now() + seconds;
    }

    pub fn state(&self) -> SupervisorState {
        lock(&self.shared.state).state
    }

    /// Returns the statistics of the servo cycles.
    pub fn report(&self) -> CycleReport {
        lock(&self.shared.state).report.clone()
    }

    /// Copies the bytes on the servo bus to `packets` from the next cycle on, under the name `servos`.
    pub fn tap(&self, packets: &mpsc::Sender<LinkPacket>) {
        *lock(&self.shared.tap) = Some(LinkTap::new("servos", packets.clone()));
    }

    /// Returns the link to the camera board, if there is one.
    pub fn tactile(&self) -> Option<&TactileLink> {
        self.cameras.as_ref().and_then(Cameras::board)
    }

    /// Returns the cameras, if there are any.
    pub fn cameras(&self) -> Option<&Cameras> {
        self.cameras.as_ref()
    }

    fn order(&self, order: CycleOrder) -> Result<(), OrderError> {
        send_order(&self.shared, order).map(drop).map_err(OrderError)
    }

    fn now(&self) -> f64 {
        self.clock.now()
    }

    /// Waits for the servo cycle while `waits` is true, and returns the shared state; none after the time-out. A robot
    /// in lock-step, whose link has time limits of its own, is waited for as long as its thread lives.
    fn wait_for_cycle<'a>(
        &self,
        board: MutexGuard<'a, SharedState>,
        waits: impl Fn(&SharedState) -> bool,
    ) -> Option<MutexGuard<'a, SharedState>> {
        self.shared.requested.notify_all();
        let mut board = board;
        loop {
            let waited = self.shared.cycle_done.wait_timeout_while(board, self.send_timeout, |board| waits(board));
            let (next, waited) = waited.unwrap_or_else(PoisonError::into_inner);
            if !waited.timed_out() {
                return Some(next);
            }
            if !self.lockstep || self.thread.as_ref().is_none_or(JoinHandle::is_finished) {
                return None;
            }
            board = next;
        }
    }
}

impl RobotBackend for HardwareRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        match self.capture_error.take() {
            Some(error) => Err(error),
            None => Ok(newest_readings(&self.shared, self.cameras.as_ref(), self.now(), self.sequence)),
        }
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        if let (true, Some(cameras)) = (command.capture, &self.cameras) {
            self.capture_error =
                cameras.request_capture().err().map(|error| RobotError::CaptureFailed(error.to_string()));
        }
        let now = self.now();
        let mut board = lock(&self.shared.state);
        board.requested = Some((*command, now));
        board.quiet_until = 0.0;
        board.requested_number += 1;
        let number = board.requested_number;
        match self.wait_for_cycle(board, |board| board.used_number < number) {
            Some(board) => Ok(sent_command(command, &board.sent, board.state)),
            None => Err(RobotError::NotSent(self.send_timeout.as_secs_f64())),
        }
    }

    fn wait_for_tick(&mut self) -> Tick {
        if self.lockstep {
            let mut board = lock(&self.shared.state);
            board.requested_ticks += 1;
            let number = board.requested_ticks;
            drop(self.wait_for_cycle(board, |board| board.ticks < number));
            self.sequence += 1;
            return Tick { time: self.now(), lateness: 0.0 };
        }
        let tick = Duration::from_secs_f64(TICK);
        self.next_tick += tick;
        let now = Instant::now();
        let lateness = now.saturating_duration_since(self.next_tick);
        if lateness > tick {
            self.next_tick = now;
        }
        std::thread::sleep(self.next_tick.saturating_duration_since(now));
        self.sequence += 1;
        Tick { time: self.now(), lateness: lateness.as_secs_f64() }
    }

    fn tick_length(&self) -> f64 {
        TICK
    }
}

/// Returns the newest measurements that have arrived.
pub(crate) fn newest_readings(shared: &CycleShared, cameras: Option<&Cameras>, time: f64, sequence: u64) -> Readings {
    let frames = cameras.map(Cameras::take_images).unwrap_or_default();
    let mut board = lock(&shared.state);
    board.cameras = cameras.is_none_or(|cameras| cameras.failure().is_none());
    board.measured.readings(time, sequence, frames)
}

/// Converts the command that was sent to the kinds of goal that were requested, if the command was followed.
pub(crate) fn sent_command(asked: &RobotCommand, sent: &SafeCommand, state: SupervisorState) -> RobotCommand {
    let mut sent = sent.as_command(asked.capture);
    if state == SupervisorState::Running {
        for (goal, asked) in sent.servos.iter_mut().zip(&asked.servos) {
            if let (ServoGoal::Current(asked), ServoGoal::Position { current_limit, .. }) = (asked, *goal) {
                *goal = ServoGoal::Current(current_limit.copysign(*asked));
            }
        }
    }
    sent
}

impl Drop for HardwareRobot {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        // A thread that waits for a request has not yet seen the flag, or sees it before it waits.
        drop(lock(&self.shared.state));
        self.shared.requested.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic is reported by the thread's own panic message.
            let _ = thread.join();
        }
    }
}
