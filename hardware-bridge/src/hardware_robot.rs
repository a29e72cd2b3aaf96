//! The real robot as a [`RobotBackend`].
//!
//! [`HardwareRobot::connect`] opens the devices and compares them with the calibration, [`HardwareRobot::check`] checks
//! every measurement, and [`HardwareRobot::arm`] enables torque; before that, commands move nothing. A dropped robot
//! keeps holding: only an explicit release opens the hand.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::{BusError, ServoBus};
use ftac_platform::data::DataError;
use hand_model::RobotModel;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, Tick};
use robot_session_log::{LinkPacket, LinkTap};

use crate::arm_link::ArmLink;
use crate::calibration::HandCalibration;
use crate::cameras::{Cameras, CamerasError};
use crate::clock::Clock;
use crate::config::{BridgeConfig, ConfigError};
use crate::hand_bus::HandBus;
use crate::lock::lock;
use crate::real_time::set_real_time_priority;
use crate::remote::endpoint::{RemoteEndpoint, RequestHandler};
use crate::remote::{RemoteCommand, RemoteError, socket_paths};
use crate::requests;
use crate::safety::checks::Measurements;
use crate::safety::limits::{SafeGoal, SafetyLimits};
use crate::safety::set_points::TICK;
use crate::safety::state::SupervisorState;
use crate::safety::supervisor::{SafeCommand, Supervisor};
use crate::servo_cycle::{CycleOrder, CycleReport, CycleShared, DryLines, ServoCycle, SharedState, send_order};
use crate::setup;
use crate::supported_robot::SERVOS;
use crate::supported_robot::check_supported;
use crate::tactile_link::TactileLink;

