//! Photometric calibration of a hand's own pads from presses on a ball. The presses label themselves.
//!
//! The calibration at hand locates the balls, and the impressions of the located balls label the presses. The
//! calibration corrected by these labels locates the balls anew, until the positions converge. A ball shows slopes only
//! up to those at its contact's rim; steeper ones stay as in the calibration at hand.

use hand_model::Hand;
use rayon::prelude::*;

use super::impression::{PressedBall, impression};
use super::{BallPress, locate};
use crate::calibration::{AngularError, CalibrationPress, PhotometricCalibration};
use crate::error::TouchError;

/// Largest number of rounds of locating and fitting, and the mean step of the balls below which they count as
/// converged, m.
const MAX_ROUNDS: usize = 5;
const STEP_TOLERANCE: f64 = 1e-5;
/// One of this many presses is held out.
const HOLDOUT_STRIDE: usize = 5;

/// Quality of a calibration from presses on a ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SelfCalibrationReport {
    /// Number of presses in which the ball was found.
    pub located: usize,
    /// Number of rounds of locating the balls and correcting the calibration.
    pub rounds: usize,
    /// Mean step of the balls' centres in the last round, m.
    pub step: f64,
    /// Error of the held-out presses' normals with the initial calibration.
    pub before: AngularError,
    /// Error of the held-out presses' normals with the calibration corrected by the other presses.
    pub after: AngularError,
}

/// Calibrates a hand's pads from presses on a ball. The initial calibration, of another hand, locates the balls at
/// first. Fails if the result is no better than it on held-out presses. Presses in which no ball is found are left out.
pub fn calibrate(
    hand: &Hand,
    presses: &[BallPress],
    start: &PhotometricCalibration,
) -> Result<(PhotometricCalibration, SelfCalibrationReport), TouchError> {
    let mut located = locate_all(hand, presses, start)?;
    let held_out: Vec<CalibrationPress> =
        select_presses(&located, true).map(|(at, ball)| labelled(hand, &presses[at], &ball)).collect();
    let before = start.evaluate(hand, &held_out)?;
    let mut rounds = 0;
    let (fitted, step) = loop {
        let labels: Vec<_> =
            select_presses(&located, false).map(|(at, ball)| labelled(hand, &presses[at], &ball)).collect();
        let fitted = start.corrected(hand, &labels)?;
        let again = locate_all(hand, presses, &fitted)?;
        let step = mean_step(&located, &again);
        located = again;
        rounds += 1;
        if step < STEP_TOLERANCE || rounds == MAX_ROUNDS {
            break (fitted, step);
        }
    };
    let after = fitted.evaluate(hand, &held_out)?;
    let better = after.mean < before.mean;
    if !better {
        return Err(TouchError::NoImprovement { before: before.mean, after: after.mean });
    }
    let all: Vec<_> = select_presses(&located, true)
        .chain(select_presses(&located, false))
        .map(|(at, ball)| labelled(hand, &presses[at], &ball))
        .collect();
    let report = SelfCalibrationReport { located: located.iter().flatten().count(), rounds, step, before, after };
    Ok((start.corrected(hand, &all)?, report))
}

/// Locates the balls of the presses; `None` where no ball is found.
fn locate_all(
    hand: &Hand,
    presses: &[BallPress],
    calibration: &PhotometricCalibration,
) -> Result<Vec<Option<PressedBall>>, TouchError> {
    let ball = |press: &BallPress| {
        let place = locate(hand, calibration, press)?;
        Ok(place.map(|place| PressedBall { center: place.center, radius: press.radius }))
    };
    presses.par_iter().map(ball).collect()
}

/// Located presses, either the held-out ones or the others.
fn select_presses(located: &[Option<PressedBall>], held_out: bool) -> impl Iterator<Item = (usize, PressedBall)> {
    let balls = located.iter().enumerate().filter_map(|(at, ball)| Some((at, (*ball)?)));
    balls.filter(move |(at, _)| (at % HOLDOUT_STRIDE == HOLDOUT_STRIDE - 1) == held_out)
}

/// Labels a press with the impression of its ball.
fn labelled(hand: &Hand, press: &BallPress, ball: &PressedBall) -> CalibrationPress {
    CalibrationPress {
        camera: press.camera,
        image: press.image.clone(),
        background: press.background.clone(),
        indentation: impression(hand, press.camera, ball).indentation,
    }
}

/// Mean distance between the positions of the balls that are found both times, m.
fn mean_step(before: &[Option<PressedBall>], after: &[Option<PressedBall>]) -> f64 {
    let step = |(before, after): (&Option<PressedBall>, &Option<PressedBall>)| {
        Some((before.as_ref()?.center - after.as_ref()?.center).norm())
    };
    let steps: Vec<f64> = before.iter().zip(after).filter_map(step).collect();
    steps.iter().sum::<f64>() / steps.len().max(1) as f64
}
