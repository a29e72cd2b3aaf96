//! The bus master against six emulated servos, through a pseudo-terminal. The servos' time advances only in steps.

use dynamixel_bus::protocol2::{ReplyError, ServoError};
use dynamixel_bus::servo_bus::{BusError, BusSettings, ServoBus};
use dynamixel_bus::xc330::{self, PRESENT_BLOCK};
use hand_model::RobotModel;
use hardware_bridge::clock::Clock;
use hardware_bridge::emulator::faults::{FaultEvent, FaultProbabilities};
use hardware_bridge::emulator::spring_hand::SpringHand;
use hardware_bridge::emulator::{EmulatedHand, EmulatorSettings};
use hardware_bridge::supported_robot::SERVOS;

const IDS: [u8; 6] = [1, 2, 3, 4, 5, 6];

/// Time-out longer than any answer takes on a busy machine, so that only what was injected goes missing.
const REPLY_SLACK: f64 = 2.0;

fn start() -> (EmulatedHand, ServoBus) {
    let (plant, settings) = (SpringHand::new([4.0; SERVOS], 18), EmulatorSettings::default());
    let robot = RobotModel::ftac_gen3();
    let hand =
        EmulatedHand::start_stepped(Box::new(plant), settings, &robot, Clock::emulated()).expect("the emulator starts");
    let settings = BusSettings { slack: REPLY_SLACK, ..BusSettings::default() };
    let bus = ServoBus::open(hand.servo_port(), settings).expect("the bus opens");
    (hand, bus)
}

/// Lets `seconds` of the emulated time pass.
fn pass(hand: &mut EmulatedHand, seconds: f64) {
    let mut left = seconds;
    while left > 0.0 {
        left -= hand.step();
    }
}

fn present(bus: &mut ServoBus) -> Vec<Result<Vec<u8>, ReplyError>> {
    let length = PRESENT_BLOCK.end - PRESENT_BLOCK.start;
    let replies = bus.sync_read(&IDS, PRESENT_BLOCK.start, length).expect("the port works");
    replies.into_iter().map(|reply| reply.map(|status| status.data)).collect()
}

