//! An emulated, calibrated hand, and a robot on it.

use dynamixel_bus::servo_bus::ServoBus;
use dynamixel_bus::xc330;
use hardware_bridge::supported_robot::SERVOS;
use std::time::{Duration, Instant};

use hand_model::RobotModel;
use hand_model::robot::{Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal};
use hardware_bridge::arm_link::LoopbackArm;
use hardware_bridge::calibration::{HandCalibration, ServoCalibration};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::emulator::faults::Faults;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::hardware_robot::{ConnectError, HardwareRobot};
use hardware_bridge::servo_cycle::DryLines;
use tempfile::TempDir;

pub const TRAVEL: f64 = 4.0;
/// Ticks a second of [`SpringHand`].
const PLANT_RATE: f64 = 240.0;

pub struct Bench {
    pub hand: EmulatedHand,
    pub config: BridgeConfig,
    pub folder: TempDir,
}

/// A limit that only a hung test reaches.
const HUNG_TEST_TIMEOUT: Duration = Duration::from_secs(120);

/// The devices of the built-in robot on springs whose shafts stop at `travel`, rad.
pub fn started(travel: [f64; SERVOS], settings: EmulatorSettings) -> EmulatedHand {
    let robot = RobotModel::ftac_gen3();
    let plant = SpringHand::new(travel, robot.hand.cameras.len());
    EmulatedHand::start(Box::new(plant), settings, &robot).expect("starts")
}

/// An emulated hand, calibrated as it is, and a configuration whose watchdogs tolerate a busy machine: the devices run
/// in real time.
pub fn bench(faults: &[&str]) -> Bench {
    let settings = EmulatorSettings {
        faults: Faults::parse(faults.iter().copied()).expect("faults"),
        ..EmulatorSettings::default()
    };
    let hand = started([TRAVEL; SERVOS], settings);
    let folder = tempfile::tempdir().expect("a folder");
    let text = format!(
        r#"version = 1
        calibration = "calibration.json"
        stop_socket = "stop"
        [servos]
        port = {:?}
        ids = [1, 2, 3, 4, 5, 6]
        slack = 0.2
        [cameras]
        port = {:?}
        [arm]
        kind = "loopback"
        [limits]
        staleness = 1.0
        servo_watchdog = 2.54
        arm_watchdog = 1.0
        host_watchdog = 3.0
        release_time = 0.3"#,
        hand.servo_port(),
        hand.camera_port()
    );
    let file = folder.path().join("bridge.toml");
    std::fs::write(&file, text).expect("written");
    let config = forgiving(BridgeConfig::read(&file).expect("a configuration"));
    let mut bus = ServoBus::open(hand.servo_port(), config.bus()).expect("opens");
    let servos = std::array::from_fn(|n| {
        let id = n as u8 + 1;
        let unit = xc330::HOMING_OFFSET.unit.per_count();
        let offset = -(bus.read(id, &xc330::PRESENT_POSITION).expect("read") / unit).round() as i32;
        bus.write(id, &xc330::HOMING_OFFSET, f64::from(offset) * unit).expect("written");
        ServoCalibration { id, model: xc330::MODEL.number, firmware: 46, homing_offset: offset, travel: TRAVEL }
    });
    HandCalibration::new("ftac", servos).write(&config.calibration).expect("written");
    Bench { hand, config, folder }
}

/// Raises limits above those that a file may set: a machine that is held up for a second must not look like a silent
/// device.
pub fn forgiving(mut config: BridgeConfig) -> BridgeConfig {
    config.limits.staleness = 5.0;
    config.limits.arm_watchdog = 5.0;
    config
}

pub fn connect(bench: &Bench, dry: Option<DryLines>) -> Result<HardwareRobot, ConnectError> {
    HardwareRobot::connect(&bench.config, Box::new(LoopbackArm::at([0.0; 7].into())), &RobotModel::ftac_gen3(), dry)
}

/// Waits until `done`.
pub fn patiently(what: &str, mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + HUNG_TEST_TIMEOUT;
    while !done() {
        assert!(Instant::now() < deadline, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Waits until `seconds` of the plant's own time have passed.
pub fn plant_time(hand: &EmulatedHand, seconds: f64) {
    let until = hand.tick_counts().0 + (seconds * PLANT_RATE).ceil() as u64;
    patiently("the plant's time has passed", || hand.tick_counts().0 >= until);
}

/// Connects; tries again if a machine that is held up loses an answer.
pub fn connected(bench: &Bench) -> HardwareRobot {
    let mut robot = connect(bench, None);
    patiently("all servos answer", || {
        if let Err(ConnectError::Bus(_)) = robot {
            robot = connect(bench, None);
        }
        !matches!(robot, Err(ConnectError::Bus(_)))
    });
    robot.expect("connects")
}

pub fn armed(bench: &Bench) -> HardwareRobot {
    let robot = connected(bench);
    patiently("the checks pass", || robot.check().is_ok());
    robot.arm().expect("arms");
    robot
}

pub fn command(servo: ServoGoal) -> RobotCommand {
    RobotCommand { arm: [0.1; 7].into(), servos: [servo; SERVOS].into(), capture: false }
}

/// Returns the newest measurements.
pub fn observed(robot: &mut HardwareRobot) -> Observation {
    robot.observe().and_then(Readings::into_observation).expect("observed")
}

/// Sends a command. If the machine does not run the servo cycle in time, the goal is sent again with the next command.
pub fn send(robot: &mut HardwareRobot, command: &RobotCommand) {
    match robot.send(command) {
        Ok(_) | Err(RobotError::NotSent(_)) => {}
        Err(error) => panic!("{error}"),
    }
}

/// Drives until `done`.
pub fn drive(robot: &mut HardwareRobot, goal: ServoGoal, mut done: impl FnMut(&mut HardwareRobot) -> bool) {
    patiently("the robot gets there", || {
        send(robot, &command(goal));
        robot.wait_for_tick();
        done(robot)
    });
}

pub fn closed(robot: &mut HardwareRobot, angle: f64) -> bool {
    observed(robot).servos.iter().all(|servo| (servo.position - angle).abs() < 0.1)
}
