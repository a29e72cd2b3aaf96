//! The bytes of a session with the arm, in its record.

use std::sync::mpsc;

use hand_model::arm::Arm as ArmModel;
use hardware_bridge::kortex::Credentials;
use hardware_bridge::kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
use hardware_bridge::kortex::frame::{Frame, Kind};
use hardware_bridge::kortex::message::base::ServoingMode;
use hardware_bridge::kortex::message::cyclic::{Command, Feedback};
use hardware_bridge::kortex::servoing::Servoing;
use hardware_bridge::kortex::tcp_framing::Deframer;
use hardware_bridge::kortex::{Arm, call};
use hardware_bridge::session_log::{Direction, Event, Reader, Session, Writer};
use prost::Message;

use crate::support::*;

/// Every command and every answer is in the file as it was on the wire, and the password is not.
#[test]
fn every_packet_is_on_record() {
    let secret = Credentials { user: "admin".to_owned(), password: "hunter2hunter2".to_owned() };
    let plant = FirstOrderJoints::new(ArmModel::home(), LAG, ArmModel::gen3().velocity_limits);
    let settings = Settings { credentials: secret.clone(), ..Settings::default() };
    let emulator = Emulator::start(settings, Box::new(plant), Pace::Stepped).expect("starts");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("arm.mcap");
    let mut writer = Writer::create(&path, &Session::default()).expect("a new file");

    let (sender, packets) = mpsc::channel();
    let mut arm = Arm::connect(emulator.address(), &secret, timeouts(), ArmModel::home()).expect("connects");
    arm.tap(&sender);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    let mut commanded = Vec::new();
    for _ in 0..50 {
        let mut command = *servoing.command();
        command[6] += 1e-3;
        servoing.command_angles(&command, soon()).expect("follows");
        commanded.push(command[6]);
        emulator.step(1);
    }
    servoing.leave().expect("leaves");
    for packet in packets.try_iter() {
        writer.packet(&packet).expect("written");
    }
    writer.finish().expect("written");

    let mut reader = Reader::open(&path).expect("opens");
    let (mut sent, mut answers, mut stream) = (Vec::new(), 0, Deframer::default());
    let mut host = Vec::new();
    while let Some((times, event)) = reader.next_event().expect("readable") {
        let Event::Raw { link, direction, bytes } = event else { panic!("{event:?}") };
        host.push(times.host);
        match (link.as_str(), direction) {
            ("arm_udp", _) => {
                let frame = Frame::decode(&bytes).expect("a frame");
                match frame.header.kind {
                    Kind::Request if frame.header.call == call::REFRESH => {
                        let command = Command::decode(frame.payload.as_slice()).expect("a command");
                        sent.push(command.actuators[6].position);
                    }
                    Kind::Response if frame.header.call == call::REFRESH => {
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
    assert!(reader.is_whole() && host.is_sorted());
    // One more for the entry, which commands the measured angle.
    assert_eq!((sent.len(), answers), (51, 51));
    for (wire, commanded) in sent[1..].iter().zip(&commanded) {
        assert_eq!(*wire, hardware_bridge::kortex::degrees::to_wire_angle(*commanded));
    }
    let calls: Vec<_> =
        std::iter::from_fn(|| stream.next_frame().expect("frames")).map(|frame| frame.header.call).collect();
    assert_eq!(calls.first(), Some(&call::CLEAR_FAULTS));
    assert_eq!(calls.last(), Some(&call::SET_SERVOING_MODE));
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
    let file = std::fs::read(&path).expect("readable");
    assert!(!file.windows(secret.password.len()).any(|window| window == secret.password.as_bytes()));
}
