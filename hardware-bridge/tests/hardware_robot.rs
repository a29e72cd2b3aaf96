//! The robot on emulated devices: bring-up, driving, and the two stops.

use dynamixel_bus::servo_bus::{BusSettings, ServoBus};
use dynamixel_bus::xc330;
use hardware_bridge::supported_robot::SERVOS;
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::common::{TRAVEL, armed, bench, closed, command, connect, drive, observed, patiently, started};
use hand_model::RobotModel;
use hand_model::robot::{RobotBackend, RobotCommand, ServoGoal, TactileFrame};
use hardware_bridge::arm_link::LoopbackArm;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::emulator::EmulatorSettings;
use hardware_bridge::emulator::camera_board::BoardSettings;
use hardware_bridge::emulator::faults::FaultEvent;
use hardware_bridge::emulator::servo::EmulatedServo;
use hardware_bridge::hand_bus::HandBus;
use hardware_bridge::hardware_robot::{ConnectError, HardwareRobot};
use hardware_bridge::homing::{HomingSettings, find_stops, write_offsets};
use hardware_bridge::remote::{self, RemoteCommand, socket_paths};
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use hardware_bridge::servo_cycle::DryLines;
use hardware_bridge::tactile_link::TactileLink;

#[test]
fn follows_positions_and_currents() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    let goal = ServoGoal::Position { angle: 1.5, current_limit: 0.4 };
    drive(&mut robot, goal, |robot| closed(robot, 1.5));
    let sent = robot.send(&command(ServoGoal::Current(5.0))).expect("sent");
    assert_eq!(sent.servos[0], ServoGoal::Current(0.6), "what was sent, after limits");
    assert!(sent.arm.iter().all(|angle| (0.0..=0.1).contains(angle)));
    // 0.09 A balance the spring at (0.09 - 0.01) / 0.04 = 2 rad.
    drive(&mut robot, ServoGoal::Current(0.09), |robot| closed(robot, 2.0));
    assert_eq!(robot.state(), SupervisorState::Running);
    assert!(robot.report().cycles > 10);
}

/// A hold keeps the shafts in place whatever the controller sends; a release opens the hand and ends without torque.
#[test]
fn hold_and_release_from_another_terminal() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    let goal = ServoGoal::Position { angle: 2.0, current_limit: 0.3 };
    drive(&mut robot, goal, |robot| closed(robot, 2.0));
    let socket = bench.config.stop_socket.clone().expect("configured");
    // The default socket, which any terminal finds by the path of the configuration alone.
    let usual: Vec<_> = robot.stop_sockets().map(Path::to_owned).collect();
    assert!(
        usual.len() == 2 && socket_paths::belongs_to_robot(&usual[0], &bench.config.file) && usual[1] == socket,
        "{usual:?}"
    );
    let said = remote::ask(&usual[0], RemoteCommand::Hold).expect("obeyed");
    // The number of servos that answered recently depends on the machine.
    assert!(said.text.starts_with("hold: the operator stopped it; "), "{said:?}");
    assert!(said.text.ends_with("of 6 servos answer"), "{said:?}");
    assert!(said.robot.contains("bridge.toml, process "), "{said:?}");
    for _ in 0..60 {
        crate::common::send(&mut robot, &command(ServoGoal::Position { angle: 0.0, current_limit: 0.3 }));
        robot.wait_for_tick();
    }
    assert!(closed(&mut robot, 2.0), "{:?}", bench.hand.shafts());
    let said = remote::ask(&socket, RemoteCommand::Release).expect("lets go").text;
    assert_eq!(
        (said.as_str(), robot.state()),
        ("torque read back as off from 6 of 6 servos", SupervisorState::Connected)
    );
    patiently("the springs open the hand", || bench.hand.shafts().iter().all(|shaft| shaft.position < 0.3));
    assert!(bench.hand.applied_goals().iter().all(|drive| *drive == ServoGoal::Current(0.0)));
    assert!(robot.report().torque_still_on.is_empty());
}

/// A release names the servos whose torque is not known to be off, and does not count as a success.
#[test]
fn a_release_that_no_servo_answers_is_not_called_off() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    drive(&mut robot, ServoGoal::Current(0.09), |robot| closed(robot, 2.0));
    bench.hand.inject(FaultEvent::Unplug(2));
    let said = robot.release().expect_err("one does not answer").to_string();
    assert!(said.starts_with("torque read back as off from 5 of 6 servos; index: servo 2: "), "{said}");
    // And directly, with no bridge in between and all plugs out.
    drop(robot);
    (1..=6).for_each(|id| bench.hand.inject(FaultEvent::Unplug(id)));
    let settings = BusSettings { slack: 0.01, ..bench.config.bus() };
    let bus = ServoBus::open(bench.hand.servo_port(), settings).expect("opens");
    let unsure = HandBus::new(bus, bench.config.servos.ids, false).torque_off();
    assert_eq!(unsure.len(), 6, "{unsure:?}");
}

