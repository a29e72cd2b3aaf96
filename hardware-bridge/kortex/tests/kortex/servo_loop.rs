//! The loop in its own thread, in real time.

use std::time::{Duration, Instant};

use kinova_kortex::JOINTS;
use kinova_kortex::emulator::{Emulator, Injection};
use kinova_kortex::message::ArmState;
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::servo_loop::{Pacing, ServoLoop};
use kinova_kortex::{CommandError, KortexError};

use crate::support::*;

fn start(host_deadline: Duration) -> (Emulator, ServoLoop) {
    let emulator = patient_emulator();
    let pacing = Pacing { tick: Duration::from_millis(10), host_deadline };
    let servo_loop = ServoLoop::start(host(&emulator), patient_limits(), pacing).expect("enters");
    (emulator, servo_loop)
}

/// A controller at 100 Hz leads all joints along. The arm gets commands without jumps and arrives.
#[test]
fn targets_become_smooth_commands() {
    let (emulator, servo_loop) = start(TEST_TIMEOUT);
    let home = servo_loop.snapshot().command;
    let mut next = Instant::now();
    for tick in 1..=100 {
        let target = home.map(|angle| angle + 0.004 * f64::from(tick));
        servo_loop.set_target(target).expect("within range");
        next += Duration::from_millis(10);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    let target = home.map(|angle| angle + 0.4);
    let arrived = |angles: [f64; JOINTS]| (0..JOINTS).all(|i| (angles[i] - target[i]).abs() < 1e-4);
    until("the arm is there", || arrived(servo_loop.snapshot().feedback.motion.position));
    for (step, allowed) in emulator.status().commands.largest_step.iter().zip(limits().step) {
        // Tolerance for the wire's single precision.
        assert!(*step <= allowed + 1e-6, "step {step}");
    }
    let (arm, result) = servo_loop.finish();
    result.expect("ended as asked");
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
    arm.close().expect("closes");
}

/// The controller hangs but the loop does not. It stops the arm on its way, holds it, and goes on when the controller
/// is back.
#[test]
fn a_silent_controller_stops_the_arm() {
    let (emulator, servo_loop) = start(Duration::from_millis(100));
    let home = servo_loop.snapshot().command;
    let mut far = home;
    far[0] += 20.0;
    until("the arm is on its way", || {
        servo_loop.set_target(far).expect("a joint without end stops");
        servo_loop.snapshot().command[0] > home[0]
    });
    until("the silence is noticed", || servo_loop.snapshot().host_silent);
    let stopped = servo_loop.snapshot().command;
    assert!(stopped[0] > home[0] && stopped[0] < far[0]);
    let cycles = servo_loop.snapshot().counters.sent;
    until("a hundred cycles more", || servo_loop.snapshot().counters.sent > cycles + 100);
    let snapshot = servo_loop.snapshot();
    assert_eq!((snapshot.command, snapshot.host_silent, snapshot.ended), (stopped, true, false));
    assert_eq!(emulator.status().state, ArmState::ServoingLowLevel);
    until("it goes back", || {
        servo_loop.set_target(home).expect("within range");
        !servo_loop.snapshot().host_silent && (servo_loop.snapshot().command[0] - home[0]).abs() < 1e-9
    });
}

#[test]
fn impossible_targets_are_refused() {
    let (_emulator, servo_loop) = start(TEST_TIMEOUT);
    let mut target = servo_loop.snapshot().command;
    target[1] = 3.0;
    assert!(matches!(servo_loop.set_target(target), Err(CommandError::Range { joint: 2, .. })));
    target[1] = f64::NAN;
    assert!(matches!(servo_loop.set_target(target), Err(CommandError::NotFinite { joint: 2, .. })));
}

/// A fault ends the loop, and the arm is returned with the reason.
#[test]
fn a_fault_ends_the_loop() {
    let (emulator, servo_loop) = start(TEST_TIMEOUT);
    emulator.inject(Injection::EmergencyStop(true));
    until("the loop has ended", || servo_loop.snapshot().ended);
    let (mut arm, result) = servo_loop.finish();
    assert!(matches!(result, Err(KortexError::EmergencyStop(_))), "{result:?}");
    assert_eq!(arm.base.arm_state().expect("still connected"), ArmState::InFault);
}

#[test]
fn an_entry_that_fails_says_why() {
    let emulator = patient_emulator();
    let arm = host(&emulator);
    emulator.inject(Injection::EmergencyStop(true));
    let pacing = Pacing { tick: Duration::from_millis(10), host_deadline: TEST_TIMEOUT };
    let error = ServoLoop::start(arm, limits(), pacing).expect_err("pressed");
    assert_eq!(error.reason(), Some(kinova_kortex::refusal::Reason::EmergencyStop), "{error}");
}
