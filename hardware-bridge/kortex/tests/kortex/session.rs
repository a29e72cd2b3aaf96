//! Sessions, calls, notifications, joint speeds.

use std::time::Duration;

use kinova_kortex::JOINTS;
use kinova_kortex::base::{Base, Notification};
use kinova_kortex::call::{self, Call};
use kinova_kortex::emulator::{EventKind, Injection, Pace};
use kinova_kortex::link::{TcpLink, UdpLink};
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::message::device::{ControlMode, DeviceType, SafetyStatus};
use kinova_kortex::message::{ArmState, Empty};
use kinova_kortex::refusal::Reason;
use kinova_kortex::session::Session;
use kinova_kortex::{Arm, CommandError, Credentials, KortexError, Timeouts};

use crate::support::*;

#[test]
fn sessions_open_and_close_on_both_sides() {
    let emulator = emulator();
    let arm = host(&emulator);
    let (tcp, udp) = (arm.base.session().number(), arm.cyclic.session().number());
    assert_eq!(emulator.status().sessions, [tcp, udp]);
    arm.close().expect("closes");
    assert!(emulator.status().sessions.is_empty());
    assert!(time_of(&emulator, EventKind::SessionClosed(udp)).is_some());
}

#[test]
fn a_dropped_session_says_goodbye() {
    let emulator = emulator();
    drop(host(&emulator));
    until("both sessions are closed", || emulator.status().sessions.is_empty());
}

#[test]
fn wrong_credentials_are_named() {
    let emulator = emulator();
    for (user, password) in [("admin", "guess"), ("nobody", "admin")] {
        let credentials = Credentials { user: user.to_owned(), password: password.to_owned() };
        let error = Arm::connect(emulator.address(), &credentials, timeouts(), home_posture()).expect_err("refused");
        assert_eq!(error.reason(), Some(Reason::Login), "{error}");
    }
    assert!(emulator.status().sessions.is_empty());
}

#[test]
fn devices_are_found_in_order() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    let kinds: Vec<DeviceType> = base.devices().expect("devices").iter().map(|device| device.kind).collect();
    assert_eq!(
        (kinds[0], kinds[1], kinds[5], kinds[8]),
        (DeviceType::Base, DeviceType::BigActuator, DeviceType::SmallActuator, DeviceType::Interconnect)
    );
    assert_eq!(base.actuators().expect("actuators"), [1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(base.serial_number(3).expect("serial number"), "EMULATED-3");
    assert_eq!(base.control_mode(7).expect("control mode"), ControlMode::Position);
    assert_eq!(base.arm_state().expect("state"), ArmState::ServoingReady);
    assert_eq!(base.servoing_mode().expect("mode"), ServoingMode::SingleLevel);
}

#[test]
fn measured_angles_are_in_radians() {
    let mut posture = home_posture();
    posture[3] = -2.2;
    let emulator = emulator_at(posture, Pace::Stepped);
    let angles = host(&emulator).base.joint_angles().expect("angles");
    for (i, (found, expected)) in angles.iter().zip(posture).enumerate() {
        // Joint 3 stands at half a turn, which may be read as either sign.
        assert!((found.abs() - expected.abs()).abs() < 1e-6, "joint {}: {found} for {expected}", i + 1);
    }
    assert!(angles[3] < 0.0);
}

/// A call that a Gen3 refuses too: the cyclic command without an answer.
#[test]
fn an_unknown_call_is_refused_by_name() {
    let emulator = emulator();
    let link = UdpLink::connect(emulator.address().udp).expect("binds");
    let mut session = Session::create(link, &credentials(), timeouts(), call::REFRESH_FEEDBACK).expect("logs in");
    let error = session.call::<Empty>(Call { service: 3, function: 2 }, 0, &Empty {}).expect_err("refused");
    assert_eq!(error.reason(), Some(Reason::Unsupported));
    assert!(error.to_string().starts_with("3.2: not supported"), "{error}");
}

/// A session belongs to the connection that opened it.
#[test]
fn a_forgotten_session_is_lost() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    emulator.inject(Injection::ForgetSessions);
    let session = arm.base.session().number();
    let error = arm.base.arm_state().expect_err("lost");
    assert!(matches!(error, KortexError::SessionLost { session: lost, .. } if lost == session), "{error}");
    let error = arm.cyclic.feedback().expect_err("lost");
    assert!(matches!(error, KortexError::SessionLost { .. }), "{error}");
}

/// Sessions that are kept alive outlive their timeout; others end with it.
#[test]
fn keep_alives_keep_sessions_alive() {
    let emulator = emulator_at(home_posture(), Pace::RealTime);
    let connection = Duration::from_secs(2);
    let timeouts = Timeouts { connection, keep_alive: Duration::from_millis(20), ..timeouts() };
    let mut arm = Arm::connect(emulator.address(), &credentials(), timeouts, home_posture()).expect("connects");
    let (start, sessions) = (emulator.status().time, emulator.status().sessions);
    until("two timeouts have passed", || {
        arm.keep_up().expect("kept up");
        emulator.status().time > start + 4000
    });
    assert_eq!(emulator.status().sessions, sessions);
    until("the sessions have expired", || emulator.status().sessions.is_empty());
    let error = arm.base.arm_state().expect_err("expired");
    assert!(matches!(error, KortexError::SessionExpired { allowed, .. } if allowed == connection), "{error}");
}

