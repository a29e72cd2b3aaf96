//! The whole bridge on emulated devices in lock-step: real bytes on pseudo-terminals and loopback sockets, and one
//! emulated clock for host, devices and plant.
//!
//! One control tick has four parts. First, the bridge reads all servos, lets the supervisor decide, writes the goals,
//! and audits one servo, whose answer confirms that the goals have arrived. Then the arm's milliseconds pass, each with
//! a command and an answer over UDP. Then the plant advances by one tick. Last, new measurements are taken. The result
//! does not depend on the load of the machine, and equals that of the simulated robot wherever the protocols lose
//! nothing. Effects of real time are studied with devices in real time ([`super::EmulatedHand::start`]).

use std::path::Path;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use dynamixel_bus::xc330;
use hand_model::RobotModel;
use hand_model::robot::{Plant, Readings, RobotBackend, RobotCommand, RobotError, Tick};
use kinova_kortex::KortexError;
use robot_session_log::{LinkPacket, LinkTap};

use super::lockstep_arm::LockstepArm;
use super::pty::PtyError;
use super::servo::EmulatedServo;
use super::{EmulatedHand, EmulatorSettings};
use crate::bus_link::{BusLink, open_hand};
use crate::calibration::{HandCalibration, ServoCalibration};
use crate::cameras::Cameras;
use crate::clock::Clock;
use crate::config::{ArmConfig, BridgeConfig, CameraConfig, LimitConfig, ServoConfig};
use crate::hand_bus::servo_tap;
use crate::hardware_robot::{ConnectError, newest_readings, sent_command};
use crate::lock::lock;
use crate::safety::state::SupervisorState;
use crate::safety::supervisor::CheckFailed;
use crate::servo_cycle::{CycleReport, ServoCycle};
use crate::supported_robot::SERVOS;
use crate::supported_robot::check_supported;
use crate::tactile_link::TactileLink;

/// Longest wait for bytes on the wire; generous, for busy machines.
const WIRE_TIMEOUT: Duration = Duration::from_secs(20);
/// Polling interval of that wait.
const POLL_INTERVAL: Duration = Duration::from_micros(50);

