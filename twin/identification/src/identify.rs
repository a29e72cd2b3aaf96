//! Identification of a robot from its sessions, actuator by actuator.

use std::collections::BTreeMap;
use std::sync::Arc;

use hand_model::transmission::friction::CableLosses;
use hand_model::{Hand, RobotModel};
use nalgebra::DMatrix;
use plant::RobotIndividual;
use plant::identified::{Covariance, Estimate, IdentifiedRobot};
use plant::spread::Quantity;
use rayon::prelude::*;
use tactile_perception::ball_press::{self, BallPress, OwnCalibrationReport};
use tactile_perception::{PhotometricCalibration, TouchError};

use crate::ball::Ball;
use crate::error::IdentificationError;
use crate::fit::{Fit, fit};
use crate::free_motion::{FreeMotion, free_motions};
use crate::interval::TAUGHT;
use crate::kinematic_calibration::{KinematicCalibration, Touch, calibrate};
use crate::pad_mechanics::{PadMechanics, Shown};
use crate::script::OPPOSITION;
use crate::touches::{LookTouch, deepest, look_touches};
use crate::trace::Trace;
use crate::weighing::{Gains, weigh};

/// Step of the logarithm of a torque gain for the sensitivity of results, dimensionless.
const GAIN_STEP: f64 = 0.01;

/// An identified robot with the intermediate results.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    pub robot: IdentifiedRobot,
    /// Fit of each actuator.
    pub fits: Vec<Fit>,
    /// Kinematic calibration from touches of a ball; the prior if there are none.
    pub kinematics: KinematicCalibration,
    /// Torque gains from a weighed object; the prior if there is none.
    pub gains: Gains,
}

