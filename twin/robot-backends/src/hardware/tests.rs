//! Questions of the real robot to its operator, on emulated devices in real time.

use dynamixel_bus::xc330;
use hardware_bridge::supported_robot::SERVOS;
use std::fs::File;
use std::io::{PipeWriter, Write as _};
use std::os::fd::OwnedFd;
use std::time::Instant;

use hand_model::RobotModel;
use hand_model::robot::{Readings, RobotBackend as _, RobotCommand, ServoGoal};
use hardware_bridge::calibration::{HandCalibration, ServoCalibration};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::kortex_link::KortexLink;
use kinova_kortex::emulator::{Emulator, Injection, Pace, Settings};
use kinova_kortex::{Arm, Timeouts};

use super::*;
use crate::TrialStopped;

const TRAVEL: f64 = 4.0;

/// The devices, and a robot that runs on them.
struct Bench {
    hardware: HardwareBackend,
    answers: PipeWriter,
    arm: Emulator,
    _hand: EmulatedHand,
    _folder: tempfile::TempDir,
}

/// Watchdogs that tolerate a busy machine, and sessions that outlast the test.
fn bench() -> Bench {
    let settings = EmulatorSettings::default();
    let zeros: Vec<i64> = settings.servos.iter().map(|servo| servo.zero()).collect();
    let model = RobotModel::ftac_gen3();
    let plant = SpringHand::new([TRAVEL; SERVOS], model.hand.cameras.len());
    let hand = EmulatedHand::start(Box::new(plant), settings, &model).expect("starts");
    let folder = tempfile::tempdir().expect("a folder");
    let text = format!(
        "version = 1\ncalibration = \"calibration.json\"\nstop_socket = \"stop\"\n[servos]\nport = {:?}\n\
         ids = [1, 2, 3, 4, 5, 6]\nslack = 0.2\n[arm]\nkind = \"loopback\"\n[limits]\nstaleness = 1.0\n\
         servo_watchdog = 2.54\narm_watchdog = 1.0\nhost_watchdog = 3.0\nrelease_time = 0.3\n",
        hand.servo_port()
    );
    let path = folder.path().join("bridge.toml");
    std::fs::write(&path, text).expect("written");
    let mut config = BridgeConfig::read(&path).expect("a configuration");
    (config.limits.staleness, config.limits.arm_watchdog) = (30.0, 30.0);
    let servo = |n: usize| ServoCalibration {
        id: n as u8 + 1,
        model: xc330::MODEL.number,
        firmware: 46,
        homing_offset: -(zeros[n].rem_euclid(4096) as i32),
        travel: TRAVEL,
    };
    let calibration = HandCalibration::new("ftac", std::array::from_fn(servo));
    hand.write_homing_offsets(&calibration);
    calibration.write(&config.calibration).expect("written");

    let settings = Settings { cyclic_deadline: 120_000, ..Settings::default() };
    let credentials = settings.credentials.clone();
    let arm = Emulator::start(settings, Box::new(hand.arm_joints()), Pace::RealTime).expect("free ports");
    let hour = Duration::from_secs(3600);
    let timeouts = Timeouts { call: Duration::from_secs(60), session: hour, connection: hour, ..Timeouts::default() };
    let near = hand.arm_joints().state().position;
    let client = Arm::connect(arm.address(), &credentials, timeouts, near.into_inner()).expect("connects");
    let link = KortexLink::new(client, &model.arm, Duration::from_millis(5), Duration::from_secs(60));
    let robot = HardwareRobot::connect(&config, Box::new(link), &model, None).expect("connects");
    until("the checks pass", || robot.check().is_ok());
    robot.arm().expect("arms");
    let (input, answers) = std::io::pipe().expect("a pipe");
    let operator = Operator::from_file(File::from(OwnedFd::from(input)));
    let interrupt = Some(Interrupt::catch().expect("caught"));
    let places = vec![Isometry3::identity(); 2];
    let names = vec!["pear".to_owned(), "lemon".to_owned()];
    let mut hardware = HardwareBackend {
        robot,
        nominal_poses: places,
        names,
        max_pause: 60.0,
        interrupt,
        vision: None,
        scene: None,
        operator,
    };
    until("it runs", || {
        let seen = hardware.robot.observe().and_then(Readings::into_observation).expect("observed");
        let servos = [ServoGoal::Current(0.0); SERVOS];
        // A command that a busy machine does not send in time is sent in the next round.
        let _ = hardware.robot.send(&RobotCommand { arm: seen.arm.position, servos: servos.into(), capture: false });
        hardware.robot.state() == SupervisorState::Running
    });
    Bench { hardware, answers, arm, _hand: hand, _folder: folder }
}

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let give_up = Instant::now() + Duration::from_secs(120);
    while !condition() {
        assert!(Instant::now() < give_up, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The arm is lost before the operator has answered: there is no verdict, and the reason is reported.
#[test]
fn an_arm_that_is_lost_at_the_verdict_question_gives_no_verdict() {
    let mut bench = bench();
    // The first answer is given, the second is awaited.
    bench.answers.write_all(b"no\n").expect("answered");
    let (arm, hardware) = (&bench.arm, &mut bench.hardware);
    let judged = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(300));
            arm.inject(Injection::EmergencyStop(true));
        });
        hardware.judge()
    });
    let error = judged.expect_err("no verdict");
    assert!(error.downcast_ref::<TrialStopped>().is_some(), "{error:#}");
    let words = error.to_string();
    assert!(words.contains("emergency stop") && words.contains("while the verdict was asked for"), "{words}");
}

/// A running robot is judged, and an invalid answer is asked for again.
#[test]
fn a_robot_that_runs_is_judged() {
    let mut bench = bench();
    bench.answers.write_all(b"what?\nno\nyes\n").expect("answered");
    let verdict = bench.hardware.judge().expect("a verdict").expect("the operator's");
    assert_eq!((verdict.contact, verdict.success), (false, true));
}