#[test]
fn reads_writes_and_refusals() {
    let (_hand, mut bus) = start();
    for id in IDS {
        assert_eq!(bus.ping(id).expect("there").model, xc330::MODEL.number);
    }
    assert!(matches!(bus.ping(9), Err(BusError::Reply(ReplyError::Missing(9)))));
    assert!((bus.read(2, &xc330::PRESENT_INPUT_VOLTAGE).expect("read") - 11.1).abs() < 1e-9);
    bus.write(2, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    let refused = bus.write(2, &xc330::ID, 8.0).expect_err("locked");
    assert!(matches!(refused, BusError::Reply(ReplyError::Refused { id: 2, error: ServoError::Access })), "{refused}");
    assert!(matches!(bus.write(2, &xc330::GOAL_CURRENT, 5.0), Err(BusError::Register { id: 2, .. })));
    assert_eq!(present(&mut bus).iter().filter(|reply| reply.is_ok()).count(), 6);
}

/// Both kinds of sync read return the same for shafts at rest.
#[test]
fn fast_sync_read_agrees() {
    let (_hand, mut bus) = start();
    let slow = bus.sync_read(&IDS, xc330::ID.address, 4).expect("read");
    let fast = bus.fast_sync_read(&IDS, xc330::ID.address, 4).expect("read");
    assert_eq!(slow, fast);
    assert!(slow.iter().all(Result::is_ok));
}

/// A goal given by sync write moves the shaft; torque off lets the spring open it.
#[test]
fn closes_and_opens() {
    let (mut hand, mut bus) = start();
    assert!(bus.set_torque(&IDS, true).iter().all(Result::is_ok));
    let start: Vec<f64> = IDS.iter().map(|id| bus.read(*id, &xc330::PRESENT_POSITION).expect("read")).collect();
    let goals = IDS.iter().zip(&start);
    let goals = goals.map(|(id, at)| (*id, xc330::GOAL_POSITION.write(at + 1.0).expect("fits"))).collect();
    bus.sync_write_register(&IDS, &xc330::GOAL_CURRENT, 0.4).expect("written");
    bus.sync_write(xc330::GOAL_POSITION.address, 4, goals).expect("written");
    // A sync write has no answer: the answer to the next instruction confirms that it has arrived.
    bus.ping(1).expect("there");
    pass(&mut hand, 0.8);
    assert!(hand.shafts().iter().all(|shaft| (0.8..1.1).contains(&shaft.position)), "{:?}", hand.shafts());
    assert!(bus.set_torque(&IDS, false).iter().all(Result::is_ok));
    pass(&mut hand, 4.0);
    assert!(hand.shafts().iter().all(|shaft| shaft.position < 0.2), "{:?}", hand.shafts());
}

/// On a bad line most answers come through, none is wrong, and the statistics count what happened.
#[test]
fn partial_results_on_a_bad_line() {
    let (hand, mut bus) = start();
    let expected = present(&mut bus);
    assert!(expected.iter().all(Result::is_ok));
    // Each lost answer costs this time-out: just long enough to tell late from lost on a busy machine.
    bus.set_slack(0.5);
    hand.set_fault_probabilities(FaultProbabilities {
        noise: 0.3,
        drop: 0.05,
        corrupt: 0.04,
        ..FaultProbabilities::default()
    });
    let cycles = 20;
    let mut good = 0;
    for _ in 0..cycles {
        for (reply, expected) in present(&mut bus).iter().zip(&expected) {
            if let Ok(data) = reply {
                good += 1;
                assert_eq!(Ok(data), expected.as_ref());
            }
        }
    }
    let share = f64::from(good) / f64::from(6 * cycles);
    assert!((0.7..0.99).contains(&share), "{share}");
    let statistics = bus.statistics();
    assert!(statistics.missing > 0 && statistics.garbage_bytes > 0 && statistics.bad_crc > 0, "{statistics:?}");
}

#[test]
fn overload_needs_a_reboot() {
    let (mut hand, mut bus) = start();
    bus.write(3, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    hand.inject(FaultEvent::Overload(3));
    let replies = bus.sync_read(&IDS, PRESENT_BLOCK.start, 10).expect("read");
    let alerts: Vec<bool> = replies.iter().map(|reply| reply.as_ref().is_ok_and(|status| status.alert)).collect();
    assert_eq!(alerts, [false, false, true, false, false, false]);
    assert!(bus.write(3, &xc330::TORQUE_ENABLE, 1.0).is_err());
    bus.reboot(3).expect("obeys");
    assert!(bus.ping(3).is_err(), "it is off the bus for a moment");
    pass(&mut hand, 0.45);
    bus.ping(3).expect("back");
    bus.write(3, &xc330::TORQUE_ENABLE, 1.0).expect("on again");
}

/// The servos' watchdog stops them when the host falls silent, and goals are refused until it is cleared.
#[test]
fn servo_watchdog() {
    let (mut hand, mut bus) = start();
    bus.write(1, &xc330::TORQUE_ENABLE, 1.0).expect("on");
    bus.write(1, &xc330::BUS_WATCHDOG, 0.1).expect("armed");
    bus.write(1, &xc330::GOAL_CURRENT, 0.3).expect("set");
    let at = bus.read(1, &xc330::PRESENT_POSITION).expect("read");
    bus.write(1, &xc330::GOAL_POSITION, at + 3.5).expect("set");
    pass(&mut hand, 0.4);
    assert!(bus.read(1, &xc330::BUS_WATCHDOG).expect("read") < 0.0, "tripped");
    let stopped = hand.shafts()[0].position;
    assert!(stopped < 2.0, "{stopped}");
    pass(&mut hand, 0.2);
    assert!((hand.shafts()[0].position - stopped).abs() < 0.1, "it stands still");
    assert!(bus.write(1, &xc330::GOAL_POSITION, at).is_err());
    bus.write(1, &xc330::BUS_WATCHDOG, 0.0).expect("cleared");
    bus.write(1, &xc330::GOAL_POSITION, at).expect("accepted");
}

/// A packet that waits in the pseudo-terminal because the machine is busy feeds the bus watchdog: it has arrived.
#[test]
fn a_packet_that_waits_to_be_read_is_not_missing() {
    let (mut hand, mut bus) = start();
    for id in IDS {
        bus.write(id, &xc330::TORQUE_ENABLE, 1.0).expect("on");
        bus.write(id, &xc330::BUS_WATCHDOG, 0.02).expect("20 ms");
    }
    for _ in 0..500 {
        // This is not answered, so nobody waits until it is read.
        bus.sync_write_register(&IDS, &xc330::LED, 1.0).expect("sent");
        pass(&mut hand, 0.01);
    }
    assert_eq!(hand.watchdogs_tripped(), 0);
    // Without packets the watchdog trips.
    present(&mut bus);
    pass(&mut hand, 0.05);
    assert_eq!(hand.watchdogs_tripped(), 6);
}
