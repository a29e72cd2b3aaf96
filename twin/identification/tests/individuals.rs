//! Identification of a robot that differs from its nominal model: what its motion reveals, and what it does not.

use hand_model::transmission::friction::CableLosses;
use hand_model::{Arm, RobotModel};
use identification::evaluation::{compare, coverage, simulated_robot};
use identification::excitation::{ExcitationError, run_script as excite};
use identification::excitation_setup::ExcitationSetup;
use identification::trace::{Trace, TraceRecorder};
use identification::{ExcitationScript, identify};
use plant::RobotInstance;
use tactile_perception::PhotometricCalibration;

/// Returns the calibration of the nominal pads.
fn builtin_calibration() -> PhotometricCalibration {
    serde_json::from_str(include_str!("../../bench/data/calibration.json")).expect("a calibration")
}

/// Returns short motions in two postures.
fn short_script() -> ExcitationScript {
    let mut script = ExcitationScript::standard(&RobotModel::ftac_gen3()).expect("valid");
    script.posture.truncate(2);
    script.motion.retain(|motion| motion.current > 0.06);
    script.motion.iter_mut().for_each(|motion| motion.time = 1.0);
    script.motion.dedup_by(|a, b| a.actuators == b.actuators);
    script.ball = None;
    script.payload = None;
    script
}

fn nominal_model() -> (RobotModel, CableLosses) {
    let robot = RobotModel::ftac_gen3();
    let losses = CableLosses { friction: robot.hand.parameters.cable.friction, backlash: 0.0044 };
    (robot, losses)
}

fn excited(truth: &RobotInstance, script: &ExcitationScript) -> Trace {
    let (robot, losses) = nominal_model();
    let mut kept = TraceRecorder::new(simulated_robot(truth, &robot, losses, Arm::gen3().home));
    let pads = builtin_calibration();
    let friction = losses.friction;
    let means = ExcitationSetup { robot: &robot, pads: &pads, script, grasps: &[], friction, ready: Arm::gen3().home };
    let finished = excite::<_, ExcitationError>(&mut kept, &means, 0, |_| Ok(()), |_| true);
    assert_eq!(finished, Ok(true));
    kept.trace(&robot, "sim", script)
}

/// With the true parameters, the model of a digit moves like the simulated robot.
#[test]
fn the_twin_that_knows_all_moves_as_the_robot_does() {
    let (robot, losses) = nominal_model();
    let truth = RobotInstance::sample(&robot, 1);
    let [joint, tip, servo] = compare(&truth, &robot, losses, &Arm::gen3().home, &[&truth]).remove(0).summary();
    assert!(joint < 0.002 && tip < 0.0004 && servo < 0.004, "{joint} rad, {tip} m, {servo} rad");
}

/// A short excitation identifies many of the parameters on which a robot's free motion depends, and no others.
#[test]
fn an_instance_is_found() {
    let (robot, losses) = nominal_model();
    let truth = RobotInstance::sample(&robot, 1);
    let trace = excited(&truth, &short_script());
    // Giving the same session twice adds no information.
    let found = identify(&robot, losses, &builtin_calibration(), &[trace.clone(), trace]).unwrap();
    assert_eq!(found.robot.sessions.len(), 1);
    assert!(found.fits.iter().all(|fit| fit.residuals[1] < 0.2 * fit.residuals[0]), "{:?}", found.fits);
    let designed = RobotInstance::nominal(&robot);
    let both = compare(&truth, &robot, losses, &Arm::gen3().home, &[&designed, &found.robot.instance]);
    let [before, after] = [0, 1].map(|n| both[n].summary()[0]);
    assert!(after < 0.035 && after < 0.5 * before, "{before} rad, {after} rad");
    let [identified, others] = coverage(&found.robot, &truth);
    // Without the uncertainty of unsearched parameters, 40 of 66 would be inside their intervals.
    assert!(identified.of > 30 && identified.share() > 0.75, "{identified:?} {others:?}");
    // Joint zeros, the arm and its torque sensors have no effect on free motion. They keep the prior and are reported
    // accordingly.
    for (estimate, parameter) in found.robot.estimates.iter().zip(found.robot.instance.parameters()) {
        if ["joint_zero", "encoder", "position", "turn", "torque_gain"].contains(&parameter.quantity.name()) {
            assert!(!estimate.identified, "{}", estimate.name);
            assert_eq!((estimate.deviation, estimate.sigma), (parameter.prior.mean, parameter.prior.sigma));
        }
    }
}

#[test]
fn a_session_that_leaves_an_actuator_alone_is_refused_by_its_name() {
    let (robot, losses) = nominal_model();
    let mut script = short_script();
    script.motion.retain(|motion| motion.actuators != ["thumb"]);
    let trace = excited(&RobotInstance::nominal(&robot), &script);
    let error = identify(&robot, losses, &builtin_calibration(), &[trace]).unwrap_err().to_string();
    assert!(error.contains("motions of `thumb`: found none, expected at least one"), "{error}");
}
