//! Every fault in every phase of a grasp: the state that follows, and that only the servo that failed lets go.

use std::process::Command as Process;

use crate::common::{Bench, armed, bench, command, drive, patiently};
use hand_model::robot::{RobotBackend, ServoGoal};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::emulator::faults::{FaultEvent, FaultProbabilities};
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use hardware_bridge::safety::supervisor::CheckFailed;

/// Fault that is injected.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    Device(FaultEvent),
    /// The servos' answers are lost.
    AnswersLost,
    /// The controller falls silent.
    ControllerSilent,
    /// The controller commands NaN.
    NotANumber,
}

/// Phase of the grasp in which the fault occurs.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Armed,
    Closing,
    Gripping,
}

const GRIP_GOAL: ServoGoal = ServoGoal::Current(0.09);

/// Brings the robot into a phase.
fn reach(robot: &mut HardwareRobot, phase: Phase) {
    match phase {
        Phase::Armed => {}
        Phase::Closing => drive(robot, GRIP_GOAL, |robot| crate::common::observed(robot).servos[0].position > 0.5),
        Phase::Gripping => drive(robot, GRIP_GOAL, |robot| crate::common::closed(robot, 2.0)),
    }
}

/// Injects the fault and returns the state that follows.
fn inject(bench: &Bench, robot: &mut HardwareRobot, fault: Fault, phase: Phase) -> SupervisorState {
    match fault {
        Fault::Device(event) => bench.hand.inject(event),
        Fault::AnswersLost => {
            bench.hand.set_fault_probabilities(FaultProbabilities { drop: 1.0, ..FaultProbabilities::default() })
        }
        Fault::ControllerSilent | Fault::NotANumber => {}
    }
    patiently("the robot stops", || {
        // An armed robot waits for its first command; the others are driven on.
        if phase != Phase::Armed && fault != Fault::ControllerSilent || fault == Fault::NotANumber {
            let goal = if fault == Fault::NotANumber { ServoGoal::Current(f64::NAN) } else { GRIP_GOAL };
            // A cycle that waits for lost answers may not send in time.
            crate::common::send(robot, &command(goal));
        }
        robot.wait_for_tick();
        matches!(robot.state(), SupervisorState::Hold(_) | SupervisorState::Fault(_))
    });
    robot.state()
}

fn expected(fault: Fault, state: SupervisorState) -> bool {
    match fault {
        Fault::Device(FaultEvent::Overload(_) | FaultEvent::Overheat(_)) => matches!(
            state,
            SupervisorState::Fault(StopCause::ServoAlert(2))
                | SupervisorState::Fault(StopCause::TorqueLost(2))
                | SupervisorState::Hold(StopCause::Temperature(2, _))
        ),
        // A dip raises every servo's alert bit; which of voltage and alert is seen first depends on the moment.
        Fault::Device(FaultEvent::Voltage(volts)) if volts > 5.0 => {
            matches!(
                state,
                SupervisorState::Fault(StopCause::ServoAlert(_)) | SupervisorState::Hold(StopCause::Voltage(..))
            )
        }
        Fault::Device(FaultEvent::Voltage(_)) => {
            matches!(
                state,
                SupervisorState::Hold(StopCause::ServoSilent(..)) | SupervisorState::Fault(StopCause::TorqueLost(_))
            )
        }
        Fault::Device(FaultEvent::Unplug(_)) => matches!(state, SupervisorState::Hold(StopCause::ServoSilent(2, _))),
        Fault::Device(_) => false,
        Fault::AnswersLost => matches!(state, SupervisorState::Hold(StopCause::ServoSilent(..))),
        Fault::ControllerSilent => matches!(state, SupervisorState::Hold(StopCause::HostSilent(_))),
        Fault::NotANumber => state == SupervisorState::Hold(StopCause::BadCommand),
    }
}

