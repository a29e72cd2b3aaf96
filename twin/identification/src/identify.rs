//! Identification of a robot from its sessions, actuator by actuator.

use std::collections::BTreeMap;
use std::sync::Arc;

use hand_model::transmission::friction::CableLosses;
use hand_model::{Hand, RobotModel};
use nalgebra::DMatrix;
use plant::RobotInstance;
use plant::identified::{CovarianceBlock, IdentifiedRobot, ParameterEstimate};
use plant::prior::Quantity;
use rayon::prelude::*;
use tactile_perception::ball_press::{self, BallPress, SelfCalibrationReport};
use tactile_perception::{PhotometricCalibration, TouchError};

use crate::ball::CalibrationBall;
use crate::error::IdentificationError;
use crate::fit::{ActuatorFit, fit_actuator};
use crate::free_motion::{FreeMotion, free_motions};
use crate::interval::IDENTIFIED_RATIO;
use crate::kinematic_calibration::{BallTouch, KinematicCalibration, calibrate};
use crate::pad_mechanics::{PadMechanics, PressResults};
use crate::payload_calibration::{TorqueGains, identify_gains};
use crate::script::OPPOSITION_ACTUATOR;
use crate::touches::{SnapshotContact, deepest, snapshot_contacts};
use crate::trace::Trace;

/// Step of the logarithm of a torque gain for the sensitivity of results, dimensionless.
const GAIN_STEP: f64 = 0.01;

/// An identified robot with the intermediate results.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    pub robot: IdentifiedRobot,
    /// Fit of each actuator.
    pub fits: Vec<ActuatorFit>,
    /// Kinematic calibration from touches of a ball; the prior if there are none.
    pub kinematics: KinematicCalibration,
    /// Torque gains from a payload; the prior if there is none.
    pub gains: TorqueGains,
}

