//! Actions over TCP: the stored ones, and the course of one.

use kinova_kortex::base::Notification;
use kinova_kortex::degrees::difference;
use kinova_kortex::emulator::{Emulator, Injection};
use kinova_kortex::message::ArmState;
use kinova_kortex::message::action::{ActionEvent, ActionType};
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::message::device::DeviceType;
use kinova_kortex::refusal::Reason;
use kinova_kortex::servoing::Servoing;
use kinova_kortex::{Arm, CommandError, JOINTS, KortexError};

use crate::support::*;

const HOME: u32 = 2;
const RETRACT: u32 = 1;

/// An arm at its zero posture, and a host that is notified of its actions.
fn ready() -> (Emulator, Arm) {
    let emulator = emulator_at([0.0; JOINTS], kinova_kortex::emulator::Pace::Stepped);
    let mut arm = host(&emulator);
    arm.base.subscribe_to_actions().expect("subscribes");
    (emulator, arm)
}

/// Returns the notifications since the last call: event, action, reason.
fn told(arm: &mut Arm) -> Vec<(ActionEvent, u32, u32)> {
    // The answer to a call comes after all notifications sent before it.
    arm.base.arm_state().expect("answers");
    let mut all = Vec::new();
    while let Some(notification) = arm.base.next_notification().expect("readable") {
        if let Notification::Action { id, event, why } = notification {
            all.push((event, id, why));
        }
    }
    all
}

fn furthest(emulator: &Emulator, posture: [f64; JOINTS]) -> f64 {
    let position = emulator.status().motion.position;
    (0..JOINTS).map(|i| difference(position[i], posture[i]).abs()).fold(0.0, f64::max)
}

fn fastest(emulator: &Emulator) -> f64 {
    emulator.status().motion.velocity.iter().fold(0.0, |fastest, speed| speed.abs().max(fastest))
}

#[test]
fn stored_actions_are_listed_by_type() {
    let (_emulator, mut arm) = ready();
    for kind in [ActionType::Unspecified, ActionType::ReachJointAngles] {
        let names: Vec<String> = arm.base.actions(kind).expect("lists").into_iter().map(|action| action.name).collect();
        assert_eq!(names, ["Retract", "Home", "Zero"]);
    }
    assert_eq!(arm.base.actions(ActionType::ReachPose).expect("lists"), []);
    let home = arm.base.action(HOME).expect("stored");
    assert_eq!((home.name.as_str(), home.kind), ("Home", ActionType::ReachJointAngles));
    let posture = home.posture.expect("joint angles");
    assert!((0..JOINTS).all(|i| difference(posture[i], home_posture()[i]).abs() < 1e-6), "{posture:?}");
    let error = arm.base.action(77).expect_err("not stored");
    assert_eq!(error.reason(), Some(Reason::InvalidParameter), "{error}");
}

/// Home, from start to end: the state is reported, speeds stay modest, and the end is exact.
#[test]
fn home() {
    let (emulator, mut arm) = ready();
    arm.base.execute_action(HOME).expect("begins");
    assert_eq!(arm.base.arm_state().expect("answers"), ArmState::ServoingPlayingSequence);
    assert_eq!(told(&mut arm), [(ActionEvent::Start, HOME, 0)]);
    let mut top = 0.0_f64;
    while emulator.status().state == ArmState::ServoingPlayingSequence {
        emulator.step(10);
        top = top.max(fastest(&emulator));
        assert!(emulator.status().time < 20_000, "the maker's examples wait for 20 s");
    }
    assert_eq!(told(&mut arm), [(ActionEvent::End, HOME, 0)]);
    assert!((0.4..0.51).contains(&top), "{top}");
    emulator.step(500);
    assert!(furthest(&emulator, home_posture()) < 1e-6);
    assert_eq!(arm.base.arm_state().expect("answers"), ArmState::ServoingReady);
}

/// A posture chosen by the host, reached in the requested time.
#[test]
fn reach_joint_angles_within_a_duration() {
    let (emulator, mut arm) = ready();
    let posture = [0.2, -0.3, 0.1, 0.4, 0.0, -0.2, 0.3];
    arm.base.reach_joint_angles(&posture, Some(2.0)).expect("begins");
    emulator.step(1990);
    assert_eq!(told(&mut arm), [(ActionEvent::Start, 0, 0)]);
    emulator.step(300);
    assert_eq!(told(&mut arm), [(ActionEvent::End, 0, 0)]);
    emulator.step(500);
    assert!(furthest(&emulator, posture) < 1e-6);
}

#[test]
fn stops_in_motion() {
    for by_stop_action in [true, false] {
        let (emulator, mut arm) = ready();
        arm.base.execute_action(HOME).expect("begins");
        emulator.step(3000);
        assert!(fastest(&emulator) > 0.1);
        if by_stop_action { arm.base.stop_action() } else { arm.base.stop() }.expect("stops");
        assert_eq!(told(&mut arm), [(ActionEvent::Start, HOME, 0), (ActionEvent::Abort, HOME, 55)]);
        emulator.step(300);
        assert!(fastest(&emulator) < 1e-3);
        assert!(furthest(&emulator, home_posture()) > 0.5, "on the way");
        assert_eq!(arm.base.arm_state().expect("answers"), ArmState::ServoingReady);
    }
}