#[test]
fn a_deaf_arm_is_a_timeout_and_then_silence() {
    let emulator = emulator();
    let timeouts = Timeouts {
        call: Duration::from_secs(2),
        connection: Duration::from_secs(4),
        keep_alive: Duration::from_millis(20),
        ..Timeouts::default()
    };
    let link = TcpLink::connect(emulator.address().tcp, TEST_TIMEOUT).expect("connects");
    let mut session = Session::create(link, &credentials(), timeouts, call::GET_ARM_STATE).expect("logs in");
    emulator.inject(Injection::Deaf(true));
    let state = kinova_kortex::call::GET_ARM_STATE;
    let error = session.call::<Empty>(state, 0, &Empty {}).expect_err("no answer");
    assert!(matches!(error, KortexError::Timeout { call, .. } if call == state), "{error}");
    let mut ended = None;
    until("the silence is noticed", || {
        ended = session.keep_up().err();
        ended.is_some()
    });
    assert!(matches!(ended, Some(KortexError::Silent { .. })), "{ended:?}");
}

#[test]
fn an_arm_that_is_switched_off_closes_the_connection() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    drop(emulator);
    let error = base.arm_state().expect_err("gone");
    assert!(matches!(error, KortexError::Link(_)), "{error}");
}

#[test]
fn nobody_there_is_an_error_of_the_link() {
    let address = emulator().address();
    let error = Arm::connect(address, &credentials(), timeouts(), home_posture()).expect_err("nobody there");
    assert!(matches!(error, KortexError::Link(_)), "{error}");
}

fn only(joint: usize, value: f64) -> [f64; JOINTS] {
    std::array::from_fn(|i| if i + 1 == joint { value } else { 0.0 })
}

#[test]
fn joint_speeds_move_the_arm_until_stop() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    let before = emulator.status().motion.position[4];
    base.send_joint_speeds(&only(5, -0.4), &TOP_SPEED).expect("accepted");
    emulator.step(1000);
    assert_eq!(base.arm_state().expect("state"), ArmState::ServoingManuallyControlled);
    let way = emulator.status().motion.position[4] - before;
    // The speed follows with the joints' lag, so the distance is speed * (time - lag).
    assert!((way + 0.4 * (1.0 - LAG)).abs() < 1e-3, "way {way}");
    base.stop().expect("stops");
    emulator.step(200);
    assert!(time_of(&emulator, EventKind::StandsStill).is_some());
    assert_eq!(base.arm_state().expect("state"), ArmState::ServoingReady);
}

#[test]
fn bad_speeds_are_not_sent() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    let error = base.send_joint_speeds(&only(6, 1.3), &TOP_SPEED).expect_err("too fast");
    assert!(matches!(error, KortexError::Command(CommandError::Speed { joint: 6, .. })), "{error}");
    let error = base.send_joint_speeds(&only(2, f64::NAN), &TOP_SPEED).expect_err("no number");
    assert!(matches!(error, KortexError::Command(CommandError::NotFinite { joint: 2, .. })), "{error}");
    emulator.step(10);
    assert_eq!(emulator.status().motion.velocity, [0.0; JOINTS]);
}

/// If the host is gone, only its session's timeout stops joint speeds.
#[test]
fn speeds_end_with_their_session() {
    let emulator = emulator();
    let timeouts = Timeouts { call: TEST_TIMEOUT, ..Timeouts::default() };
    let mut base = Arm::connect(emulator.address(), &credentials(), timeouts, home_posture()).expect("connects").base;
    base.send_joint_speeds(&only(1, 0.2), &TOP_SPEED).expect("accepted");
    // The connection stays open and silent, as that of a frozen host.
    std::mem::forget(base);
    emulator.step(2000);
    assert!(emulator.status().motion.velocity[0] > 0.19, "still moving after 2 s");
    emulator.step(200);
    assert!(emulator.status().motion.velocity[0].abs() < 1e-3, "stopped after its timeout");
}

#[test]
fn low_level_mode_refuses_high_level_motion() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    base.set_servoing_mode(ServoingMode::LowLevel).expect("changes");
    for error in
        [base.send_joint_speeds(&only(1, 0.1), &TOP_SPEED), base.stop()].map(|result| result.expect_err("refused"))
    {
        assert_eq!(error.reason(), Some(Reason::ServoingMode), "{error}");
    }
}

#[test]
fn events_are_told() {
    let emulator = emulator();
    let mut base = host(&emulator).base;
    let actuators = base.actuators().expect("actuators");
    base.subscribe(&actuators).expect("subscribes");
    let told = |base: &mut Base| {
        // The answer to a call comes after all notifications sent before it.
        base.arm_state().expect("state");
        std::iter::from_fn(|| base.next_notification().expect("readable")).collect::<Vec<_>>()
    };
    assert_eq!(told(&mut base), []);
    base.set_servoing_mode(ServoingMode::LowLevel).expect("changes");
    assert_eq!(
        told(&mut base),
        [Notification::ArmState(ArmState::ServoingLowLevel), Notification::ServoingMode(ServoingMode::LowLevel)]
    );
    emulator.inject(Injection::JointFault { joint: 2, bits: 0x2000 });
    assert_eq!(
        told(&mut base),
        [
            Notification::ArmState(ArmState::InFault),
            Notification::Safety { device: 0, bit: 0x10, status: SafetyStatus::Error },
            Notification::Safety { device: 3, bit: 0x2000, status: SafetyStatus::Error },
        ]
    );
    base.clear_faults().expect("clears");
    base.emergency_stop().expect("stops");
    let told = told(&mut base);
    let stop = Notification::Safety { device: 0, bit: 1 << 23, status: SafetyStatus::Error };
    assert!(told.contains(&stop) && told.contains(&Notification::ArmState(ArmState::InFault)), "{told:?}");
}
