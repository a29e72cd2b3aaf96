//! Presses that are held out, in turn, and what the others teach about them.

use anyhow::{Result, bail};
use optics::calibration::{Assumptions, BallFit, CalibratedSensor, Effort, HeldOut, PressFolder, SensorCalibration};
use optics::calibration::{Similarity, Views};
use rayon::prelude::*;

use crate::reconstruction::Photometry;
use crate::reconstruction::accuracy::Accuracy;
use crate::reconstruction::errors::Errors;

/// Which presses are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// Each press once: of four parts (of two, from [`MANY`] presses on) each in its turn.
    Folds,
    /// Presses 1, 3, 5, ... by file name.
    EvenOdd,
    /// Those of larger balls than the smallest.
    Ball,
}

/// So many presses are split into two parts and not into four.
const MANY: usize = 24;

/// Presses to learn from, and others to measure on.
pub struct Fold {
    pub fitted: PressFolder,
    pub held_out: PressFolder,
}

impl Split {
    /// The folds of presses. An error if one has nothing to hold out.
    pub fn folds(self, presses: &PressFolder) -> Result<Vec<Fold>> {
        let smallest = presses.presses.iter().map(|press| press.diameter).fold(f64::INFINITY, f64::min);
        let fold = |(fitted, held_out)| Fold { fitted, held_out };
        let folds: Vec<Fold> = match self {
            Self::Folds => {
                let parts = if presses.presses.len() < MANY { 4 } else { 2 };
                (0..parts).map(|part| fold(presses.split(|index, _| index % parts != part))).collect()
            }
            Self::EvenOdd => vec![fold(presses.even_odd())],
            Self::Ball => vec![fold(presses.split(|_, press| press.diameter < 1.001 * smallest))],
        };
        if folds.iter().any(|fold| fold.held_out.presses.is_empty()) {
            bail!("--split: found no presses to hold out; expected some, or `--split folds`");
        }
        Ok(folds)
    }
}

/// What the presses that are learned from teach about those held out.
pub struct Judged {
    /// Renders.
    pub rendered: HeldOut,
    /// Surfaces, by look-up and by the network.
    errors: [Errors; 2],
    presses: usize,
    pub fit: BallFit,
}

impl Fold {
    /// Fits and learns without the presses held out.
    fn judge(&self, assumptions: Assumptions, effort: &Effort, seed: u64, step: &(dyn Fn() + Sync)) -> Result<Judged> {
        let fit = BallFit::new(&self.fitted, assumptions, effort, seed)?;
        let sensor = sensor_of(&fit)?;
        let photometry = Photometry::learn(&self.fitted, &sensor, seed, step)?;
        let errors = photometry.errors(&self.held_out, &sensor);
        let Some(rendered) = fit.evaluate(&self.held_out) else { bail!("no press was held out") };
        Ok(Judged { rendered, errors, presses: self.held_out.presses.len(), fit })
    }
}

/// The sensor of a fit.
pub fn sensor_of(fit: &BallFit) -> Result<CalibratedSensor> {
    Ok(CalibratedSensor::new(SensorCalibration::new(fit, String::new()), fit.background.clone())?)
}

/// Judges all folds, at the same time.
pub fn judge(
    folds: &[Fold],
    assumptions: Assumptions,
    effort: &Effort,
    seed: u64,
    step: &(dyn Fn() + Sync),
) -> Result<Vec<Judged>> {
    folds.par_iter().map(|fold| fold.judge(assumptions, effort, seed, step)).collect()
}

/// Figures of all presses that were held out: of renders, and of surfaces by look-up and by the network.
pub fn figures(judged: Vec<Judged>) -> (Option<HeldOut>, [Accuracy; 2]) {
    let rendered = mean(&judged);
    let mut all: [Errors; 2] = Default::default();
    for of_fold in judged {
        all.iter_mut().zip(of_fold.errors).for_each(|(all, errors)| all.merge(errors));
    }
    (rendered, all.map(|errors| errors.accuracy()))
}

/// Mean over the presses held out.
fn mean(judged: &[Judged]) -> Option<HeldOut> {
    let views = |pick: fn(&HeldOut) -> Views| {
        let part = |part: fn(&Views) -> Similarity| {
            let each = judged.iter().flat_map(|of| std::iter::repeat_n(part(&pick(&of.rendered)), of.presses));
            Similarity::mean(&each.collect::<Vec<_>>())
        };
        Some(Views { full: part(|views| views.full)?, crop: part(|views| views.crop)? })
    };
    Some(HeldOut {
        rendered: views(|held| held.rendered)?,
        floor: views(|held| held.floor)?,
        ceiling: views(|held| held.ceiling)?,
    })
}
