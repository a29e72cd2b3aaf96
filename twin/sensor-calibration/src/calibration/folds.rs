//! Cross-validation: presses are held out in turn, and a calibration learned from the others is evaluated on them.

use anyhow::{Result, bail};
use rayon::prelude::*;
use tactile_optics::calibration::{
    Assumptions, BallFit, CalibratedSensor, FitEffort, HeldOutSimilarity, PressFolder, SensorCalibration,
};
use tactile_optics::calibration::{Similarity, ViewSimilarity};

use crate::reconstruction::Photometry;
use crate::reconstruction::accuracy::Accuracy;
use crate::reconstruction::errors::ReconstructionErrors;

/// Choice of the held-out presses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HoldOutSplit {
    /// Each press once, in cross-validation with four parts (two from [`MANY_PRESSES`] presses on).
    Folds,
    /// Presses 1, 3, 5, ... by file name.
    EvenOdd,
    /// Presses of balls larger than the smallest.
    Ball,
}

/// Number of presses from which they are split into two parts instead of four.
const MANY_PRESSES: usize = 24;

/// Presses to learn from, and held-out ones to evaluate on.
pub struct Fold {
    pub fitted: PressFolder,
    pub held_out: PressFolder,
}

impl HoldOutSplit {
    /// Returns the folds of presses. Returns an error if a fold has nothing to hold out.
    pub fn folds(self, presses: &PressFolder) -> Result<Vec<Fold>> {
        let smallest = presses.presses.iter().map(|press| press.diameter).fold(f64::INFINITY, f64::min);
        let fold = |(fitted, held_out)| Fold { fitted, held_out };
        let folds: Vec<Fold> = match self {
            Self::Folds => {
                let parts = if presses.presses.len() < MANY_PRESSES { 4 } else { 2 };
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

/// Evaluation of one fold.
pub struct EvaluatedFold {
    /// Similarity of renders to the held-out presses.
    pub rendered: HeldOutSimilarity,
    /// Errors of reconstructed surfaces, by look-up and by the network.
    errors: [ReconstructionErrors; 2],
    presses: usize,
    pub fit: BallFit,
}

impl Fold {
    /// Fits and learns without the held-out presses, and evaluates on them.
    fn evaluate(
        &self,
        assumptions: Assumptions,
        effort: &FitEffort,
        seed: u64,
        step: &(dyn Fn() + Sync),
    ) -> Result<EvaluatedFold> {
        let fit = BallFit::new(&self.fitted, assumptions, effort, seed)?;
        let sensor = sensor_of(&fit)?;
        let photometry = Photometry::learn(&self.fitted, &sensor, seed, step)?;
        let errors = photometry.errors(&self.held_out, &sensor);
        let Some(rendered) = fit.evaluate(&self.held_out) else { bail!("no press was held out") };
        Ok(EvaluatedFold { rendered, errors, presses: self.held_out.presses.len(), fit })
    }
}

/// Returns the sensor of a fit.
pub fn sensor_of(fit: &BallFit) -> Result<CalibratedSensor> {
    Ok(CalibratedSensor::new(SensorCalibration::new(fit, String::new()), fit.background.clone())?)
}

/// Evaluates all folds in parallel.
pub fn evaluate_folds(
    folds: &[Fold],
    assumptions: Assumptions,
    effort: &FitEffort,
    seed: u64,
    step: &(dyn Fn() + Sync),
) -> Result<Vec<EvaluatedFold>> {
    folds.par_iter().map(|fold| fold.evaluate(assumptions, effort, seed, step)).collect()
}

/// Combines the folds to results over all held-out presses: of renders, and of surfaces by look-up and by the network.
pub fn combine_folds(judged: Vec<EvaluatedFold>) -> (Option<HeldOutSimilarity>, [Accuracy; 2]) {
    let rendered = mean(&judged);
    let mut all: [ReconstructionErrors; 2] = Default::default();
    for of_fold in judged {
        all.iter_mut().zip(of_fold.errors).for_each(|(all, errors)| all.merge(errors));
    }
    (rendered, all.map(|errors| errors.accuracy()))
}

/// Averages over the held-out presses.
fn mean(judged: &[EvaluatedFold]) -> Option<HeldOutSimilarity> {
    let views = |pick: fn(&HeldOutSimilarity) -> ViewSimilarity| {
        let part = |part: fn(&ViewSimilarity) -> Similarity| {
            let each = judged.iter().flat_map(|of| std::iter::repeat_n(part(&pick(&of.rendered)), of.presses));
            Similarity::mean(&each.collect::<Vec<_>>())
        };
        Some(ViewSimilarity { full: part(|views| views.full)?, crop: part(|views| views.crop)? })
    };
    Some(HeldOutSimilarity {
        rendered: views(|held| held.rendered)?,
        floor: views(|held| held.floor)?,
        ceiling: views(|held| held.ceiling)?,
    })
}
