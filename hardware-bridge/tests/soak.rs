//! Long runs on the emulated devices in real time. Run them alone on an idle machine, for example before a release:
//! `cargo test --release -p hardware-bridge --test integration soak -- --ignored --nocapture`.

use hardware_bridge::supported_robot::SERVOS;
use std::time::{Duration, Instant};

use crate::common::{Bench, bench, forgiving, patiently};
use hand_model::RobotModel;
use hand_model::robot::{RobotBackend, RobotCommand, ServoGoal};
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::kortex_link::KortexLink;
use hardware_bridge::safety::state::SupervisorState;
use kinova_kortex::Timeouts;
use kinova_kortex::emulator::{Emulator, EventKind, Pace, Settings};

/// Fifteen sessions of the usual timeout.
const SOAK_DURATION: Duration = Duration::from_secs(900);
/// Duration of each spell: the controller moves the robot, then announces that it will be silent for as long, as while
/// an operator is asked.
const SPELL_DURATION: Duration = Duration::from_secs(90);

/// The whole bridge, with the usual timeouts, moves hand and arm and waits, in turns, for 15 minutes.
#[test]
#[ignore = "15 minutes in real time"]
fn fifteen_minutes_on_emulated_devices() {
    let Bench { hand, config, folder: _folder } = bench(&[]);
    let settings = Settings { cyclic_deadline: 1500, following_error: std::f64::consts::PI, ..Settings::default() };
    let credentials = settings.credentials.clone();
    let emulator = Emulator::start(settings, Box::new(hand.arm_joints()), Pace::RealTime).expect("free ports");
    let near = hand.arm_joints().state().position;
    let arm = kinova_kortex::Arm::connect(emulator.address(), &credentials, Timeouts::default(), near.into_inner())
        .expect("connects");
    let sessions = emulator.status().sessions;
    let model = RobotModel::ftac_gen3();
    let link = KortexLink::new(arm, &model.arm, Duration::from_millis(5), Duration::from_secs(5));
    let config = forgiving(config);
    let mut robot = HardwareRobot::connect(&config, Box::new(link), &model, None).expect("connects");
    patiently("the checks pass", || robot.check().is_ok());
    robot.arm().expect("arms");

    let begun = Instant::now();
    let home = crate::common::observed(&mut robot).arm.position;
    let mut told = 0;
    while begun.elapsed() < SOAK_DURATION {
        let elapsed = begun.elapsed().as_secs_f64();
        let spell = (elapsed / SPELL_DURATION.as_secs_f64()) as u64;
        if told != spell {
            told = spell;
            println!("{elapsed:.0} s: {}", seen(&robot, &emulator));
        }
        if spell % 2 == 1 {
            robot.pause(10.0);
            crate::common::observed(&mut robot);
            std::thread::sleep(Duration::from_millis(50));
        } else {
            // 0.1 rad at 0.1 Hz: far below the joints' top speeds.
            let phase = elapsed * std::f64::consts::TAU * 0.1;
            let goal = home.iter().map(|angle| angle + 0.1 * phase.sin()).collect();
            let current = 0.06 + 0.03 * phase.sin();
            let servos = [ServoGoal::Current(current); SERVOS];
            crate::common::send(&mut robot, &RobotCommand { arm: goal, servos: servos.into(), capture: false });
            robot.wait_for_tick();
        }
        let state = robot.state();
        assert!(
            matches!(state, SupervisorState::Running | SupervisorState::Armed),
            "after {elapsed:.0} s: {state}; {:?}; {}",
            robot.report().arm_error,
            seen(&robot, &emulator)
        );
    }
    println!("{:.0} s: {}", begun.elapsed().as_secs_f64(), seen(&robot, &emulator));
    assert_eq!(emulator.status().sessions, sessions, "the sessions of the beginning");
    let events = emulator.status().events;
    assert!(!events.iter().any(|event| matches!(event.what, EventKind::SessionExpired(_) | EventKind::Watchdog)));
}

fn seen(robot: &HardwareRobot, emulator: &Emulator) -> String {
    let (report, status) = (robot.report(), emulator.status());
    format!(
        "{} servo cycles, {} late, longest gap {:.0} ms; {} answers missing; arm at {} s of its own time, {} commands followed",
        report.cycles,
        report.late,
        1e3 * report.longest_gap,
        report.bus.missing,
        status.time / 1000,
        status.commands.followed
    )
}