#[test]
fn an_unplugged_servo_ends_in_hold_and_an_overload_in_fault() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    let goal = ServoGoal::Position { angle: 2.0, current_limit: 0.3 };
    drive(&mut robot, goal, |robot| closed(robot, 2.0));
    bench.hand.inject(FaultEvent::Unplug(6));
    drive(&mut robot, goal, |robot| matches!(robot.state(), SupervisorState::Hold(StopCause::ServoSilent(5, _))));
    assert!(bench.hand.shafts()[..5].iter().all(|shaft| (shaft.position - 2.0).abs() < 0.1), "the others hold");
    bench.hand.inject(FaultEvent::Overload(2));
    patiently("the fault is seen", || robot.state() == SupervisorState::Fault(StopCause::ServoAlert(1)));
    assert!((bench.hand.shafts()[0].position - 2.0).abs() < 0.1);
}

/// A controller that announces a pause may be silent; its next command ends the pause, and silence counts again.
#[test]
fn an_announced_pause_is_no_silence() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    drive(&mut robot, ServoGoal::Current(0.09), |robot| closed(robot, 2.0));
    robot.pause(3600.0);
    let (paused, watchdog) = (observed(&mut robot).time, bench.config.limits.host_watchdog);
    patiently("the controller has been silent for longer than its watchdog", || {
        observed(&mut robot).time > paused + 1.5 * watchdog
    });
    assert_eq!(robot.state(), SupervisorState::Running);
    crate::common::send(&mut robot, &command(ServoGoal::Current(0.09)));
    patiently("the silence is noticed", || robot.state() != SupervisorState::Running);
    assert!(matches!(robot.state(), SupervisorState::Hold(StopCause::HostSilent(_))), "{:?}", robot.state());
    assert!(closed(&mut robot, 2.0), "{:?}", bench.hand.shafts());
    assert!(robot.report().longest_silence > watchdog);
}

/// A dropped robot keeps holding.
#[test]
fn dropping_the_robot_keeps_hold() {
    let bench = bench(&[]);
    let mut robot = armed(&bench);
    drive(&mut robot, ServoGoal::Current(0.09), |robot| closed(robot, 2.0));
    drop(robot);
    crate::common::plant_time(&bench.hand, 1.5);
    assert!(bench.hand.shafts().iter().all(|shaft| shaft.position > 1.8), "{:?}", bench.hand.shafts());
}

#[test]
fn dry_run_moves_nothing() {
    let bench = bench(&[]);
    let lines = Arc::new(Mutex::new(Vec::new()));
    let told = lines.clone();
    let tell: DryLines = Box::new(move |line| told.lock().expect("whole").push(line));
    let mut robot = connect(&bench, Some(tell)).expect("connects");
    patiently("the checks pass", || robot.check().is_ok());
    robot.arm().expect("arms");
    let told_enough = || lines.lock().expect("whole").len() > 1;
    drive(&mut robot, ServoGoal::Current(0.3), |_| told_enough());
    assert!(bench.hand.shafts().iter().all(|shaft| shaft.position == 0.0));
    assert!(bench.hand.applied_goals().iter().all(|drive| *drive == ServoGoal::Current(0.0)), "no torque");
    assert!(lines.lock().expect("whole")[1].contains("300 mA"), "{lines:?}");
}

#[test]
fn another_servo_is_refused() {
    let bench = bench(&[]);
    let mut bus = ServoBus::open(bench.hand.servo_port(), bench.config.bus()).expect("opens");
    bus.write(4, &xc330::HOMING_OFFSET, 0.0).expect("written");
    drop(bus);
    let error = connect(&bench, None).err().expect("refused");
    assert!(matches!(error, ConnectError::Mismatch { actuator: 3, found: 0, .. }), "{error}");
    let missing = BridgeConfig { calibration: Path::new("/no/such/calibration.json").into(), ..bench.config.clone() };
    let error =
        HardwareRobot::connect(&missing, Box::new(LoopbackArm::at([0.0; 7].into())), &RobotModel::ftac_gen3(), None);
    assert!(error.err().expect("refused").to_string().starts_with("/no/such/calibration.json: "));
}