/// Identifies the individual of `robot` that recorded `traces`. `losses` are the nominal losses in guides and gears; `pads` is the
/// calibration for images of pressed pads. All touches are of one ball in one place.
///
/// # Errors
/// An actuator that no session moves.
pub fn identify(
    robot: &RobotModel,
    losses: CableLosses,
    pads: &PhotometricCalibration,
    traces: &[Trace],
) -> Result<Identification, IdentificationError> {
    let hand = &robot.hand;
    // The same session must not be counted twice.
    let distinct: BTreeMap<&str, &Trace> = traces.iter().map(|trace| (trace.source.sha256.as_str(), trace)).collect();
    let designed = prior(robot);
    let ball = distinct.values().find_map(|trace| trace.ball.as_ref());
    let looks: Vec<Vec<LookTouch>> = ball.map_or_else(Vec::new, |ball| {
        distinct.values().map(|trace| look_touches(hand, pads, ball.radius, &trace.pressed)).collect()
    });
    let felt: Vec<Touch> = looks.iter().flat_map(|looks| deepest(looks)).collect();
    let kinematics = match ball {
        Some(ball) => calibrate(robot, ball, &designed, &felt),
        None => KinematicCalibration::unknown(&designed),
    };
    // The direction of gravity follows from the calibration of arm and mount.
    let mut prior = kinematics.individual.clone();
    // Each weighing has its own grip; of several, the last one is used.
    let weighed = distinct.values().filter_map(|trace| Some((trace.weighed.as_ref()?, trace.tick)));
    let gains = weighed.filter_map(|weighed| weigh(robot, &kinematics, weighed)).next_back();
    let gains = gains.unwrap_or_else(|| Gains::unknown(&prior));
    let gain_places: Vec<usize> =
        (0..robot.arm.joints()).filter_map(|joint| prior.place(Quantity::ArmTorqueGain, joint)).collect();
    gain_places.iter().zip(gains.deviations).for_each(|(place, deviation)| prior.set(*place, deviation));
    let own = prior.robot(robot);
    let mechanics_with = |own: &RobotModel| {
        let mut shown = Shown::default();
        if let Some(ball) = ball {
            for (trace, looks) in distinct.values().zip(&looks) {
                shown.add(hand, own, (ball, &kinematics.ball), trace, looks);
            }
        }
        shown.together(ball.and_then(|ball| ball.slide.as_ref()))
    };
    let moved: Vec<PadMechanics> = (0..robot.arm.joints())
        .into_par_iter()
        .map(|joint| {
            let mut arm = (*own.arm).clone();
            arm.torque_gains[joint] *= GAIN_STEP.exp();
            mechanics_with(&RobotModel { arm: Arc::new(arm), ..own.clone() })
        })
        .collect();
    let mechanics = mechanics_with(&own).under_gains(&moved, GAIN_STEP, &gains.covariance);
    let motions: Vec<Vec<FreeMotion>> = (0..hand.servos.len())
        .map(|actuator| distinct.values().flat_map(|trace| free_motions(trace, actuator, &own)).collect())
        .collect();
    if let Some(missing) = motions.iter().position(Vec::is_empty) {
        let files: Vec<String> = traces.iter().map(|trace| trace.source.file.clone()).collect();
        let actuator = hand.parameters.actuator[missing].name.clone();
        return Err(IdentificationError::NotExcited { sessions: files.join(", "), actuator });
    }
    let mut fits: Vec<Fit> =
        motions[..OPPOSITION].par_iter().map(|own| fit(robot, losses, own, &prior, &kinematics)).collect();
    // The opposition servo turns the thumb as it hangs on its springs.
    let mut known = prior.clone();
    for fit in &fits {
        fit.places.iter().zip(&fit.deviations).for_each(|(place, deviation)| known.set(*place, *deviation));
    }
    fits.push(fit(robot, losses, &motions[OPPOSITION], &known, &kinematics));
    let mut estimates: Vec<Estimate> = designed
        .parameters()
        .iter()
        .zip(designed.deviations())
        .map(|(parameter, deviation)| Estimate::drawn(parameter, *deviation))
        .collect();
    let mut covariances = Vec::new();
    if kinematics.touches > 0 {
        for (n, place) in kinematics.places.iter().enumerate() {
            let estimate = &mut estimates[*place];
            estimate.identified = kinematics.taught(n);
            estimate.deviation = prior.deviations()[*place];
            estimate.sigma = kinematics.covariance[(n, n)].sqrt();
        }
        covariances.push(block(&estimates, &kinematics.places, &kinematics.covariance));
    }
    for fit in &fits {
        for (n, place) in fit.places.iter().enumerate() {
            let estimate = &mut estimates[*place];
            let sigma = fit.covariance[(n, n)].sqrt();
            estimate.identified = sigma < TAUGHT * estimate.sigma;
            (estimate.deviation, estimate.sigma) = (fit.deviations[n], sigma);
        }
        covariances.push(block(&estimates, &fit.places, &fit.covariance));
    }
    if gains.postures > 0 {
        for (joint, place) in gain_places.iter().enumerate() {
            let estimate = &mut estimates[*place];
            estimate.identified = gains.taught(joint, &designed);
            estimate.deviation = gains.deviations[joint];
            estimate.sigma = gains.covariance[(joint, joint)].sqrt();
        }
        covariances.push(block(&estimates, &gain_places, &gains.covariance));
    }
    let measured = [(Quantity::GelStiffness, mechanics.stiffness), (Quantity::PadFriction, mechanics.friction)];
    for (quantity, factor) in measured {
        if let Some((place, factor)) = designed.place(quantity, 0).zip(factor) {
            let estimate = &mut estimates[place];
            let (before, now) = (estimate.sigma.powi(-2), factor.sigma.powi(-2));
            let sigma = (before + now).powf(-0.5);
            estimate.deviation = (before * estimate.deviation + now * factor.deviation) / (before + now);
            estimate.identified = sigma < TAUGHT * estimate.sigma;
            estimate.sigma = sigma;
        }
    }
    let sources = distinct.values().map(|trace| trace.source.clone()).collect();
    let robot = IdentifiedRobot::new(robot, estimates, covariances, sources);
    Ok(Identification { robot, fits, kinematics, gains })
}

/// Calibrates the pads that the sessions press on a ball photometrically, starting from the calibration `pads` of others. None if no
/// pad is pressed.
///
/// # Errors
/// A result that is no better than `pads`.
pub fn own_pads(
    hand: &Hand,
    pads: &PhotometricCalibration,
    traces: &[Trace],
) -> Option<Result<(PhotometricCalibration, OwnCalibrationReport), TouchError>> {
    let pressed = |trace: &Trace| {
        let of = |ball: &Ball| trace.pressed.iter().map(|image| image.ball_press(ball.radius)).collect::<Vec<_>>();
        trace.ball.as_ref().map_or_else(Vec::new, of)
    };
    let presses: Vec<BallPress> = traces.iter().flat_map(pressed).collect();
    (!presses.is_empty()).then(|| ball_press::calibrate(hand, &presses, pads))
}

/// Returns a covariance with the names of its parameters.
fn block(estimates: &[Estimate], places: &[usize], covariance: &DMatrix<f64>) -> Covariance {
    Covariance {
        parameters: places.iter().map(|place| estimates[*place].name.clone()).collect(),
        rows: covariance.row_iter().map(|row| row.iter().copied().collect()).collect(),
    }
}

/// Returns the prior before any session: the mean of all robots built from the nominal model.
fn prior(robot: &RobotModel) -> RobotIndividual {
    let mut prior = RobotIndividual::designed(robot);
    for place in 0..prior.parameters().len() {
        let mean = prior.parameters()[place].spread.mean;
        prior.set(place, mean);
    }
    prior
}
