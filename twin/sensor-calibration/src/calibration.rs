//! Calibration of a real sensor from presses of a ball: its image-formation model, and its photometry, the mapping from
//! colours to slopes.
//!
//! [`presses`] reads the presses and rejects outliers before anything is fitted; [`mod@misfits`] finds presses that the
//! fitted model cannot explain. [`folds`] holds presses out in turn; their errors decide whether the calibration may be
//! used, while the written files are learned from all presses. [`scale`] finds the size of a pixel, [`sheet`] shows the
//! presses, and [`combine_folds`] reports the results.

pub mod figures;
pub mod folds;
mod misfits;
pub mod presses;
pub mod scale;
pub mod sheet;

use std::path::Path;

use anyhow::Result;
use image::RgbImage;
use tactile_optics::calibration::relocation;
use tactile_optics::calibration::zhang::LensFit;
use tactile_optics::calibration::{
    Assumptions, BallFit, FitEffort, HeldOutSimilarity, PressFolder, SensorCalibration, ViewSimilarity,
};

use self::folds::{EvaluatedFold, Fold, sensor_of};
use self::misfits::misfits;
use self::presses::CheckedPresses;
use self::scale::{PixelSize, PixelSource};
use self::sheet::Tile;
use super::reconstruction::{Photometry, SlopeMethod};

pub use folds::HoldOutSplit;

/// Result of a fit that leaves out a part of the model.
struct Ablation {
    model: &'static str,
    residual_grey: f64,
    /// Similarity of renders to the held-out presses.
    similarity: Option<ViewSimilarity>,
}

/// A fitted sensor, with its quality in rendering and reconstructing held-out presses.
pub struct CalibrationRun {
    /// Fit to all presses.
    fit: BallFit,
    photometry: Photometry,
    /// Quality of the renders of held-out presses.
    held_out: Option<HeldOutSimilarity>,
    /// The same rendered on the image's grid: the fit renders with round profiles, whereas the renderer of other
    /// objects works on the grid.
    on_grid: Option<HeldOutSimilarity>,
    /// The same with a single frame of the untouched gel in place of the mean of several.
    on_single_background: Option<HeldOutSimilarity>,
    ablations: Vec<Ablation>,
    /// Source of the pixel size.
    source: PixelSource,
    /// Rejected images, with the reasons.
    left_out: Vec<(String, String)>,
    tiles: Vec<Tile>,
    /// Numbers of presses: fitted, held out once, and found in their images without a label.
    presses: [usize; 3],
    single_lamp_images: usize,
    checkerboards: Option<LensFit>,
}

/// Options of a fit.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions {
    /// Choice of the held-out presses.
    pub split: HoldOutSplit,
    /// True to fit again without each part of the model.
    pub ablation: bool,
}

/// Maximum number of rounds that reject misfits.
const MAX_REJECTION_ROUNDS: usize = 3;
/// Approximate number of pixels that a fit uses of all presses together: the more presses, the fewer pixels of each.
const FIT_PIXELS: usize = 8400;
const MIN_PIXELS_PER_PRESS: usize = 150;
/// Steps of the fits to folds.
const FOLD_STEPS: [usize; 2] = [8, 14];

impl CalibrationRun {
    /// Fits the model to the presses, without those that it cannot explain. `learned` is called after each epoch of the
    /// training of a network.
    pub fn fit(presses: CheckedPresses, options: &FitOptions, seed: u64, learned: &(dyn Fn() + Sync)) -> Result<Self> {
        let mut presses = presses;
        let PixelSize { size, interval } =
            presses.measured.map_or_else(|| scale::from_presses(&presses.folder, seed), Ok)?;
        let effort = effort_for(presses.count());
        let assumptions = Assumptions::full(Some(size));
        if presses.folder.presses.iter().any(|press| !press.labelled) {
            let first = BallFit::new(&relocation::reliable_presses(&presses.folder), assumptions, &effort, seed)?;
            presses.folder = first.relocated(&presses.folder);
            scale::leave_out_impossible(&mut presses.folder, size, true)?;
            scale::check_depth(&presses.folder, size, presses.shallow)?;
        }
        let mut fit = BallFit::new(&presses.folder, assumptions, &effort, seed)?;
        for _ in 0..MAX_REJECTION_ROUNDS {
            let reasons = misfits(&fit, &presses.folder);
            if reasons.iter().all(Option::is_none) {
                break;
            }
            presses.folder.skip_presses(reasons);
            presses.check_count()?;
            fit = BallFit::new(&presses.folder, assumptions, &effort, seed)?;
        }
        presses.check_count()?;
        let CheckedPresses { folder, lens, checkerboards, source, .. } = presses;
        let tiles = tiles(&folder, &fit);
        fit.lens = lens;
        fit.pixel_interval = interval;
        fit.parameters.extend(checkerboards.iter().flat_map(|found| found.parameters.clone()));
        let folds = options.split.folds(&folder)?;
        let quick = FitEffort { starts: 1, steps: FOLD_STEPS, ..effort_for(2 * folder.presses.len()) };
        let judged = folds::evaluate_folds(&folds, assumptions, &quick, seed, learned)?;
        let (on_grid, on_single_background) = evaluate_other_renders(&folds, &judged)?;
        let ablations = if options.ablation { ablations(&folds, &judged, size, &effort, seed) } else { Vec::new() };
        let held = folds.iter().map(|fold| fold.held_out.presses.len()).sum();
        let (held_out, accuracy) = folds::combine_folds(judged);
        let photometry = Photometry::learn(&folder, &sensor_of(&fit)?, seed, learned)?.with_accuracy(accuracy);
        let unlabelled = folder.presses.iter().filter(|press| !press.labelled).count();
        Ok(Self {
            held_out,
            on_grid,
            on_single_background,
            ablations,
            presses: [folder.presses.len(), held, unlabelled],
            source,
            left_out: folder.skipped.iter().map(|image| (image.name.clone(), image.reason.clone())).collect(),
            tiles,
            single_lamp_images: folder.lamps.len(),
            checkerboards,
            photometry,
            fit,
        })
    }