/// Homing from factory settings, with a shaft at an arbitrary angle, finds the open mark and the travel.
#[test]
fn homing() {
    let mut servos = EmulatorSettings::default().servos;
    servos[0] = EmulatedServo::provisioned(1, 3900);
    let settings = EmulatorSettings { servos, ..EmulatorSettings::default() };
    let hand = started([TRAVEL; SERVOS], settings);
    let bus_settings = dynamixel_bus::servo_bus::BusSettings { slack: 5.0, ..Default::default() };
    let mut bus = ServoBus::open(hand.servo_port(), bus_settings).expect("opens");
    // A plant that a busy machine delays for a moment must not look like a shaft at its stop.
    let patient = HomingSettings { stall_time: 2.0, timeout: 60.0, fade_time: 0.2, ..HomingSettings::default() };
    let patient = HomingSettings { watchdog: 2.54, ..patient };
    let found = find_stops(&mut bus, 1, &patient, &|| false).expect("feels its stops");
    assert_eq!(bus.read(1, &xc330::HOMING_OFFSET).expect("read"), 0.0, "nothing is written yet");
    write_offsets(&mut bus, std::slice::from_ref(&found)).expect("stored");
    assert!((found.travel - TRAVEL).abs() < 0.01, "{found:?}");
    assert_eq!(found.homing_offset, -3900);
    patiently("the spring opens it", || hand.shafts()[0].position < 0.05);
    let mark = bus.read(1, &xc330::PRESENT_POSITION).expect("read");
    assert!(mark.abs() < 0.06, "{mark}");
    assert_eq!(bus.read(1, &xc330::TORQUE_ENABLE).expect("read"), 0.0);
}

/// Takes `captures` images with every camera; returns those that can be decoded.
fn images(robot: &mut HardwareRobot, captures: usize) -> Vec<TactileFrame> {
    let arrived = |robot: &HardwareRobot| -> u64 {
        let cameras = robot.tactile().expect("cameras").camera_counters();
        cameras.iter().map(|camera| camera.decoded + camera.undecodable).sum()
    };
    let (cameras, mut all) = (robot.tactile().expect("cameras").camera_counters().len() as u64, Vec::new());
    for _ in 0..captures {
        let before = arrived(robot);
        crate::common::send(robot, &RobotCommand { capture: true, ..command(ServoGoal::Current(0.0)) });
        patiently("an image of every camera", || arrived(robot) == before + cameras);
        all.extend(observed(robot).tactile);
    }
    all
}

/// Images of all cameras arrive with times on our clock; cut JPEGs are noticed.
#[test]
fn tactile_images() {
    let bench = bench(&["jpeg=0.1"]);
    let mut robot = crate::common::connected(&bench);
    let uncertainty = |robot: &HardwareRobot| robot.tactile().and_then(TactileLink::clock_uncertainty);
    patiently("the board says its time", || uncertainty(&robot).is_some());
    // Before the first cycle no servo was read, and nothing is observed.
    patiently("everything is read", || robot.observe().is_ok_and(|readings| readings.into_observation().is_ok()));
    let (first, before) = (uncertainty(&robot).expect("asked"), observed(&mut robot).time);
    let all = images(&mut robot, 3);
    let after = observed(&mut robot).time;
    // Images are dated by the best answer so far; one second best is believed only once the best has left the window.
    let widest = uncertainty(&robot).expect("asked").max(first);
    let slack = widest + BoardSettings::default().clock_drift * after + 1e-4;
    let link = robot.tactile().expect("cameras");
    let cameras = link.camera_counters();
    let cut: u64 = cameras.iter().map(|camera| camera.undecodable).sum();
    assert!(cut > 0 && cut < 20, "{cut} of 54");
    assert_eq!(all.len() as u64 + cut, 54);
    let times: Vec<f64> = all.iter().map(|frame| frame.time).collect();
    assert!(
        times.iter().all(|time| *time > before - slack && *time < after + slack),
        "{times:?}, expected {before} to {after}, {slack} s either way"
    );
    assert!(cameras.iter().all(|camera| !camera.frozen() && camera.lost == 0));
    assert_eq!(link.line_counters().damaged, 0);
}

#[test]
fn a_frozen_camera_is_noticed() {
    let bench = bench(&[]);
    let mut robot = crate::common::connected(&bench);
    bench.hand.inject(FaultEvent::FreezeCamera(7));
    images(&mut robot, 6);
    let frozen: Vec<bool> =
        robot.tactile().expect("cameras").camera_counters().iter().map(|camera| camera.frozen()).collect();
    assert_eq!(frozen.iter().position(|frozen| *frozen), Some(7));
    assert_eq!(frozen.iter().filter(|frozen| **frozen).count(), 1);
}
