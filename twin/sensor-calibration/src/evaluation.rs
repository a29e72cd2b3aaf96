//! Evaluations: of a calibration on held-out presses, of the gel's response to the paper's probe, and of the fit's
//! ability to recover a known sensor.

use std::path::Path;

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::GelFoundation;
use tactile_optics::calibration::recovery::{RecoveryErrors, recover};
use tactile_optics::calibration::{
    CalibratedSensor, FitEffort, SensorCalibration, Similarity, SkippedImage, similarity,
};
use tactile_optics::foundation::{
    PAPER_WINKLER_MODULUS, PROBE_RADIUS, ProbePoint, Sensitivity, bonded_layer_force, response_to_force, sensitivity,
};

use super::calibration::presses;
use super::reconstruction::{Accuracy, Photometry};

/// Numbers of fitted presses in the rows of the recovery table.
const RECOVERY_ROWS: [usize; 5] = [1, 2, 4, 8, 16];
/// Noise of the images for the recovery table, grey levels.
const RECOVERY_NOISE: f64 = 1.0;

/// Response of a gel to the paper's probe.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct GelResponse {
    /// Name of the gel, or of its pressure law.
    pub gel: &'static str,
    /// Sensitivity below 50 kPa.
    pub below_50_kpa: Sensitivity,
    /// Sensitivity up to 160 kPa.
    pub to_160_kpa: Sensitivity,
    /// Every tenth point of the response.
    pub points: Vec<ProbePoint>,
}

/// Computes the response to the paper's probe for the paper's gel, for the hand's, and for the two gels that explain
/// their difference.
pub fn gel_responses(hand: &Hand) -> Vec<GelResponse> {
    let winkler = GelFoundation::winkler(&hand.gel());
    let stiff = GelFoundation { modulus: PAPER_WINKLER_MODULUS, ..winkler };
    let (modulus, thickness) = (winkler.modulus, winkler.thickness);
    let on =
        |gel: GelFoundation| -> Box<dyn Fn(f64) -> f64> { Box::new(move |depth| gel.ball_force(PROBE_RADIUS, depth)) };
    let bonded = move |depth: f64| bonded_layer_force(modulus, thickness, PROBE_RADIUS, depth);
    let gels = [
        ("paper's law", on(GelFoundation::paper(thickness))),
        ("hand's Winkler gel", on(winkler)),
        ("same E, bonded layer", Box::new(bonded)),
        ("Winkler, 0.42 MPa", on(stiff)),
    ];
    gels.into_iter()
        .map(|(gel, force)| {
            let points = response_to_force(thickness, force, 160.0, 161);
            GelResponse {
                gel,
                below_50_kpa: sensitivity(&points, 50.0),
                to_160_kpa: sensitivity(&points, 160.0),
                points: points.into_iter().step_by(10).collect(),
            }
        })
        .collect()
}

/// True if the paper's law reproduces the paper's two sensitivities within 5 %, with at least the paper's linearity
/// (R2).
pub fn reproduces_paper(rows: &[GelResponse]) -> bool {
    let good = |found: Sensitivity, slope: f64, r_squared: f64| {
        (found.per_kpa / slope - 1.0).abs() < 0.05 && found.r_squared >= r_squared
    };
    rows.iter()
        .filter(|row| row.gel.starts_with("paper"))
        .all(|row| good(row.below_50_kpa, 0.48, 0.973) && good(row.to_160_kpa, 0.30, 0.967))
}

/// Formats the sensitivities of each gel, one line each.
pub fn response_table(rows: &[GelResponse]) -> String {
    let line = |row: &GelResponse| {
        let (low, all) = (row.below_50_kpa, row.to_160_kpa);
        format!(
            "{:20} below 50 kPa {:.3} /kPa (R2 {:.3}), to 160 kPa {:.3} /kPa (R2 {:.3}); paper 0.48 (0.973), 0.30 (0.967)\n",
            row.gel, low.per_kpa, low.r_squared, all.per_kpa, all.r_squared
        )
    };
    rows.iter().map(line).collect()
}