    /// Writes the calibration file, and beside it the untouched gel's image and the photometry (the mapping from
    /// colours to slopes).
    pub fn write(&self, path: &Path) -> Result<()> {
        SensorCalibration::write(&self.fit, path)?;
        self.photometry.write(path)
    }

    /// Returns the reason why the calibration must not be used, if any: it is no better than the trivial estimate.
    pub fn shortfall(&self) -> Option<String> {
        let Some(HeldOutSimilarity { rendered, floor, .. }) = &self.held_out else {
            return Some("no press could be held out: the quality of the fit is unknown".to_owned());
        };
        let (found, least) = (rendered.crop.psnr, floor.crop.psnr);
        if !found.is_finite() || !least.is_finite() {
            return Some(format!("the quality of the fit is undetermined: {found} dB, {least} dB without a model"));
        }
        if found <= least {
            return Some(format!(
                "the model renders the held-out presses no better than the background alone: {found:.2} dB, {least:.2} dB"
            ));
        }
        let [look_up, network] = SlopeMethod::ALL.map(|method| self.photometry.accuracy(method).fault());
        Some(format!("no surface can be reconstructed: by look-up, {}; by the network, {}", look_up?, network?))
    }

    /// Draws all presses with their circles and errors.
    pub fn sheet(&self) -> Result<RgbImage> {
        sheet::draw(&self.tiles)
    }

    /// Returns warnings that belong to the result.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> =
            self.left_out.iter().map(|(name, reason)| format!("{name} left out: {reason}")).collect();
        if let (PixelSource::Presses, Some([low, high])) = (self.source, self.fit.pixel_interval) {
            warnings.push(format!(
                "the size of a pixel is known only to lie between {:.4} and {:.4} mm, and every depth likewise: measure it \
                 (--ruler, --field-mm or --pixel-mm)",
                1e3 * low,
                1e3 * high
            ));
        }
        for method in SlopeMethod::ALL {
            let accuracy = self.photometry.accuracy(method);
            let (fault, doubt) = (accuracy.fault(), accuracy.doubt());
            warnings.extend(fault.map(|fault| format!("{} must not be used: {fault}", method.name())).or_else(|| {
                doubt.map(|doubt| {
                    format!("{} is doubtful, more presses help: on presses held out {doubt}", method.name())
                })
            }));
        }
        warnings
    }
}

/// Returns the effort of a fit to this number of presses.
fn effort_for(presses: usize) -> FitEffort {
    let most = FitEffort::default().per_press;
    FitEffort { per_press: (FIT_PIXELS / presses.max(1)).clamp(MIN_PIXELS_PER_PRESS, most), ..FitEffort::default() }
}

fn tiles(folder: &PressFolder, fit: &BallFit) -> Vec<Tile> {
    let used = folder.presses.iter().zip(fit.press_errors(folder));
    let used =
        used.map(|(press, error)| Tile::press(press, format!("r {:.0} px, {error:.1} grey", press.radius), true));
    let mut tiles: Vec<Tile> = used.chain(folder.skipped.iter().flat_map(Tile::left_out)).collect();
    tiles.sort_by(|a, b| a.name.cmp(&b.name));
    tiles
}

/// Evaluates renders of the first fold's presses on the image's grid, and on a single frame of the untouched gel.
fn evaluate_other_renders(
    folds: &[Fold],
    judged: &[EvaluatedFold],
) -> Result<(Option<HeldOutSimilarity>, Option<HeldOutSimilarity>)> {
    let (Some(fold), Some(EvaluatedFold { fit, .. })) = (folds.first(), judged.first()) else {
        return Ok((None, None));
    };
    let sensor = sensor_of(fit)?;
    let on_grid =
        fit.evaluate_with(&fold.held_out, |press| sensor.render_ball(press.center, press.radius, press.diameter));
    let single = fold.fitted.background.rgb.iter().map(|&value| f32::from(value)).collect();
    Ok((on_grid, fit.with_background(single).evaluate(&fold.held_out)))
}

/// Repeats the first fold's fit without each part of the model.
fn ablations(folds: &[Fold], judged: &[EvaluatedFold], size: f64, effort: &FitEffort, seed: u64) -> Vec<Ablation> {
    let (Some(fold), Some(EvaluatedFold { fit, .. })) = (folds.first(), judged.first()) else { return Vec::new() };
    let without = |(model, assumptions)| {
        let again = if assumptions == fit.assumptions {
            fit.clone()
        } else {
            fit.refit(&fold.fitted, assumptions, effort, seed)
        };
        let similarity = again.evaluate(&fold.held_out).map(|held| held.rendered);
        Ablation { model, residual_grey: again.residual, similarity }
    };
    Assumptions::ablations(Some(size)).into_iter().map(without).collect()
}
