//! Other people's clients on our emulated servos, and other people's encoders against ours.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use dynamixel_bus::protocol2::{Instruction, Packet, ServoError, Status};
use dynamixel_bus::xc330;
use hand_model::RobotModel;
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::supported_robot::SERVOS;
use proptest::prelude::*;
use rustypot::DynamixelProtocolHandler;
use serial2::SerialPort;

const BAUD: u32 = 3_000_000;
const IDS: [u8; 6] = [1, 2, 3, 4, 5, 6];

fn emulator() -> EmulatedHand {
    let plant = Box::new(SpringHand::new([4.0; SERVOS], 18));
    EmulatedHand::start(plant, EmulatorSettings::default(), &RobotModel::ftac_gen3()).expect("starts")
}

#[test]
fn crate_dynamixel2() {
    let hand = emulator();
    let mut bus = dynamixel2::Bus::open(hand.servo_port(), BAUD).expect("opens");
    let found: Vec<u8> = bus.scan().expect("scans").into_iter().flatten().map(|pong| pong.motor_id).collect();
    assert_eq!(found, IDS);
    assert_eq!(bus.read_u16(4, xc330::MODEL_NUMBER.address).expect("read").data, xc330::MODEL.number);
    for id in IDS {
        bus.write_u8(id, xc330::TORQUE_ENABLE.address, 1).expect("torque");
    }
    let torque = bus.sync_read_u8(&IDS, xc330::TORQUE_ENABLE.address).expect("read");
    assert!(torque.iter().all(|reply| reply.data == 1));
    assert!(bus.write_u8(1, xc330::ID.address, 9).is_err(), "EEPROM is locked");
    let goals: Vec<_> = IDS.map(|id| dynamixel2::instructions::SyncWriteData { motor_id: id, data: 77_u16 }).to_vec();
    bus.sync_write_u16(xc330::GOAL_CURRENT.address, &goals).expect("written");
    let currents = bus.sync_read_u16(&IDS, xc330::GOAL_CURRENT.address).expect("read");
    assert!(currents.iter().all(|reply| reply.data == 77));
    bus.reboot(6).expect("obeys");
}

#[test]
fn crate_rustypot() {
    let hand = emulator();
    let path = hand.servo_port().to_str().expect("utf-8");
    let mut port = serialport::new(path, BAUD).timeout(Duration::from_millis(500)).open().expect("opens");
    for handler in [DynamixelProtocolHandler::v2(), DynamixelProtocolHandler::v2().with_fast_sync_read()] {
        assert!(handler.ping(port.as_mut(), 3).expect("answers"));
        let models = handler.sync_read(port.as_mut(), &IDS, xc330::MODEL_NUMBER.address as u8, 2).expect("read");
        assert!(models.iter().all(|model| model[..] == xc330::MODEL.number.to_le_bytes()), "{models:?}");
    }
    let handler = DynamixelProtocolHandler::v2();
    handler.write(port.as_mut(), 2, xc330::TORQUE_ENABLE.address as u8, &[1]).expect("torque");
    let data: Vec<Vec<u8>> = IDS.iter().map(|id| vec![*id, 0]).collect();
    handler.sync_write(port.as_mut(), &IDS, xc330::GOAL_CURRENT.address as u8, &data).expect("written");
    for id in IDS {
        let back = handler.read(port.as_mut(), id, xc330::GOAL_CURRENT.address as u8, 2).expect("read");
        assert_eq!(back, [id, 0]);
    }
}

/// Servos in another process's hands: PyPI's dynamixel-sdk, in a virtual environment made for the occasion.
#[test]
fn pypi_dynamixel_sdk() {
    let Some(python) = python_with("dynamixel-sdk==4.1.0") else { return };
    let hand = emulator();
    let script = Path::new("tests/dynamixel_sdk_client.py");
    let output = run(Command::new(python).arg(script).arg(hand.servo_port()));
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(told.ends_with("all good\n"), "{told}");
    // The script reboots the sixth, whose spring then opens it.
    assert!(hand.shafts()[..5].iter().all(|shaft| shaft.position > 0.3), "the hand closed: {:?}", hand.shafts());
}

/// The ORCA hand's own client on the same servos.
#[test]
fn pypi_orca_core() {
    let Some(python) = python_with("orca_core==0.12.0") else { return };
    let hand = emulator();
    let script = Path::new("tests/orca_core_client.py");
    let output = run(Command::new(python).arg(script).arg(hand.servo_port()));
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(told.ends_with("all good\n"), "{told}");
}

fn run(command: &mut Command) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

