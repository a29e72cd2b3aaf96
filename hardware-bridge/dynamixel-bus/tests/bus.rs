//! The bus against servos on a pseudo-terminal.

#[path = "support/responder.rs"]
mod responder;

use std::os::fd::AsRawFd as _;
use std::sync::mpsc;
use std::time::Duration;

use dynamixel_bus::models::{xl330_m288, xm430_w350};
use dynamixel_bus::protocol2::{BulkRead, BulkWrite};
use dynamixel_bus::register::Register;
use dynamixel_bus::xc330::{self, GOAL_POSITION, LED, PRESENT_POSITION, PRESENT_TEMPERATURE, TORQUE_ENABLE};
use dynamixel_bus::{BusError, BusSettings, Direction, ReplyError, ServoBus, ServoError, Status, Tap};
use responder::Responder;
use serial2::SerialPort;

const IDS: [u8; 3] = [1, 2, 7];

/// Settings whose time-out is longer than any answer takes on a busy machine.
fn patient() -> BusSettings {
    BusSettings { slack: 2.0, ..BusSettings::default() }
}

fn start() -> (Responder, ServoBus) {
    let servos = Responder::start(&xl330_m288::MODEL, &IDS).expect("a pseudo-terminal");
    let bus = ServoBus::open(&servos.path, patient()).expect("the bus opens");
    (servos, bus)
}

#[test]
fn pings_and_scans() {
    let (_servos, mut bus) = start();
    let found = bus.scan(Duration::from_millis(300)).expect("the port works");
    assert_eq!(found.iter().map(|servo| servo.id).collect::<Vec<_>>(), IDS);
    assert!(found.iter().all(|servo| servo.model == xl330_m288::MODEL.number));
    assert_eq!(bus.ping(7).expect("there"), found[2]);
    bus.set_slack(0.05);
    assert!(matches!(bus.ping(3), Err(BusError::Reply(ReplyError::Missing(3)))));
}

#[test]
fn reads_writes_and_refusals() {
    let (_servos, mut bus) = start();
    bus.write(2, &LED, 1.0).expect("written");
    bus.expect(2, &LED, 1.0).expect("read back");
    assert!(matches!(bus.expect(2, &LED, 0.0), Err(BusError::ReadBack { id: 2, .. })));
    let refused = bus.write_block(2, PRESENT_TEMPERATURE.address, &[0]).expect_err("read-only");
    assert!(matches!(refused, BusError::Reply(ReplyError::Refused { id: 2, error: ServoError::Access })), "{refused}");
    assert!(matches!(bus.write(2, &xc330::GOAL_CURRENT, 5.0), Err(BusError::Register { id: 2, .. })));
}

/// All four kinds of read that concern several servos return the same.
#[test]
fn group_reads_agree() {
    let (_servos, mut bus) = start();
    let (address, length) = (PRESENT_POSITION.address, 4);
    let reads = IDS.map(|id| BulkRead { id, address, length });
    let replies = [
        bus.sync_read(&IDS, address, length).expect("read"),
        bus.fast_sync_read(&IDS, address, length).expect("read"),
        bus.bulk_read(&reads).expect("read"),
        bus.fast_bulk_read(&reads).expect("read"),
    ];
    let expected = IDS.map(|id| Ok(Status { id, alert: false, error: None, data: vec![0, 8, 0, 0] }));
    assert!(replies.iter().all(|replies| replies[..] == expected), "{replies:?}");
    let angles = bus.sync_read_register(&IDS, &PRESENT_POSITION).expect("read");
    assert!(angles.iter().all(|angle| angle.as_ref().is_ok_and(|angle| (angle - std::f64::consts::PI).abs() < 1e-9)));
}

/// Bulk reads take different registers of each servo, and one that does not exist hides none before it.
#[test]
fn different_registers_and_a_missing_servo() {
    let (_servos, mut bus) = start();
    bus.set_slack(0.1);
    let read = |id, register: &Register| BulkRead { id, address: register.address, length: register.size.into() };
    let reads = [read(1, &PRESENT_TEMPERATURE), read(2, &PRESENT_POSITION), read(3, &LED), read(7, &LED)];
    for replies in [bus.bulk_read(&reads).expect("read"), bus.fast_bulk_read(&reads).expect("read")] {
        assert_eq!(replies[0].as_ref().expect("there").data, [31]);
        assert_eq!(replies[1].as_ref().expect("there").data, [0, 8, 0, 0]);
        assert_eq!(replies[2..], [Err(ReplyError::Missing(3)), Err(ReplyError::Missing(7))]);
    }
    let twice = [read(1, &LED), read(1, &PRESENT_POSITION)];
    assert!(matches!(bus.bulk_read(&twice), Err(BusError::Request(_))));
    assert_eq!(bus.statistics().missing, 4);
}

