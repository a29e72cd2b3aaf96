//! Every fault the arm can raise arrives as an error that names it.

use std::time::Duration;

use kinova_kortex::JOINTS;
use kinova_kortex::emulator::Injection;
use kinova_kortex::message::base::ServoingMode;
use kinova_kortex::refusal::Reason;
use kinova_kortex::safety_bank::{ACTUATOR, BASE, EMERGENCY_LINE, EMERGENCY_STOP, JOINT_FAULT};
use kinova_kortex::servoing::Servoing;
use kinova_kortex::{Arm, KortexError, Timeouts};

use crate::support::*;

#[test]
fn every_fault_of_every_joint() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    for joint in 0..JOINTS {
        for (bit, name) in ACTUATOR.iter().enumerate() {
            let mut servoing = Servoing::enter(&mut arm, limits()).expect("faults are cleared on entry");
            emulator.inject(Injection::JointFault { joint, bits: 1 << bit });
            let error = servoing.hold(soon()).expect_err("in fault");
            let KortexError::Fault(report) = &error else { panic!("{error}") };
            assert_eq!((report.base.a, report.joints[joint].a), (JOINT_FAULT, 1 << bit));
            assert_eq!(
                error.to_string(),
                format!("the arm is in fault: base: joint fault; joint {}: {name}", joint + 1)
            );
        }
    }
}

#[test]
fn every_fault_of_the_base() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    for (bit, name) in BASE.iter().enumerate() {
        let mut servoing = Servoing::enter(&mut arm, limits()).expect("faults are cleared on entry");
        emulator.inject(Injection::BaseFault(1 << bit));
        let error = servoing.hold(soon()).expect_err("in fault");
        let (KortexError::Fault(report) | KortexError::EmergencyStop(report)) = &error else { panic!("{error}") };
        assert_eq!(report.base.a, 1 << bit);
        let is_stop = (EMERGENCY_STOP | EMERGENCY_LINE) >> bit & 1 == 1;
        assert_eq!(matches!(error, KortexError::EmergencyStop(_)), is_stop, "{error}");
        assert!(error.to_string().contains(&format!("base: {name}")), "{error}");
    }
}

/// Entry does not wait forever for a fault whose cause stays, and fails.
#[test]
fn a_fault_that_comes_back() {
    let emulator = emulator();
    let timeouts = Timeouts { call: Duration::from_secs(3), ..timeouts() };
    let mut arm = Arm::connect(emulator.address(), &credentials(), timeouts, home_posture()).expect("connects");
    emulator.inject(Injection::LastingBaseFault(1 << 3));
    let error = Servoing::enter(&mut arm, limits()).expect_err("still in fault");
    assert_eq!(error.to_string(), "the arm is in fault: base: core temperature too high");
    assert_eq!(emulator.status().mode, ServoingMode::SingleLevel);
    emulator.inject(Injection::LastingBaseFault(0));
    Servoing::enter(&mut arm, limits()).expect("cooled down").leave().expect("leaves");
}

/// The button: servoing ends with its own error, nothing starts while it is pressed, and releasing it is not enough.
#[test]
fn the_emergency_stop() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    let mut servoing = Servoing::enter(&mut arm, limits()).expect("enters");
    emulator.inject(Injection::EmergencyStop(true));
    let error = servoing.hold(soon()).expect_err("stopped");
    assert!(matches!(error, KortexError::EmergencyStop(_)), "{error}");
    drop(servoing);
    let error = Servoing::enter(&mut arm, limits()).expect_err("pressed");
    assert_eq!(error.reason(), Some(Reason::EmergencyStop), "{error}");
    emulator.inject(Injection::EmergencyStop(false));
    let error = arm.base.send_joint_speeds(&[0.1; JOINTS], &TOP_SPEED).expect_err("not cleared");
    assert_eq!(error.reason(), Some(Reason::EmergencyStop), "{error}");
    arm.base.clear_faults().expect("cleared");
    arm.base.send_joint_speeds(&[0.0; JOINTS], &TOP_SPEED).expect("moves again");
}

/// The call stops an arm in motion.
#[test]
fn the_emergency_stop_by_call() {
    let emulator = emulator();
    let mut arm = host(&emulator);
    arm.base.send_joint_speeds(&[0.3; JOINTS], &TOP_SPEED).expect("moves");
    emulator.step(300);
    arm.base.emergency_stop().expect("stops");
    emulator.step(150);
    let status = emulator.status();
    assert!(status.faults.is_emergency_stop());
    assert!(status.motion.velocity.iter().all(|speed| speed.abs() < 1e-3));
}
