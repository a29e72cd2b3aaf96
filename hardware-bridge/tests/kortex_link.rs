//! The Gen3 behind the bridge: recording of its links, and a network that fails.

use hardware_bridge::supported_robot::SERVOS;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use hand_model::RobotModel;
use hand_model::arm::Arm as ArmModel;
use hardware_bridge::arm_link::ArmLink as _;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::kortex_link::{KortexLink, limits, tap};
use kinova_kortex::base::Notification;
use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Injection, Pace, Settings};
use kinova_kortex::frame::{Frame, FrameKind};
use kinova_kortex::message::action::ActionEvent;
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::message::cyclic::{Command, Feedback};
use kinova_kortex::servoing::{Servoing, ServoingLimits};
use kinova_kortex::tcp_framing::Deframer;
use kinova_kortex::{Arm, Credentials, Timeouts, call, gen3};
use prost::Message;
use robot_session_log::{Direction, RobotSizes, SessionEvent, SessionHeader, SessionReader, SessionWriter};

/// Time-out longer than any answer on loopback takes, even on a busy machine.
const LOOPBACK_TIMEOUT: Duration = Duration::from_secs(60);

/// Returns the published home posture, rad.
fn home() -> [f64; 7] {
    ArmModel::gen3().home.into_inner()
}

/// Time-outs of sessions that do not end by themselves: many seconds of a stepped arm may pass between two keep-alives of
/// the host.
fn timeouts() -> Timeouts {
    let hour = Duration::from_secs(3600);
    Timeouts { call: LOOPBACK_TIMEOUT, session: hour, connection: hour, ..Timeouts::default() }
}

/// An arm at its published home posture.
fn emulator(settings: Settings, pace: Pace) -> Emulator {
    let plant = FirstOrderJoints::new(home(), 0.02, ArmModel::gen3().velocity_limits.into_inner());
    Emulator::start(settings, Box::new(plant), pace).expect("loopback has free ports")
}