#[test]
fn group_writes() {
    let (_servos, mut bus) = start();
    assert!(bus.set_torque(&IDS, true).iter().all(Result::is_ok));
    bus.sync_write_values(&GOAL_POSITION, &[(1, 1.0), (2, 2.0), (7, 3.0)]).expect("sent");
    for (id, goal) in [(1, 1.0), (2, 2.0), (7, 3.0)] {
        bus.expect(id, &PRESENT_POSITION, goal).expect("there");
    }
    bus.sync_write_register(&IDS, &LED, 1.0).expect("sent");
    assert_eq!(bus.sync_read_register(&IDS, &LED).expect("read"), [Ok(1.0), Ok(1.0), Ok(1.0)]);
    bus.bulk_write(&[
        BulkWrite { id: 1, address: LED.address, data: vec![0] },
        BulkWrite { id: 7, address: TORQUE_ENABLE.address, data: vec![0] },
    ])
    .expect("sent");
    bus.expect(1, &LED, 0.0).expect("written");
    bus.expect(7, &TORQUE_ENABLE, 0.0).expect("written");
    assert_eq!(bus.statistics().sync_writes, 3);
}

#[test]
fn registered_writes_wait_for_the_action() {
    let (_servos, mut bus) = start();
    bus.reg_write(1, &LED, 1.0).expect("taken");
    bus.reg_write(2, &LED, 1.0).expect("taken");
    assert_eq!(bus.sync_read_register(&IDS, &LED).expect("read"), [Ok(0.0), Ok(0.0), Ok(0.0)]);
    bus.action().expect("sent");
    assert_eq!(bus.sync_read_register(&IDS, &LED).expect("read"), [Ok(1.0), Ok(1.0), Ok(0.0)]);
}

#[test]
fn a_tap_gets_both_directions() {
    let (_servos, mut bus) = start();
    let (packets, record) = mpsc::channel();
    bus.tap(Tap::new(move |direction, bytes| drop(packets.send((direction, bytes.to_vec())))));
    bus.ping(1).expect("there");
    drop(bus);
    let record: Vec<(Direction, Vec<u8>)> = record.iter().collect();
    assert_eq!(record[0], (Direction::Sent, vec![0xFF, 0xFF, 0xFD, 0, 1, 3, 0, 1, 0x19, 0x4E]));
    let received: Vec<u8> = record[1..].iter().flat_map(|(_, bytes)| bytes.clone()).collect();
    assert!(record[1..].iter().all(|(direction, _)| *direction == Direction::Received));
    assert_eq!(received[7..12], [0x55, 0, 0xB0, 0x04, 52]);
}

/// The unit of current is the model's.
#[test]
fn another_model() {
    let servos = Responder::start(&xm430_w350::MODEL, &[5]).expect("a pseudo-terminal");
    let mut bus = ServoBus::open(&servos.path, patient()).expect("the bus opens");
    bus.write(5, &xm430_w350::GOAL_CURRENT, 0.269).expect("written");
    assert_eq!(bus.read_block(5, 102, 2).expect("read").data, [100, 0]);
}

#[test]
fn a_port_that_is_not_there() {
    let error = ServoBus::open("/dev/no-such-port", BusSettings::default()).expect_err("absent");
    assert!(error.to_string().starts_with("/dev/no-such-port: "), "{error}");
}

#[test]
fn settings_without_a_time_out() {
    let (servos, mut bus) = start();
    for slack in [-1.0, f64::NAN, f64::INFINITY] {
        bus.set_slack(slack);
        assert!(matches!(bus.ping(1), Err(BusError::Settings(_))), "{slack}");
        assert!(matches!(bus.fast_sync_read(&IDS, 0, 2), Err(BusError::Settings(_))), "{slack}");
    }
    for settings in [BusSettings { baud: 0, ..patient() }, BusSettings { return_delay: f64::NAN, ..patient() }] {
        let error = ServoBus::open(&servos.path, settings).expect_err("refused").to_string();
        assert!(error.starts_with("bus settings: found BusSettings"), "{error}");
    }
}

/// A late answer that comes after the next request was sent is not taken for the answer to it.
#[test]
fn a_late_answer_is_not_mistaken() {
    let (device, host) = SerialPort::pair().expect("a pseudo-terminal");
    let path = std::fs::read_link(format!("/proc/self/fd/{}", host.as_raw_fd())).expect("its path");
    let settings = BusSettings { slack: 20.0, ..BusSettings::default() };
    let mut bus = ServoBus::open(path, settings).expect("the bus opens");
    let answer = |data: &[u8]| {
        let status = Status { id: 6, alert: false, error: None, data: data.to_vec() };
        status.encode().expect("a packet")
    };
    let (late, own) = (answer(&[7; 21]), answer(&[1]));
    let servo = std::thread::spawn(move || {
        let mut question = [0; 64];
        device.read(&mut question).expect("a question");
        device.write_all(&late).expect("written");
        std::thread::sleep(Duration::from_millis(50));
        device.write_all(&own).expect("written");
        device
    });
    assert_eq!(bus.read_block(6, TORQUE_ENABLE.address, 1).expect("an answer").data, [1]);
    servo.join().expect("the servo");
}