/// Error of starting the lock-step robot.
#[derive(Debug, thiserror::Error)]
pub enum LockstepError {
    /// Error of a pseudo-terminal.
    #[error(transparent)]
    Pty(#[from] PtyError),
    /// Error of the emulated arm.
    #[error(transparent)]
    Arm(#[from] KortexError),
    /// Error of the host's side.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Check(#[from] CheckFailed),
    #[error("arming: {0}")]
    Arming(String),
}

#[derive(Debug, Clone)]
pub struct LockstepSettings {
    pub devices: EmulatorSettings,
    /// Travel of every shaft, rad, for the calibration.
    pub travel: [f64; SERVOS],
    /// Limits of the supervisor.
    pub limits: LimitConfig,
    /// Time-out of a servo's answer, s of real time; long enough that a busy machine misses none.
    pub slack: f64,
}

pub struct LockstepRobot {
    cycle: ServoCycle<BusLink>,
    cameras: Option<Cameras>,
    devices: EmulatedHand,
    arm: LockstepArm,
    clock: Clock,
    tick: f64,
    sequence: u64,
    host_alive: bool,
    /// Error of the last request for images, reported by the next observation.
    capture_error: Option<RobotError>,
    config: BridgeConfig,
    calibration: HandCalibration,
}

impl LockstepRobot {
    /// Switches on the devices of `robot` around `plant`, connects to them, checks and arms. Packets on the wires are
    /// copied to `packets`.
    pub fn start(
        plant: Box<dyn Plant + Send>,
        settings: LockstepSettings,
        robot: &RobotModel,
        packets: Option<&Sender<LinkPacket>>,
    ) -> Result<Self, LockstepError> {
        check_supported(robot).map_err(ConnectError::from)?;
        let clock = Clock::emulated();
        let tick = plant.tick_length();
        let (seed, zeros) = (settings.devices.seed, settings.devices.servos.clone());
        let devices = EmulatedHand::start_stepped(plant, settings.devices, robot, clock.clone())?;
        let arm = LockstepArm::start(devices.arm_joints(), &robot.arm, seed, packets)?;
        let config = configuration(devices.servo_port(), devices.camera_port(), tick, settings.limits, settings.slack);
        let calibration = emulated_calibration(robot, &zeros, &settings.travel);
        devices.write_homing_offsets(&calibration);
        let mut hand = open_hand(&config, &calibration, robot)?;
        let cameras = Cameras::open(&config, robot.hand.cameras.len(), &clock).map_err(ConnectError::from)?;
        if let Some(packets) = packets {
            hand.bus.tap(servo_tap(LinkTap::new("servos", packets.clone())));
            if let Some(tactile) = cameras.as_ref().and_then(Cameras::board) {
                tactile.tap(LinkTap::new("cameras", packets.clone()));
            }
        }
        let limits = config.limits(&calibration.travel(), &robot.arm);
        let link = BusLink::new(&config, hand, Box::new(arm.link()));
        let cycle = ServoCycle::new(link, robot, limits, clock.clone(), WIRE_TIMEOUT);
        let cycle = ServoCycle { audit_interval: 1, ..cycle };
        let mut started = Self {
            cycle,
            cameras,
            devices,
            arm,
            clock,
            tick,
            sequence: 0,
            host_alive: true,
            capture_error: None,
            config,
            calibration,
        };
        started.cycle.measure();
        started.cycle.supervisor.check(&started.cycle.measured, started.clock.now())?;
        started.cycle.arm_torque(started.clock.now()).map_err(LockstepError::Arming)?;
        Ok(started)
    }

    /// Returns the supervisor's state.
    pub fn state(&self) -> SupervisorState {
        self.cycle.supervisor.state()
    }

    /// Returns the statistics of the servo cycles.
    pub fn report(&self) -> CycleReport {
        self.cycle.report.clone()
    }

    /// Returns the robot's configuration.
    pub fn config(&self) -> &BridgeConfig {
        &self.config
    }

    /// Returns the calibration of the servos.
    pub fn calibration(&self) -> &HandCalibration {
        &self.calibration
    }

    /// Sets the time-out of the servos' answers, s of real time; shorter for tests with lost answers.
    pub fn set_slack(&mut self, seconds: f64) {
        self.cycle.link.bus.slack = seconds;
        if let Some(hand) = &mut self.cycle.link.hand {
            hand.bus.set_slack(seconds);
        }
    }

    /// Returns the devices, for injecting faults.
    pub fn devices(&mut self) -> &mut EmulatedHand {
        &mut self.devices
    }

    /// Returns the arm, for injecting faults.
    pub fn arm(&mut self) -> &mut LockstepArm {
        &mut self.arm
    }

    /// Returns the link to the camera board.
    pub fn tactile(&self) -> Option<&TactileLink> {
        self.cameras.as_ref().and_then(Cameras::board)
    }

    /// Stops and holds, as `ftac bridge stop` does.
    pub fn hold(&mut self) {
        self.cycle.supervisor.hold(crate::safety::state::StopCause::Operator);
    }

    /// Stops the host, as if it were killed or frozen; devices and plant continue.
    pub fn kill_host(&mut self) {
        self.host_alive = false;
    }

    /// Runs one servo cycle without a new command, as while the controller is silent.
    pub fn idle_cycle(&mut self) {
        if self.host_alive {
            self.cycle.decide();
        }
    }

    /// Waits until `done`; returns false on a time-out or a lost port.
    fn wait_until(&self, done: impl Fn(&Self) -> bool) -> bool {
        let deadline = Instant::now() + WIRE_TIMEOUT;
        while !done(self) {
            if Instant::now() > deadline || self.tactile().is_none_or(|link| link.port_error().is_some()) {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    }

    /// Returns the number of images, faults and losses so far, of all cameras.
    fn image_events(&self) -> u64 {
        let count = |link: &TactileLink| {
            let cameras =
                link.camera_counters().iter().map(|c| c.decoded + c.undecodable + c.overrun + c.faults).sum::<u64>();
            cameras + link.line_counters().damaged
        };
        self.tactile().map_or(0, count)
    }
}

impl RobotBackend for LockstepRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        match self.capture_error.take() {
            Some(error) => Err(error),
            None => Ok(newest_readings(&self.cycle.shared, self.cameras.as_ref(), self.clock.now(), self.sequence)),
        }
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        if !self.host_alive {
            return Err(RobotError::ConnectionLost("the host was stopped".to_owned()));
        }
        if let (true, Some(link)) = (command.capture, self.tactile()) {
            match link.request_capture() {
                Ok(()) => {
                    self.wait_until(|robot| robot.devices.capture_pending());
                }
                Err(error) => self.capture_error = Some(RobotError::CaptureFailed(error.to_string())),
            }
        }
        {
            let mut board = lock(&self.cycle.shared.state);
            board.requested = Some((*command, self.clock.now()));
            board.requested_number += 1;
        }
        self.cycle.decide();
        let board = lock(&self.cycle.shared.state);
        Ok(sent_command(command, &board.sent, board.state))
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.arm.advance(self.tick, self.clock.now() + self.tick, self.host_alive);
        let (arrived, taken) = (self.image_events(), self.devices.image_count());
        self.devices.step();
        if self.host_alive {
            self.arm.measure(self.clock.now());
        }
        let due = self.devices.image_count() - taken;
        if self.host_alive && due > 0 {
            self.wait_until(|robot| robot.image_events() >= arrived + due);
        }
        // Readings must not look older than they are: the next ones are taken at this moment.
        if self.host_alive {
            self.cycle.measure();
        }
        self.sequence += 1;
        Tick { time: self.clock.now(), lateness: 0.0 }
    }

    fn tick_length(&self) -> f64 {
        self.tick
    }
}

impl Drop for LockstepRobot {
    fn drop(&mut self) {
        if self.host_alive {
            self.cycle.shut_down();
        }
    }
}

/// Returns the configuration of a lock-step robot, with one servo cycle per tick.
fn configuration(servos: &Path, cameras: &Path, tick: f64, limits: LimitConfig, slack: f64) -> BridgeConfig {
    BridgeConfig {
        version: 1,
        calibration: "calibration.json".into(),
        stop_socket: None,
        file: "".into(),
        servos: ServoConfig {
            port: servos.to_owned(),
            ids: [1, 2, 3, 4, 5, 6],
            baud: 3_000_000,
            rate: 1.0 / tick,
            fast_sync_read: false,
            slack,
        },
        cameras: Some(CameraConfig { port: cameras.to_owned() }),
        uvc: Vec::new(),
        arm: ArmConfig::Loopback {},
        limits,
    }
}

/// Returns the calibration that homing would have found on `robot`: the open mark of each servo is where its encoder
/// shows its `zero`.
pub(super) fn emulated_calibration(
    robot: &RobotModel,
    servos: &[EmulatedServo],
    travel: &[f64; SERVOS],
) -> HandCalibration {
    let servos = std::array::from_fn(|n| ServoCalibration {
        id: n as u8 + 1,
        model: xc330::MODEL.number,
        firmware: 46,
        homing_offset: servos.get(n).map_or(0, |servo| -(servo.zero().rem_euclid(4096) as i32)),
        travel: travel[n],
    });
    HandCalibration::new(&robot.hand.parameters.name, servos)
}