/// A Python that has `package`; `None`, said loudly, where there is no Python or no way to the package.
fn python_with(package: &str) -> Option<std::path::PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(package.replace("==", "-"));
    let python = folder.join("bin/python");
    let ready = folder.join("ready");
    if ready.exists() {
        return Some(python);
    }
    let mut make = Command::new("python3");
    make.args(["-m", "venv", "--clear"]).arg(&folder);
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]);
    for step in [&mut make, &mut install] {
        let failed = match step.output() {
            Ok(output) if output.status.success() => continue,
            Ok(output) => String::from_utf8_lossy(&output.stderr).into_owned(),
            Err(error) => error.to_string(),
        };
        eprintln!("SKIPPED: {package} as a client of the emulator: {step:?}: {failed}");
        return None;
    }
    std::fs::write(ready, "").expect("written");
    Some(python)
}

/// A line whose other end we hold.
struct Line {
    bus: dynamixel2::Bus<Vec<u8>, Vec<u8>>,
    other: SerialPort,
}

impl Line {
    fn new() -> Self {
        let (port, mut other) = SerialPort::pair().expect("a pty");
        other.set_read_timeout(Duration::from_millis(500)).expect("set");
        Self { bus: dynamixel2::Bus::new(port).expect("a bus"), other }
    }

    fn sent(&self, length: usize) -> Vec<u8> {
        let mut bytes = vec![0; length];
        self.other.read_exact(&mut bytes).expect("as many bytes as ours");
        bytes
    }
}

/// Data that dynamixel2 0.9.1 neither stuffs nor unstuffs.
fn three_before_fd(bytes: &[u8]) -> bool {
    bytes.windows(4).any(|window| window == [0xFF, 0xFF, 0xFF, 0xFD])
}

fn data(longest: usize) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(prop_oneof![2 => Just(0xFF), 2 => Just(0xFD), 2 => any::<u8>()], 1..=longest)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    /// Write and sync write: byte for byte what dynamixel2 and rustypot send, stuffing included. (Where three FF come before an FD,
    /// dynamixel2 0.9.1 leaves the stuffing out; ROBOTIS' SDK and rustypot put it in, as we do.)
    #[test]
    fn encodings_agree(id in 0..=252_u8, address in 0..=255_u8, bytes in data(40), servos in 1..6_u8) {
        let ours = Packet {
            id,
            instruction: 0x03,
            parameters: [vec![address, 0], bytes.clone()].concat(),
        };
        let ours_wire = Instruction::Write { address: address.into(), data: bytes.clone() }.encode(id)?;
        prop_assert_eq!(&ours_wire, &ours.encode()?);
        if !three_before_fd(&ours.parameters) {
            let mut line = Line::new();
            let count = ours.parameters.len();
            line.bus
                .write_instruction(id, 0x03, count, |buffer| buffer[..count].copy_from_slice(&ours.parameters))
                .expect("sent");
            prop_assert_eq!(line.sent(ours_wire.len()), ours_wire);
        }

        let ids: Vec<u8> = (1..=servos).collect();
        let each: BTreeMap<u8, Vec<u8>> = ids.iter().map(|id| (*id, bytes.clone())).collect();
        let sync = Instruction::SyncWrite {
            address: address.into(),
            length: bytes.len() as u16,
            data: each.clone().into_iter().collect(),
        };
        let wire = sync.encode(0)?;
        let (mut port, mut other) = serialport::TTYPort::pair().expect("a pty");
        let values: Vec<Vec<u8>> = each.into_values().collect();
        DynamixelProtocolHandler::v2().sync_write(&mut port, &ids, address, &values).expect("sent");
        let mut theirs = vec![0; wire.len()];
        std::io::Read::read_exact(&mut other, &mut theirs).expect("as many bytes as ours");
        prop_assert_eq!(theirs, wire);
    }

    /// Answers as we send them are understood as we mean them.
    #[test]
    fn answers_agree(id in 0..=252_u8, alert in any::<bool>(), bytes in data(40)) {
        prop_assume!(!three_before_fd(&bytes));
        let mut line = Line::new();
        let status = Status { id, alert, error: None, data: bytes.clone() };
        line.other.write_all(&status.encode()?).expect("sent");
        let read = line.bus.read_status_response(bytes.len() as u16).expect("understood");
        prop_assert_eq!((read.packet_id(), read.alert(), read.parameters()), (id, alert, &bytes[..]));
        let refusal = Status { error: Some(ServoError::Access), data: vec![], ..status };
        line.other.write_all(&refusal.encode()?).expect("sent");
        prop_assert!(line.bus.read_status_response(0).is_err());
    }
}
