//! Photometric calibration of a hand's own pads from presses on a ball. The presses label themselves.
//!
//! The calibration at hand locates the balls, and the impressions of the located balls label the presses. The
//! calibration corrected by these labels locates the balls anew, until the positions converge. A ball shows slopes only
//! up to those at its contact's rim; steeper ones stay as in the calibration at hand.

use hand_model::Hand;
use rayon::prelude::*;

use super::impression::{Ball, impression};
use super::{BallPress, locate};
use crate::calibration::{AngularError, CalibrationPress, PhotometricCalibration};
use crate::error::TouchError;

/// Largest number of rounds of locating and fitting, and the mean step of the balls below which they count as
/// converged, m.
const MOST_ROUNDS: usize = 5;
const STILL: f64 = 1e-5;
/// One of this many presses is held out.
const FOLD: usize = 5;

/// Quality of a calibration from presses on a ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnCalibrationReport {
    /// Number of presses in which the ball was found.
    pub located: usize,
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
) -> Result<(PhotometricCalibration, OwnCalibrationReport), TouchError> {
    let mut located = places(hand, presses, start)?;
    let held_out: Vec<CalibrationPress> =
        every(&located, true).map(|(at, ball)| labelled(hand, &presses[at], &ball)).collect();
    let before = start.evaluate(hand, &held_out)?;
    let mut rounds = 0;
    let (fitted, step) = loop {
        let labels: Vec<_> = every(&located, false).map(|(at, ball)| labelled(hand, &presses[at], &ball)).collect();
        let fitted = start.corrected(hand, &labels)?;
        let again = places(hand, presses, &fitted)?;
        let step = mean_step(&located, &again);
        located = again;
        rounds += 1;
        if step < STILL || rounds == MOST_ROUNDS {
            break (fitted, step);
        }
    };
    let after = fitted.evaluate(hand, &held_out)?;
    let better = after.mean < before.mean;
    if !better {
        return Err(TouchError::NoBetter { before: before.mean, after: after.mean });
    }
    let all: Vec<_> = every(&located, true)
        .chain(every(&located, false))
        .map(|(at, ball)| labelled(hand, &presses[at], &ball))
        .collect();
    let report = OwnCalibrationReport { located: located.iter().flatten().count(), rounds, step, before, after };
    Ok((start.corrected(hand, &all)?, report))
}

/// Locates the balls of the presses; `None` where no ball is found.
fn places(
    hand: &Hand,
    presses: &[BallPress],
    calibration: &PhotometricCalibration,
) -> Result<Vec<Option<Ball>>, TouchError> {
    let ball = |press: &BallPress| {
        let place = locate(hand, calibration, press)?;
        Ok(place.map(|place| Ball { center: place.center, radius: press.radius }))
    };
    presses.par_iter().map(ball).collect()
}

/// Located presses, either the held-out ones or the others.
fn every(located: &[Option<Ball>], held_out: bool) -> impl Iterator<Item = (usize, Ball)> {
    let balls = located.iter().enumerate().filter_map(|(at, ball)| Some((at, (*ball)?)));
    balls.filter(move |(at, _)| (at % FOLD == FOLD - 1) == held_out)
}

/// Labels a press with the impression of its ball.
fn labelled(hand: &Hand, press: &BallPress, ball: &Ball) -> CalibrationPress {
    CalibrationPress {
        camera: press.camera,
        image: press.image.clone(),
        background: press.background.clone(),
        indentation: impression(hand, press.camera, ball).indentation,
    }
}

/// Mean distance between the positions of the balls that are found both times, m.
fn mean_step(before: &[Option<Ball>], after: &[Option<Ball>]) -> f64 {
    let step = |(before, after): (&Option<Ball>, &Option<Ball>)| {
        Some((before.as_ref()?.center - after.as_ref()?.center).norm())
    };
    let steps: Vec<f64> = before.iter().zip(after).filter_map(step).collect();
    steps.iter().sum::<f64>() / steps.len().max(1) as f64
}