#[test]
fn emergency_stop_in_motion() {
    let (emulator, mut arm) = ready();
    arm.base.execute_action(HOME).expect("begins");
    emulator.step(3000);
    emulator.inject(Injection::EmergencyStop(true));
    assert_eq!(told(&mut arm), [(ActionEvent::Start, HOME, 0), (ActionEvent::Abort, HOME, 25)]);
    emulator.step(300);
    assert!(fastest(&emulator) < 1e-3);
    let error = arm.base.execute_action(HOME).expect_err("stopped");
    assert_eq!(error.reason(), Some(Reason::EmergencyStop), "{error}");
    emulator.inject(Injection::EmergencyStop(false));
    arm.base.clear_faults().expect("cleared");
    arm.base.execute_action(HOME).expect("begins again");
}

#[test]
fn a_fault_in_motion() {
    let (emulator, mut arm) = ready();
    arm.base.execute_action(HOME).expect("begins");
    emulator.step(3000);
    emulator.inject(Injection::JointFault { joint: 2, bits: 1 });
    assert_eq!(told(&mut arm), [(ActionEvent::Start, HOME, 0), (ActionEvent::Abort, HOME, 22)]);
    let error = arm.base.execute_action(HOME).expect_err("in fault");
    assert_eq!(error.reason(), Some(Reason::InFault), "{error}");
}

/// Another action and joint speeds take over. The joints brake before another path begins.
#[test]
fn another_command_takes_over() {
    let (emulator, mut arm) = ready();
    arm.base.execute_action(HOME).expect("begins");
    emulator.step(3000);
    arm.base.execute_action(RETRACT).expect("takes over");
    let start = |id| (ActionEvent::Start, id, 0);
    assert_eq!(told(&mut arm), [start(HOME), (ActionEvent::Abort, HOME, 55), start(RETRACT)]);
    let mut before = emulator.status().motion.position;
    for _ in 0..3000 {
        emulator.step(1);
        let now = emulator.status().motion.position;
        assert!((0..JOINTS).all(|i| (now[i] - before[i]).abs() < 0.51e-3), "a jump");
        before = now;
    }
    arm.base.send_joint_speeds(&[0.0; JOINTS], &TOP_SPEED).expect("takes over");
    assert_eq!(told(&mut arm), [(ActionEvent::Abort, RETRACT, 55)]);
}

#[test]
fn pause_and_resume() {
    let (emulator, mut arm) = ready();
    assert!(arm.base.pause_action().is_err(), "there is nothing to pause");
    arm.base.execute_action(HOME).expect("begins");
    emulator.step(3000);
    arm.base.pause_action().expect("pauses");
    emulator.step(300);
    let place = emulator.status().motion.position;
    emulator.step(5000);
    assert_eq!(
        emulator.status().motion.position.map(|angle| (angle * 1e6).round()),
        place.map(|angle| (angle * 1e6).round())
    );
    arm.base.resume_action().expect("goes on");
    assert!(arm.base.resume_action().is_err(), "it goes on already");
    emulator.step(15_000);
    let events: Vec<ActionEvent> = told(&mut arm).into_iter().map(|(event, ..)| event).collect();
    assert_eq!(events, [ActionEvent::Start, ActionEvent::Pause, ActionEvent::Start, ActionEvent::End]);
    assert!(furthest(&emulator, home_posture()) < 1e-6);
}

/// The session that began an action ends: the arm stops.
#[test]
fn a_session_that_ends_stops_its_action() {
    let (emulator, mut arm) = ready();
    arm.base.execute_action(HOME).expect("begins");
    emulator.step(3000);
    arm.close().expect("logs out");
    emulator.step(300);
    assert!(fastest(&emulator) < 1e-3 && furthest(&emulator, home_posture()) > 0.5);
}

#[test]
fn refused_in_low_level_servoing() {
    let (emulator, mut arm) = ready();
    let servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    drop(servoing);
    arm.base.set_servoing_mode(ServoingMode::LowLevel).expect("low level");
    let refusals =
        [arm.base.execute_action(HOME), arm.base.reach_joint_angles(&home_posture(), None), arm.base.stop_action()];
    for refusal in refusals {
        assert_eq!(refusal.expect_err("low level").reason(), Some(Reason::ServoingMode));
    }
    assert_eq!(told(&mut arm), []);
    drop(emulator);
}

#[test]
fn postures_and_durations_that_do_not_fit() {
    let (_emulator, mut arm) = ready();
    let mut posture = [0.0; JOINTS];
    posture[3] = 2.8;
    let error = arm.base.reach_joint_angles(&posture, None).expect_err("beyond the end stop");
    assert_eq!(error.reason(), Some(Reason::JointLimit), "{error}");
    let error = arm.base.reach_joint_angles(&[1.0; JOINTS], Some(0.5)).expect_err("too fast");
    assert_eq!(error.reason(), Some(Reason::Motion), "{error}");
    let error = arm.base.reach_joint_angles(&[f64::NAN; JOINTS], None).expect_err("no number");
    assert!(matches!(error, KortexError::Command(CommandError::NotFinite { joint: 1, .. })), "{error}");
    let error = arm.base.tool_pose().expect_err("bare joints have no tool");
    assert_eq!(error.reason(), Some(Reason::Unsupported), "{error}");
}

#[test]
fn devices_say_what_they_are() {
    let (_emulator, mut arm) = ready();
    assert_eq!(arm.base.device_type(0).expect("base"), DeviceType::Base);
    assert_eq!(arm.base.device_type(7).expect("joint"), DeviceType::SmallActuator);
    assert!(arm.base.firmware_version(0).expect("base") > 0);
    assert_eq!(arm.base.model_number(0).expect("base"), "EMULATED-GEN3");
    assert_eq!(arm.base.part_number(3).expect("joint"), "EMULATED-PART-3");
    let error = arm.base.firmware_version(99).expect_err("there is none");
    assert_eq!(error.reason(), Some(Reason::InvalidParameter), "{error}");
}