/// Fits to synthetic presses of a known sensor, without and with images of its single lamps.
pub fn recoveries(seed: u64) -> Vec<RecoveryErrors> {
    let effort = FitEffort { steps: [25, 25], ..FitEffort::default() };
    RECOVERY_ROWS
        .iter()
        .flat_map(|&presses| [(presses, false), (presses, true)])
        .map(|(presses, single_lamps)| recover(presses, single_lamps, RECOVERY_NOISE, &effort, seed))
        .collect()
}

/// Formats the errors of the fits, one line each.
pub fn recovery_table(rows: &[RecoveryErrors]) -> String {
    let mut text = "presses  single lamps  held-out grey  lamp deg  lamp mm  roughness  response  kernel\n".to_owned();
    for row in rows {
        text += &format!(
            "{:7}  {:12}  {:13.3}  {:8.2}  {:7.2}  {:9.3}  {:8.4}  {:5.1} %\n",
            row.presses,
            if row.single_lamps { "too" } else { "-" },
            row.held_out_grey,
            row.lamp_degrees,
            row.lamp_mm,
            row.roughness,
            row.response,
            100.0 * row.kernel
        );
    }
    text
}

/// Evaluation of a calibration on the presses of a folder or a video.
pub struct RenderedPresses {
    pub presses: usize,
    /// Similarity of whole images, mean over the presses.
    pub similarity: Similarity,
    /// Errors of reconstructed surfaces, by look-up and by the network, if the photometry file is beside the
    /// calibration.
    pub surfaces: Option<[Accuracy; 2]>,
    /// Unusable images.
    pub left_out: Vec<SkippedImage>,
}

/// Renders the presses of `folder` with the calibration in `file`. `diameter` is the ball's (m) for presses without one
/// in their labels. `background` is the image of the untouched gel if it is not called `background`.
pub fn similarity_to_presses(
    file: &Path,
    folder: &Path,
    diameter: f64,
    background: Option<&Path>,
) -> Result<RenderedPresses> {
    let (calibration, untouched) = SensorCalibration::read(file)?;
    let (columns, rows) = (calibration.columns, calibration.rows);
    let lens = calibration.lens;
    let sensor = CalibratedSensor::new(calibration, untouched)?;
    let mut presses = presses::read(folder, diameter, false, background)?;
    let (width, height) = (presses.background.width, presses.background.height);
    if (width, height) != (columns, rows) {
        bail!(
            "{}: found images of {width} x {height} pixels; expected {columns} x {rows}, by the calibration",
            folder.display()
        );
    }
    if let Some(lens) = &lens {
        presses = presses.rectified(lens)?;
    }
    let single = |rgb: &[u8]| rgb.iter().map(|&value| f32::from(value)).collect::<Vec<f32>>();
    let mut all = Vec::new();
    for press in &presses.presses {
        let image = sensor.render(&sensor.ball_penetration(press.center, press.radius, press.diameter))?;
        all.push(similarity::compare(&single(&image.rgb), &single(&press.photo.rgb), columns, 0..columns, 0..rows));
    }
    let similarity = Similarity::mean(&all).context("no presses")?;
    let surfaces = if Photometry::path(file).exists() {
        let errors = Photometry::read(file, &sensor)?.errors(&presses, &sensor);
        Some(errors.map(|errors| errors.accuracy()))
    } else {
        None
    };
    Ok(RenderedPresses { presses: all.len(), similarity, surfaces, left_out: presses.skipped })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_law_is_told_from_a_softer_one() {
        let mut rows = gel_responses(&Hand::ftac());
        assert!(reproduces_paper(&rows));
        rows[0].below_50_kpa = rows[1].below_50_kpa;
        assert!(!reproduces_paper(&rows), "the Winkler gel's sensitivity is not the paper's");
    }
}
