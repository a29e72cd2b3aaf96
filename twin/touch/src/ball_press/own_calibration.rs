//! The pads' own photometric calibration from presses on a ball, which label themselves.
//!
//! The calibration at hand locates the balls, the impressions of the located balls label the presses, and the calibration corrected by
//! them locates the balls anew, until they stay where they are. A ball shows slopes up to its contact's rim only: steeper ones stay as
//! the calibration at hand has them.

use hand_model::Hand;
use rayon::prelude::*;

use super::impression::{Ball, impression};
use super::{BallPress, locate};
use crate::calibration::{AngularError, CalibrationPress, PhotometricCalibration};
use crate::error::TouchError;

/// Most rounds of locating and fitting, and the mean step of the balls after which they stand still, m.
const MOST_ROUNDS: usize = 5;
const STILL: f64 = 1e-5;
/// Every so many-th press is held out.
const FOLD: usize = 5;

/// How good a calibration from presses on a ball is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnCalibrationReport {
    /// Presses in which the ball was found, of all.
    pub located: usize,
    pub rounds: usize,
    /// Mean step of the balls' middles in the last round, m.
    pub step: f64,
    /// Of the held-out presses' normals, by the calibration at the start ...
    pub before: AngularError,
    /// ... and by it corrected by the other presses.
    pub after: AngularError,
}

/// Calibrates a hand's pads to presses on a ball, from a calibration of another hand with which the balls are found at first. Refuses a
/// result that is no better than it on presses that were held out. Presses in which no ball is found are left out.
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

/// The balls of those presses in which one is found.
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

/// The located presses, the held-out ones or the others.
fn every(located: &[Option<Ball>], held_out: bool) -> impl Iterator<Item = (usize, Ball)> {
    let balls = located.iter().enumerate().filter_map(|(at, ball)| Some((at, (*ball)?)));
    balls.filter(move |(at, _)| (at % FOLD == FOLD - 1) == held_out)
}

/// A press labelled by the ball's impression.
fn labelled(hand: &Hand, press: &BallPress, ball: &Ball) -> CalibrationPress {
    CalibrationPress {
        camera: press.camera,
        image: press.image.clone(),
        background: press.background.clone(),
        indentation: impression(hand, press.camera, ball).indentation,
    }
}

/// How far balls that are found both times lie apart on the mean, m.
fn mean_step(before: &[Option<Ball>], after: &[Option<Ball>]) -> f64 {
    let step = |(before, after): (&Option<Ball>, &Option<Ball>)| {
        Some((before.as_ref()?.center - after.as_ref()?.center).norm())
    };
    let steps: Vec<f64> = before.iter().zip(after).filter_map(step).collect();
    steps.iter().sum::<f64>() / steps.len().max(1) as f64
}