/// Servo cycles between two audits, each of one servo.
const AUDIT_INTERVAL: u64 = 5;
/// Longest wait for the cycle that uses a command: a few cycles, or their time-outs on a bus that is being lost.
const SEND_TIMEOUT: Duration = Duration::from_millis(50);

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
    next_tick: Instant,
    sequence: u64,
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
        let cycle = servo_cycle(config, &calibration, hand, arm, robot, clock.clone());
        let cycle = ServoCycle { dry, ..cycle };
        let shared = cycle.shared.clone();
        let doors = stop_sockets(config, &shared, &clock)?;
        let thread = std::thread::Builder::new()
            .name("servo cycle".into())
            .spawn(move || {
                let mut cycle = cycle;
                cycle.report.priority_error = set_real_time_priority().err();
                cycle.run();
            })
            .map_err(ConnectError::Thread)?;
        let (release_time, next_tick) = (config.limits.release_time, Instant::now());
        let (thread, unasked) = (Some(thread), None);
        Ok(Self {
            shared,
            cameras,
            endpoints: doors,
            release_time,
            capture_error: unasked,
            thread,
            clock,
            next_tick,
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
}

/// Opens the sockets on which this robot can be stopped: the default one, which any terminal finds, and the configured
/// one.
fn stop_sockets(
    config: &BridgeConfig,
    shared: &Arc<CycleShared>,
    clock: &Clock,
) -> Result<Vec<RemoteEndpoint>, RemoteError> {
    let failed = |source| RemoteError::Socket { path: socket_paths::OPERATORS_FOLDER.into(), source };
    let folder = socket_paths::folder().map_err(failed)?;
    socket_paths::remove_stale_sockets(&folder.path);
    // A configuration that was not read from a file is named after its port.
    let file = if config.file.as_os_str().is_empty() { &config.servos.port } else { &config.file };
    let of = format!("{}, process {}", file.display(), std::process::id());
    let (shared, clock, release_time) = (shared.clone(), clock.clone(), config.limits.release_time);
    let fulfil: Arc<RequestHandler> =
        Arc::new(move |request| requests::execute_request(&shared, &clock, request, release_time));
    let mut doors =
        vec![RemoteEndpoint::open(&socket_paths::socket_path(&folder.path, file), folder.group, &of, fulfil.clone())?];
    if let Some(own) = &config.stop_socket {
        doors.push(RemoteEndpoint::open(own, None, &of, fulfil)?);
    }
    Ok(doors)
}

/// Opens the servo bus and verifies that the servos are the calibrated ones.
pub(crate) fn open_hand(
    config: &BridgeConfig,
    calibration: &HandCalibration,
    robot: &RobotModel,
) -> Result<HandBus, ConnectError> {
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let names: Vec<&str> = robot.hand.parameters.actuator.iter().map(|actuator| actuator.name.as_str()).collect();
    for (id, name) in config.servos.ids.iter().zip(&names) {
        let findings = setup::check(&mut bus, config, *id, name)?;
        if let Some(bad) = findings.into_iter().find(|finding| !finding.passed) {
            return Err(ConnectError::Setup { what: bad.item, found: bad.found, expected: bad.expected });
        }
    }
    let mut hand = HandBus::new(bus, config.servos.ids, config.servos.fast_sync_read);
    if let Some((actuator, found, expected)) = hand.compare_homing_offsets(calibration)? {
        let owner = calibration.servos.iter().zip(&names).find(|(servo, _)| i64::from(servo.homing_offset) == found);
        let why = match owner {
            Some((_, owner)) => format!("it is that of {owner}; were their ids exchanged?"),
            None => "the servo was replaced or remounted; calibrate".to_owned(),
        };
        return Err(ConnectError::Mismatch { actuator, name: names[actuator].to_owned(), why, found, expected });
    }
    Ok(hand)
}

/// Creates the servo cycle of `hand` and `arm`: connected, torque unchanged.
pub(crate) fn servo_cycle(
    config: &BridgeConfig,
    calibration: &HandCalibration,
    hand: HandBus,
    arm: Box<dyn ArmLink>,
    robot: &RobotModel,
    clock: Clock,
) -> ServoCycle {
    let limits = config.limits(&calibration.travel(), &robot.arm);
    let press = limits.torque.filter(|_| arm.senses_torque());
    let mut supervisor = Supervisor::new(SafetyLimits { torque: press, ..limits }).with_monitors(robot);
    // A new supervisor is disconnected, so this cannot be refused.
    let _ = supervisor.connect();
    let measured = Measurements { servos: [None; SERVOS], arm: None, cameras: true };
    let shared = Arc::new(CycleShared {
        tap: Mutex::new(None),
        state: Mutex::new(SharedState {
            requested: None,
            requested_number: 0,
            used_number: 0,
            quiet_until: 0.0,
            sent: SafeCommand { servos: [SafeGoal::default(); SERVOS], arm: limits.arm.zero_speed() },
            measured,
            state: supervisor.state(),
            orders: VecDeque::new(),
            report: CycleReport::default(),
            cameras: true,
        }),
        cycle_done: Condvar::new(),
        stop: AtomicBool::new(false),
    });
    ServoCycle {
        shared,
        hand: Some(hand),
        port: config.servos.port.clone(),
        bus: config.bus(),
        ids: config.servos.ids,
        fast: config.servos.fast_sync_read,
        arm,
        supervisor,
        period: Duration::from_secs_f64(1.0 / config.servos.rate),
        clock,
        audit_interval: AUDIT_INTERVAL,
        dry: None,
        measured,
        report: CycleReport::default(),
        lost_at: Instant::now(),
        last_dry_line: 0.0,
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
        let waited = self.shared.cycle_done.wait_timeout_while(board, SEND_TIMEOUT, |board| board.used_number < number);
        let (board, waited) = waited.unwrap_or_else(std::sync::PoisonError::into_inner);
        if waited.timed_out() {
            return Err(RobotError::NotSent(SEND_TIMEOUT.as_secs_f64()));
        }
        Ok(sent_command(command, &board.sent, board.state))
    }

    fn wait_for_tick(&mut self) -> Tick {
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
        if let Some(thread) = self.thread.take() {
            // A panic is reported by the thread's own panic message.
            let _ = thread.join();
        }
    }
}