/// Identifies the instance of `robot` that recorded `traces`. `losses` are the nominal losses in guides and gears;
/// `pads` is the calibration for images of pressed pads. All touches are of one ball in one place.
///
/// # Errors
/// Fails for an actuator that no session moves.
pub fn identify(
    robot: &RobotModel,
    losses: CableLosses,
    pads: &PhotometricCalibration,
    traces: &[Trace],
) -> Result<Identification, IdentificationError> {
    let hand = &robot.hand;
    // The same session must not be counted twice.
    let distinct: BTreeMap<&str, &Trace> = traces.iter().map(|trace| (trace.source.sha256.as_str(), trace)).collect();
    let designed = prior_instance(robot);
    let ball = distinct.values().find_map(|trace| trace.ball.as_ref());
    let looks: Vec<Vec<SnapshotContact>> = ball.map_or_else(Vec::new, |ball| {
        distinct.values().map(|trace| snapshot_contacts(hand, pads, ball.radius, &trace.pressed)).collect()
    });
    let felt: Vec<BallTouch> = looks.iter().flat_map(|looks| deepest(looks)).collect();
    let kinematics = match ball {
        Some(ball) => calibrate(robot, ball, &designed, &felt),
        None => KinematicCalibration::from_prior(&designed),
    };
    // The direction of gravity follows from the calibration of arm and mount.
    let mut prior = kinematics.robot_instance.clone();
    // Each payload calibration has its own grip; of several, the last one is used.
    let weighed = distinct.values().filter_map(|trace| Some((trace.payload_rows.as_ref()?, trace.tick)));
    let gains = weighed.filter_map(|weighed| identify_gains(robot, &kinematics, weighed)).next_back();
    let gains = gains.unwrap_or_else(|| TorqueGains::from_prior(&prior));
    let gain_places: Vec<usize> =
        (0..robot.arm.joints()).filter_map(|joint| prior.parameter_index(Quantity::ArmTorqueGain, joint)).collect();
    gain_places.iter().zip(gains.deviations).for_each(|(place, deviation)| prior.set(*place, deviation));
    let own = prior.apply_to_robot(robot);
    let mechanics_with = |own: &RobotModel| {
        let mut shown = PressResults::default();
        if let Some(ball) = ball {
            for (trace, looks) in distinct.values().zip(&looks) {
                shown.add(hand, own, (ball, &kinematics.ball), trace, looks);
            }
        }
        shown.combine(ball.and_then(|ball| ball.slide.as_ref()))
    };
    let moved: Vec<PadMechanics> = (0..robot.arm.joints())
        .into_par_iter()
        .map(|joint| {
            let mut arm = (*own.arm).clone();
            arm.torque_gains[joint] *= GAIN_STEP.exp();
            mechanics_with(&RobotModel { arm: Arc::new(arm), ..own.clone() })
        })
        .collect();
    let mechanics = mechanics_with(&own).with_gain_uncertainty(&moved, GAIN_STEP, &gains.covariance);
    let motions: Vec<Vec<FreeMotion>> = (0..hand.servos.len())
        .map(|actuator| distinct.values().flat_map(|trace| free_motions(trace, actuator, &own)).collect())
        .collect();
    if let Some(missing) = motions.iter().position(Vec::is_empty) {
        let files: Vec<String> = traces.iter().map(|trace| trace.source.file.clone()).collect();
        let actuator = hand.parameters.actuator[missing].name.clone();
        return Err(IdentificationError::NotExcited { sessions: files.join(", "), actuator });
    }
    let mut fits: Vec<ActuatorFit> = motions[..OPPOSITION_ACTUATOR]
        .par_iter()
        .map(|own| fit_actuator(robot, losses, own, &prior, &kinematics))
        .collect();
    // The opposition servo turns the thumb, which hangs on its springs.
    let mut known = prior.clone();
    for fit in &fits {
        fit.parameter_indices.iter().zip(&fit.deviations).for_each(|(place, deviation)| known.set(*place, *deviation));
    }
    fits.push(fit_actuator(robot, losses, &motions[OPPOSITION_ACTUATOR], &known, &kinematics));
    let mut estimates: Vec<ParameterEstimate> = designed
        .parameters()
        .iter()
        .zip(designed.deviations())
        .map(|(parameter, deviation)| ParameterEstimate::from_prior(parameter, *deviation))
        .collect();
    let mut covariances = Vec::new();
    if kinematics.touches > 0 {
        for (n, place) in kinematics.parameter_indices.iter().enumerate() {
            let estimate = &mut estimates[*place];
            estimate.identified = kinematics.is_identified(n);
            estimate.deviation = prior.deviations()[*place];
            estimate.sigma = kinematics.covariance[(n, n)].sqrt();
        }
        covariances.push(named_covariance(&estimates, &kinematics.parameter_indices, &kinematics.covariance));
    }
    for fit in &fits {
        for (n, place) in fit.parameter_indices.iter().enumerate() {
            let estimate = &mut estimates[*place];
            let sigma = fit.covariance[(n, n)].sqrt();
            estimate.identified = sigma < IDENTIFIED_RATIO * estimate.sigma;
            (estimate.deviation, estimate.sigma) = (fit.deviations[n], sigma);
        }
        covariances.push(named_covariance(&estimates, &fit.parameter_indices, &fit.covariance));
    }
    if gains.postures > 0 {
        for (joint, place) in gain_places.iter().enumerate() {
            let estimate = &mut estimates[*place];
            estimate.identified = gains.is_identified(joint, &designed);
            estimate.deviation = gains.deviations[joint];
            estimate.sigma = gains.covariance[(joint, joint)].sqrt();
        }
        covariances.push(named_covariance(&estimates, &gain_places, &gains.covariance));
    }
    let measured = [(Quantity::GelStiffness, mechanics.stiffness), (Quantity::PadFriction, mechanics.friction)];
    for (quantity, factor) in measured {
        if let Some((place, factor)) = designed.parameter_index(quantity, 0).zip(factor) {
            let estimate = &mut estimates[place];
            let (before, now) = (estimate.sigma.powi(-2), factor.sigma.powi(-2));
            let sigma = (before + now).powf(-0.5);
            estimate.deviation = (before * estimate.deviation + now * factor.deviation) / (before + now);
            estimate.identified = sigma < IDENTIFIED_RATIO * estimate.sigma;
            estimate.sigma = sigma;
        }
    }
    let sources = distinct.values().map(|trace| trace.source.clone()).collect();
    let robot = IdentifiedRobot::new(robot, estimates, covariances, sources);
    Ok(Identification { robot, fits, kinematics, gains })
}

/// Calibrates the pads that the sessions press on a ball photometrically, starting from the calibration `pads` of
/// others. Returns none if no pad is pressed.
///
/// # Errors
/// Fails if the result is no better than `pads`.
pub fn calibrate_pads(
    hand: &Hand,
    pads: &PhotometricCalibration,
    traces: &[Trace],
) -> Option<Result<(PhotometricCalibration, SelfCalibrationReport), TouchError>> {
    let pressed = |trace: &Trace| {
        let of = |ball: &CalibrationBall| {
            trace.pressed.iter().map(|image| image.ball_press(ball.radius)).collect::<Vec<_>>()
        };
        trace.ball.as_ref().map_or_else(Vec::new, of)
    };
    let presses: Vec<BallPress> = traces.iter().flat_map(pressed).collect();
    (!presses.is_empty()).then(|| ball_press::calibrate(hand, &presses, pads))
}

/// Returns a covariance with the names of its parameters.
fn named_covariance(estimates: &[ParameterEstimate], places: &[usize], covariance: &DMatrix<f64>) -> CovarianceBlock {
    CovarianceBlock {
        parameters: places.iter().map(|place| estimates[*place].name.clone()).collect(),
        rows: covariance.row_iter().map(|row| row.iter().copied().collect()).collect(),
    }
}

/// Returns the prior before any session: the mean of all instances of the nominal model.
fn prior_instance(robot: &RobotModel) -> RobotInstance {
    let mut prior = RobotInstance::nominal(robot);
    for place in 0..prior.parameters().len() {
        let mean = prior.parameters()[place].prior.mean;
        prior.set(place, mean);
    }
    prior
}
