//! Low-level servoing: entry, tracking, checks, exit, and lossy UDP.

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use kinova_kortex::JOINTS;
use kinova_kortex::emulator::{Emulator, EventKind, FirstOrderJoints, Injection, Pace, Settings};
use kinova_kortex::message::ArmState;
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::servoing::{Servoing, ServoingLimits};
use kinova_kortex::{CommandError, KortexError};

use crate::support::*;

/// The arm does not move on entry, wherever it stands, even if an angle on the wire is beyond half a turn.
#[test]
fn entry_is_seeded_with_the_measured_angles() {
    for posture in [home_posture(), [3.5, -2.0, 6.2, 2.5, -3.1, -2.0, 10.0]] {
        let emulator = emulator_at(posture, Pace::Stepped);
        let mut arm = host(&emulator);
        let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
        for _ in 0..20 {
            emulator.step(1);
            servoing.hold(soon()).expect("holds");
        }
        let status = emulator.status();
        assert_eq!(status.state, ArmState::ServoingLowLevel);
        // A float in degrees represents an angle to 2.7e-7 rad.
        assert!(status.commands.seed_error < 1e-6, "seed error {}", status.commands.seed_error);
        for (i, (found, expected)) in status.motion.position.iter().zip(posture).enumerate() {
            assert!((found - expected).abs() < 1e-6, "joint {} moved from {expected} to {found}", i + 1);
        }
    }
}

/// All joints follow a sine, one cycle per millisecond, through the wire's 0. First-order joints have a known error.
#[test]
fn a_sine_is_followed_with_the_error_of_the_joints_lag() {
    let (amplitude, omega) = (0.3, TAU * 0.5);
    let centre = [0.0, 0.3, 6.0, -1.0, 0.0, 0.5, 0.0];
    let emulator = emulator_at(centre, Pace::Stepped);
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    let start = *servoing.command();
    let mut largest: f64 = 0.0;
    for cycle in 1..=4000 {
        let t = f64::from(cycle) * 1e-3;
        let wanted = start.map(|angle| angle + amplitude * (omega * t).sin());
        assert!(servoing.command_angles(&wanted, soon()).expect("follows"));
        emulator.step(1);
        if cycle > 500 {
            let found = emulator.status().motion.position;
            let error = (0..JOINTS).map(|i| (found[i] - centre[i] - (wanted[i] - start[i])).abs()).fold(0.0, f64::max);
            largest = largest.max(error);
        }
    }
    let expected = amplitude * omega * LAG / (1.0 + (omega * LAG).powi(2)).sqrt();
    assert!((largest / expected - 1.0).abs() < 0.03, "largest error {largest}, expected {expected}");
    let counters = servoing.arm().cyclic.counters();
    assert_eq!((counters.answered, counters.missed, counters.lost), (counters.sent, 0, 0));
    let top = emulator.status().commands.largest_step.into_iter().fold(0.0, f64::max);
    assert!(top < amplitude * omega * 1e-3 * 1.01, "largest step {top}");
    servoing.leave().expect("leaves");
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
}

/// A refused command does not reach the arm, and the last good one can be sent instead.
#[test]
fn a_command_far_from_the_arm_is_not_sent() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    let good = *servoing.command();
    let sent = |servoing: &mut Servoing| servoing.arm().cyclic.counters().sent;
    let before = sent(&mut servoing);
    for (joint, bad) in [(1, 0.2), (2, -1.0), (7, f64::NAN), (4, f64::INFINITY)] {
        let mut command = good;
        command[joint - 1] += bad;
        let error = servoing.command_angles(&command, soon()).expect_err("refused");
        let named = match &error {
            KortexError::Command(CommandError::Step { joint, .. } | CommandError::NotFinite { joint, .. }) => *joint,
            _ => panic!("{error}"),
        };
        assert_eq!(named, joint);
    }
    assert_eq!(sent(&mut servoing), before, "something was sent");
    servoing.hold(soon()).expect("holds");
    assert_eq!(sent(&mut servoing), before + 1);
    assert!(emulator.status().commands.largest_step.iter().all(|step| *step < 1e-9));
}

fn creep(top_speed: f64, limits: ServoingLimits) -> (Emulator, KortexError) {
    let plant = FirstOrderJoints::new(home_posture(), LAG, [top_speed; JOINTS]);
    let emulator = Emulator::start(Settings::default(), Box::new(plant), Pace::Stepped).expect("starts");
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits).expect("enters");
    for _ in 0..1000 {
        let mut command = *servoing.command();
        command[1] += 5e-4;
        if let Err(error) = servoing.command_angles(&command, soon()) {
            return (emulator, error);
        }
        emulator.step(1);
    }
    panic!("never refused")
}

/// A blocked arm is not pulled until it trips: the command is refused before.
#[test]
fn a_blocked_arm_refuses_the_command_before_it_trips() {
    let (emulator, error) = creep(0.01, limits());
    assert!(matches!(error, KortexError::Command(CommandError::Lead { joint: 2, .. })), "{error}");
    assert!(emulator.status().faults.is_empty());
}