const FAULTS: [Fault; 8] = [
    Fault::Device(FaultEvent::Overload(3)),
    Fault::Device(FaultEvent::Overheat(3)),
    Fault::Device(FaultEvent::Voltage(5.2)),
    Fault::Device(FaultEvent::Voltage(0.0)),
    Fault::Device(FaultEvent::Unplug(3)),
    Fault::AnswersLost,
    Fault::ControllerSilent,
    Fault::NotANumber,
];

fn every_fault(phase: Phase) {
    for fault in FAULTS {
        // A controller that never spoke cannot fall silent.
        if (fault, phase) == (Fault::ControllerSilent, Phase::Armed) {
            continue;
        }
        let bench = bench(&[]);
        let mut robot = armed(&bench);
        reach(&mut robot, phase);
        let before = bench.hand.shafts();
        let state = inject(&bench, &mut robot, fault, phase);
        assert!(expected(fault, state), "{fault:?} while {phase:?}: {state}");
        if phase == Phase::Gripping && fault != Fault::Device(FaultEvent::Voltage(0.0)) {
            crate::common::plant_time(&bench.hand, 0.2);
            for (n, (shaft, before)) in bench.hand.shafts().iter().zip(before).enumerate() {
                let hit = n == 2 && matches!(fault, Fault::Device(_));
                assert!(hit || shaft.position > before.position - 0.15, "{fault:?}: {n} lost its grip: {shaft:?}");
            }
        }
    }
}

#[test]
fn while_armed() {
    every_fault(Phase::Armed);
}

#[test]
fn while_closing() {
    every_fault(Phase::Closing);
}

#[test]
fn while_gripping() {
    every_fault(Phase::Gripping);
}

/// The robot is not armed while something is wrong.
#[test]
fn no_arming_with_an_alarm() {
    let bench = bench(&[]);
    let robot = crate::common::connected(&bench);
    bench.hand.inject(FaultEvent::Overheat(5));
    let hot = || robot.check().is_err_and(|error| error.0 == CheckFailed::Alarm(StopCause::ServoAlert(4)).to_string());
    patiently("the alert is seen", hot);
    assert!(robot.arm().is_err());
    assert!(bench.hand.applied_goals().iter().all(|drive| *drive == ServoGoal::Current(0.0)));
}

/// A host in a process of its own is stopped (SIGSTOP) and killed (SIGKILL): the servos stop by their own watchdogs.
#[test]
fn frozen_and_killed_hosts() {
    for signal in ["STOP", "KILL"] {
        let bench = bench(&[]);
        let file = bench.folder.path().join("bridge.toml");
        let mut host = Process::new(std::env::current_exe().expect("this test"))
            .args(["--exact", "faults::host_process", "--ignored"])
            .env("FTAC_BRIDGE_TOML", &file)
            .spawn()
            .expect("runs");
        patiently("the host closes the hand", || bench.hand.shafts().iter().all(|shaft| shaft.position > 0.3));
        let tripped = || bench.hand.watchdogs_tripped();
        assert_eq!(tripped(), 0, "the host feeds the watchdogs");
        let killed = Process::new("kill").args([&format!("-{signal}"), &host.id().to_string()]).status();
        assert!(killed.expect("kill runs").success());
        patiently("all watchdogs trip", || tripped() == 6);
        host.kill().expect("ends");
        host.wait().expect("ended");
    }
}

/// Not a test: the host that [`frozen_and_killed_hosts`] starts, which closes the hand slowly for ever.
#[test]
#[ignore = "run by frozen_and_killed_hosts in a process of its own"]
fn host_process() {
    let Ok(file) = std::env::var("FTAC_BRIDGE_TOML") else { return };
    let config = crate::common::forgiving(BridgeConfig::read(file.as_ref()).expect("a configuration"));
    let arm = Box::new(hardware_bridge::arm_link::LoopbackArm::at([0.0; 7].into()));
    let mut robot = HardwareRobot::connect(&config, arm, &hand_model::RobotModel::ftac_gen3(), None).expect("connects");
    patiently("the checks pass", || robot.check().is_ok());
    robot.arm().expect("arms");
    loop {
        crate::common::send(&mut robot, &command(ServoGoal::Current(0.05)));
        robot.wait_for_tick();
    }
}
