//! Loss of the arm: keeping of sessions, and the distinction of the reasons for the end of servoing.

use std::time::{Duration, Instant};

use kinova_kortex::emulator::{Emulator, EventKind, Injection, Pace};
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::servoing::{Servoing, ServoingLimits};
use kinova_kortex::{Arm, KortexError, Timeouts};

use crate::support::*;

/// Watchdog timeout for tests in which it must not trip, ms.
const NEVER: u64 = 3_600_000;
const MILLISECOND: Duration = Duration::from_millis(1);

/// Timeouts whose session lasts `session` without a call.
fn short(session: Duration) -> Timeouts {
    Timeouts { session, keep_alive: Duration::from_millis(5), ..timeouts() }
}

fn connected(emulator: &Emulator, timeouts: Timeouts) -> Arm {
    Arm::connect(emulator.address(), &credentials(), timeouts, home_posture()).expect("connects")
}

/// Keep-alives are not calls: a session without other calls would end with its timeout, in the middle of servoing. The
/// arm's time passes no faster than the host's, so that a machine that stalls stalls both.
#[test]
fn servoing_outlives_the_session_timeout() {
    let emulator = emulator();
    let session = Duration::from_millis(600);
    let mut arm = connected(&emulator, short(session));
    let sessions = emulator.status().sessions;
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    for cycle in 0..2000 {
        std::thread::sleep(MILLISECOND);
        servoing.hold(soon()).unwrap_or_else(|error| panic!("lost after {cycle} ms: {error}"));
        emulator.step(1);
    }
    servoing.leave().expect("leaves");
    assert_eq!(emulator.status().sessions, sessions);
}

/// An idle arm, as while an operator is asked something, outlives the session timeout too: over TCP and over UDP.
#[test]
fn an_idle_arm_outlives_the_session_timeout() {
    let emulator = emulator();
    let mut arm = connected(&emulator, short(Duration::from_millis(600)));
    let sessions = emulator.status().sessions;
    for cycle in 0..2000 {
        std::thread::sleep(MILLISECOND);
        arm.keep_up().unwrap_or_else(|error| panic!("lost after {cycle} ms: {error}"));
        emulator.step(1);
    }
    assert_eq!(emulator.status().sessions, sessions);
    arm.base.clear_faults().expect("still ours");
}

/// Servoes on an arm with this watchdog, ms, until `end` has done its work and the host notices. Returns the error.
fn ended(cyclic_deadline: u64, timeouts: Timeouts, limits: ServoingLimits, end: impl FnOnce(&Emulator)) -> KortexError {
    let emulator = emulator_with(home_posture(), Pace::Stepped, cyclic_deadline);
    let mut arm = connected(&emulator, timeouts);
    let mut servoing = Servoing::enter(&mut arm, limits).expect("enters");
    for _ in 0..50 {
        servoing.hold(soon()).expect("holds");
        emulator.step(1);
    }
    end(&emulator);
    servoing.hold(soon()).expect_err("over")
}

#[test]
fn a_second_client_is_told() {
    let error = ended(NEVER, timeouts(), limits(), |emulator| {
        host(emulator).base.set_servoing_mode(ServoingMode::SingleLevel).expect("takes over");
    });
    assert!(matches!(error, KortexError::TakenOver { found: ServoingMode::SingleLevel }), "{error}");
}

/// The arm forgets the sessions, through no fault of this program.
#[test]
fn an_arm_that_restarted_is_told() {
    let error = ended(NEVER, timeouts(), limits(), |emulator| emulator.inject(Injection::ForgetSessions));
    assert!(matches!(error, KortexError::SessionLost { .. }), "{error}");
}

/// This program stands still for longer than its session allows, and loses the arm by its own fault.
#[test]
fn a_session_that_ran_out_is_told() {
    let timeouts = Timeouts { connection: Duration::from_millis(200), ..timeouts() };
    let held_up = |emulator: &Emulator| {
        std::thread::sleep(Duration::from_millis(300));
        emulator.step(300);
    };
    let error = ended(NEVER, timeouts, limits(), held_up);
    let KortexError::SessionExpired { silent, allowed, .. } = error else { panic!("{error}") };
    assert!(silent >= Duration::from_millis(300) && allowed == Duration::from_millis(200), "{error}");
}

/// This program sends nothing for longer than the arm's watchdog waits.
#[test]
fn a_busy_computer_is_told() {
    let late = |emulator: &Emulator| {
        std::thread::sleep(Duration::from_millis(100));
        emulator.step(60);
    };
    let error = ended(50, timeouts(), limits(), late);
    let KortexError::HostLate { gap, .. } = &error else { panic!("{error}") };
    assert!(*gap >= Duration::from_millis(100), "{error}");
    assert!(error.to_string().contains("joint 7: watchdog"), "{error}");
}

/// Commands are sent in time but do not arrive.
#[test]
fn a_lossy_network_is_told() {
    let emulator = emulator_with(home_posture(), Pace::Stepped, 50);
    let mut arm = host(&emulator);
    // Commands are in time on any busy machine.
    let mut servoing = Servoing::enter(&mut arm, ServoingLimits { cycle: TEST_TIMEOUT, ..limits() }).expect("enters");
    emulator.inject(Injection::LoseCommands(1.0));
    for _ in 0..60 {
        assert!(!servoing.hold(Instant::now() + Duration::from_micros(100)).expect("not noticed yet"));
        emulator.step(1);
    }
    emulator.inject(Injection::LoseCommands(0.0));
    let error = servoing.hold(soon()).expect_err("stopped");
    let KortexError::CommandsLost { missed, sent, .. } = error else { panic!("{error}") };
    assert!(missed >= 60 && sent > missed, "{error}");
}

/// A single lost datagram does not mean that the arm does not answer.
#[test]
fn lost_measurements_are_asked_for_again() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    emulator.inject(Injection::LoseReplies(0.5));
    for _ in 0..20 {
        arm.cyclic.feedback().expect("comes in the end");
    }
}

/// A command that has arrived but was not read yet does not count as missing: time does not advance before it is read.
#[test]
fn a_command_that_waits_in_the_socket_is_not_missing() {
    let emulator = emulator_with(home_posture(), Pace::Stepped, 2);
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, patient_limits()).expect("enters");
    let before = emulator.status().commands.followed;
    for cycle in 1..=500 {
        // The command is sent without waiting for the answer.
        servoing.hold(Instant::now()).expect("sent");
        emulator.step(1);
        assert_eq!(emulator.status().commands.followed, before + cycle, "a command was passed over");
    }
    assert_eq!(time_of(&emulator, EventKind::Watchdog), None);
}