/// Without that check the arm raises its own following error, which arrives as an error with the joint's name.
#[test]
fn a_following_error_is_named() {
    let (_, error) = creep(0.01, ServoingLimits { lead: [1.0; JOINTS], ..limits() });
    assert!(matches!(error, KortexError::Fault(_)), "{error}");
    assert_eq!(error.to_string(), "the arm is in fault: base: joint fault; joint 2: following error");
}

/// A seeded share of all datagrams is lost both ways. The motion goes on and every cycle is accounted for.
#[test]
fn lost_datagrams_are_counted_and_borne() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    emulator.inject(Injection::LoseCommands(0.05));
    emulator.inject(Injection::LoseReplies(0.05));
    let start = *servoing.command();
    let mut fresh = 0;
    for cycle in 1..=500_i32 {
        let wanted = start.map(|angle| angle + 2e-4 * f64::from(cycle));
        // Any answer comes within this time, unless the machine stalls; then it counts as late.
        let deadline = Instant::now() + Duration::from_millis(100);
        fresh += u64::from(servoing.command_angles(&wanted, deadline).expect("goes on"));
        emulator.step(1);
    }
    let counters = servoing.arm().cyclic.counters();
    // 49 of 500 are lost on the mean, with a deviation of 7.
    assert!(counters.missed >= 25 && counters.missed - counters.late <= 75, "{counters:?}");
    // The one cycle of the entry was answered too.
    assert_eq!(counters.sent, 501);
    assert!(fresh < counters.answered && counters.answered < counters.sent, "{counters:?}");
    assert!(counters.answered + counters.missed >= counters.sent, "{counters:?}");
    let gone = (emulator.status().motion.position[0] - start[0] - 0.1).abs();
    assert!(gone < 0.2 * LAG + 1e-3, "fell behind by {gone}");
    let step = emulator.status().commands.largest_step[0];
    assert!(step < 2.2e-4, "a lost command made a step of {step}");
}

/// Answers overtake each other: only younger ones count, and none is mistaken for another.
#[test]
fn late_and_reordered_answers_are_told_apart() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, patient_limits()).expect("enters");
    emulator.inject(Injection::DelayReplies(8));
    let mut newest = servoing.latest().frame;
    let before = emulator.status().commands.followed;
    for cycle in 1..=600 {
        if servoing.hold(Instant::now() + Duration::from_micros(300)).expect("holds") {
            assert!(servoing.latest().frame > newest, "went back from {newest} to {}", servoing.latest().frame);
            newest = servoing.latest().frame;
        }
        until("the arm has the command", || emulator.status().commands.followed == before + cycle);
        emulator.step(1);
    }
    let counters = servoing.arm().cyclic.counters();
    assert!(counters.late > 100 && counters.out_of_order > 50, "{counters:?}");
    assert_eq!((counters.stray, counters.lost), (0, 0), "{counters:?}");
}

#[test]
fn too_long_without_feedback_ends_servoing() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    emulator.inject(Injection::LoseReplies(1.0));
    let mut cycles = 0;
    let error = loop {
        match servoing.hold(Instant::now() + Duration::from_micros(100)) {
            Ok(fresh) => assert!(!fresh),
            Err(error) => break error,
        }
        cycles += 1;
        assert!(cycles <= 100, "never noticed");
    };
    assert!(matches!(error, KortexError::FeedbackLost { ticks: 101, allowed: 100 }), "{error}");
}

/// Watchdog of the arm: time from the last command until no joint moves, by the arm's own clock.
#[test]
fn an_arm_whose_host_falls_silent_stops_within_200_ms() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    for _ in 0..300 {
        let mut command = *servoing.command();
        command[0] += 1e-3;
        servoing.command_angles(&command, soon()).expect("follows");
        emulator.step(1);
    }
    assert!(emulator.status().motion.velocity[0] > 0.9, "moves at a metre-long arm's metre per second");
    emulator.step(400);
    let last = emulator.status().commands.last;
    assert_eq!(time_of(&emulator, EventKind::Watchdog), Some(last + 51));
    let stopped = time_of(&emulator, EventKind::StandsStill).expect("stopped");
    assert!(stopped - last <= 200, "stopped after {} ms", stopped - last);
    let error = servoing.hold(soon()).expect_err("in fault");
    assert!(error.to_string().contains("joint 7: watchdog"), "{error}");
}

/// A session that is dropped without leaving still returns the arm.
#[test]
fn dropping_leaves() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    drop(Servoing::enter(&mut arm, limits()).expect("enters"));
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
    let mut again = Servoing::enter(&mut arm, limits()).expect("enters again");
    again.hold(soon()).expect("holds");
}

#[test]
fn a_joint_in_another_control_mode_is_refused() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    emulator.inject(Injection::ControlMode { joint: 4, mode: 3 });
    let error = Servoing::enter(&mut arm, limits()).expect_err("refused");
    assert_eq!(error.to_string(), "joint 5 is in control mode Torque, expected Position");
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
}