fn until(what: &str, mut condition: impl FnMut() -> bool) {
    let give_up = Instant::now() + LOOPBACK_TIMEOUT;
    while !condition() {
        assert!(Instant::now() < give_up, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Every command and every answer is in the file as it was on the wire; the password is not.
#[test]
fn every_packet_is_on_record() {
    let secret = Credentials { user: "admin".to_owned(), password: "hunter2hunter2".to_owned() };
    let emulator = emulator(Settings { credentials: secret.clone(), ..Settings::default() }, Pace::Stepped);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arm.mcap");
    let mut writer = SessionWriter::create(&path, &SessionHeader::default()).expect("a new file");

    let (sender, packets) = mpsc::channel();
    let mut arm = Arm::connect(emulator.address(), &secret, timeouts(), home()).expect("connects");
    tap(&mut arm, &sender);
    let mut servoing = Servoing::enter(&mut arm, limits(&ArmModel::gen3())).expect("enters");
    let mut commanded = Vec::new();
    for _ in 0..50 {
        let mut command = *servoing.command();
        command[6] += 1e-3;
        servoing.command_angles(&command, Instant::now() + LOOPBACK_TIMEOUT).expect("follows");
        commanded.push(command[6]);
        emulator.step(1);
    }
    servoing.leave().expect("leaves");
    for packet in packets.try_iter() {
        writer.packet(&packet).expect("written");
    }
    writer.finish().expect("written");

    let mut reader = SessionReader::open(&path, RobotSizes::Any).expect("opens");
    let (mut sent, mut answers, mut stream) = (Vec::new(), 0, Deframer::default());
    let mut host = Vec::new();
    while let Some((times, event)) = reader.next_event().expect("readable") {
        let SessionEvent::Raw { link, direction, bytes } = event else { panic!("{event:?}") };
        host.push(times.host);
        match (link.as_str(), direction) {
            ("arm_udp", _) => {
                let frame = Frame::decode(&bytes).expect("a frame");
                match frame.header.kind {
                    FrameKind::Request if frame.header.call == call::REFRESH => {
                        let command = Command::decode(frame.payload.as_slice()).expect("a command");
                        sent.push(command.actuators[6].position);
                    }
                    FrameKind::Response if frame.header.call == call::REFRESH => {
                        let feedback = Feedback::decode(frame.payload.as_slice()).expect("measurements");
                        answers += usize::from(feedback.actuators.len() == 7);
                    }
                    _ => assert!([call::REFRESH_FEEDBACK, call::KEEP_ALIVE].contains(&frame.header.call)),
                }
            }
            ("arm_tcp", Direction::Sent) => stream.push(&bytes),
            ("arm_tcp", Direction::Received) => {}
            other => panic!("{other:?}"),
        }
    }
    assert!(reader.is_finished() && host.is_sorted());
    // One more for the entry, which commands the measured angle.
    assert_eq!((sent.len(), answers), (51, 51));
    for (wire, commanded) in sent[1..].iter().zip(&commanded) {
        assert_eq!(*wire, kinova_kortex::degrees::to_wire_angle(*commanded));
    }
    let calls: Vec<_> =
        std::iter::from_fn(|| stream.next_frame().expect("frames")).map(|frame| frame.header.call).collect();
    assert_eq!(calls.first(), Some(&call::CLEAR_FAULTS));
    assert_eq!(calls.last(), Some(&call::SET_SERVOING_MODE));
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
    let file = std::fs::read(&path).expect("readable");
    assert!(!file.windows(secret.password.len()).any(|window| window == secret.password.as_bytes()));
}

/// A network that fails is reported at once by the arm's client, as a fault: it does not wait for the farewell, which
/// nobody answers.
#[test]
fn a_link_without_network_does_not_keep_its_caller_waiting() {
    let emulator = emulator(Settings { cyclic_deadline: 60_000, ..Settings::default() }, Pace::RealTime);
    let impatient = Timeouts { call: Duration::from_secs(2), ..timeouts() };
    let credentials = Settings::default().credentials;
    let arm = Arm::connect(emulator.address(), &credentials, impatient, home()).expect("connects");
    let mut link = KortexLink::new(arm, &ArmModel::gen3(), Duration::from_millis(10), Duration::from_secs(1));
    link.engage().expect("engages");
    until("the first word", || link.read(0.0).is_ok());
    emulator.inject(Injection::Deaf(true));
    let mut told = Vec::new();
    until("the reason", || {
        told.extend(link.read(0.0).err().map(|error| error.to_string()));
        let fault = link.read(0.0).is_ok_and(|reading| reading.fault.is_some());
        fault && link.command(&home()).is_err_and(|error| !error.to_string().contains("servoing ended"))
    });
    assert_eq!(told, ["arm: servoing ended"], "told once, before the farewell was over");
}

/// An action moves the arm that carries the emulated hand, and the arm reports its tool's pose.
#[test]
fn an_action_moves_the_hands_arm() {
    let plant = Box::new(SpringHand::new([4.0; SERVOS], 18));
    let hand =
        EmulatedHand::start(plant, EmulatorSettings::default(), &RobotModel::ftac_gen3()).expect("pseudo-terminals");
    let settings = Settings { following_error: std::f64::consts::PI, ..Settings::default() };
    let credentials = settings.credentials.clone();
    let emulator =
        Emulator::start(settings, Box::new(hand.arm_joints()), Pace::RealTime).expect("loopback has free ports");
    let mut arm = Arm::connect(emulator.address(), &credentials, timeouts(), [0.0; 7]).expect("connects");
    arm.base.subscribe_to_actions().expect("subscribes");
    let posture = [0.3, 0.2, -0.1, 0.2, 0.0, 0.1, -0.3];
    arm.base.reach_joint_angles(&posture, Some(1.0)).expect("begins");
    let mut events = Vec::new();
    until("the action is over", || {
        arm.keep_up().expect("alive");
        while let Some(Notification::Action { event, .. }) = arm.base.next_notification().expect("readable") {
            events.push(event);
        }
        events.last() == Some(&ActionEvent::End)
    });
    assert_eq!(events, [ActionEvent::Start, ActionEvent::End]);
    let expected = ArmModel::gen3().tool_pose(&posture);
    until("the plant has taken the last step", || {
        let pose = arm.base.tool_pose().expect("known");
        (0..3).all(|i| (pose.position[i] - expected.translation.vector[i]).abs() < 1e-5)
    });
    let turn = arm.base.tool_pose().expect("known").angles;
    let (x, y, z) = expected.rotation.euler_angles();
    assert!([x, y, z].iter().zip(turn).all(|(expected, found)| (expected - found).abs() < 1e-4), "{turn:?}");
}

/// The bridge keeps the arm's session alive past its time-out, servoing or not.
#[test]
fn the_session_timeout_passes_unnoticed() {
    let emulator = emulator(Settings { cyclic_deadline: 60_000, ..Settings::default() }, Pace::RealTime);
    let short = Timeouts { session: Duration::from_secs(2), keep_alive: Duration::from_millis(20), ..timeouts() };
    let credentials = Settings::default().credentials;
    let arm = Arm::connect(emulator.address(), &credentials, short, home()).expect("connects");
    let mut link = KortexLink::new(arm, &ArmModel::gen3(), Duration::from_millis(10), Duration::from_secs(60));
    let past = |link: &mut KortexLink| {
        let begun = emulator.status().time;
        until("two session timeouts have passed", || {
            link.read(0.0).map_or_else(|error| panic!("lost: {error}"), drop);
            emulator.status().time > begun + 4000
        });
    };
    past(&mut link);
    link.engage().expect("engages");
    until("the first word", || link.read(0.0).is_ok());
    past(&mut link);
    link.disengage().expect("leaves");
    assert_eq!(emulator.status().sessions.len(), 2);
}

/// The client's own figures of the arm are those of the hand model's arm.
#[test]
fn published_figures_agree() {
    assert_eq!(limits(&ArmModel::gen3()), ServoingLimits::gen3());
    assert_eq!(home(), gen3::HOME);
}
