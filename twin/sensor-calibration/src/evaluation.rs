//! A calibration on presses it has not seen, the gel's response to the paper's probe, and whether the fit recovers a known
//! sensor.

use std::path::Path;

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use optics::Foundation;
use optics::calibration::recovery::{Recovery, recover};
use optics::calibration::{CalibratedSensor, Effort, LeftOut, SensorCalibration, Similarity, similarity};
use optics::foundation::{
    PROBE_RADIUS, ProbePoint, Sensitivity, WINKLER_LIKE_PAPER, bonded_layer_force, response_to, sensitivity,
};
use schemars::JsonSchema;
use serde::Serialize;

use super::calibration::presses;
use super::reconstruction::{Accuracy, Photometry};

/// Presses fitted in the rows of the recovery table.
const RECOVERY_ROWS: [usize; 5] = [1, 2, 4, 8, 16];
/// Noise of its images, grey levels.
const RECOVERY_NOISE: f64 = 1.0;

/// A gel under the paper's probe.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct GelResponse {
    /// The gel, or the law of its pressure.
    pub gel: &'static str,
    /// Sensitivity below 50 kPa.
    pub below_50_kpa: Sensitivity,
    /// Sensitivity up to 160 kPa.
    pub to_160_kpa: Sensitivity,
    /// Every tenth point of the response.
    pub points: Vec<ProbePoint>,
}

/// The paper's probe on its gel, on the hand's, and on the two gels that explain their difference.
pub fn gel_responses(hand: &Hand) -> Vec<GelResponse> {
    let winkler = Foundation::winkler(&hand.gel());
    let stiff = Foundation { modulus: WINKLER_LIKE_PAPER, ..winkler };
    let (modulus, thickness) = (winkler.modulus, winkler.thickness);
    let on =
        |gel: Foundation| -> Box<dyn Fn(f64) -> f64> { Box::new(move |depth| gel.ball_force(PROBE_RADIUS, depth)) };
    let bonded = move |depth: f64| bonded_layer_force(modulus, thickness, PROBE_RADIUS, depth);
    let gels = [
        ("paper's law", on(Foundation::paper(thickness))),
        ("hand's Winkler gel", on(winkler)),
        ("same E, bonded layer", Box::new(bonded)),
        ("Winkler, 0.42 MPa", on(stiff)),
    ];
    gels.into_iter()
        .map(|(gel, force)| {
            let points = response_to(thickness, force, 160.0, 161);
            GelResponse {
                gel,
                below_50_kpa: sensitivity(&points, 50.0),
                to_160_kpa: sensitivity(&points, 160.0),
                points: points.into_iter().step_by(10).collect(),
            }
        })
        .collect()
}

/// Whether the paper's law gives the paper's two sensitivities within 5 %, as straight as in the paper.
pub fn reproduces_paper(rows: &[GelResponse]) -> bool {
    let good = |found: Sensitivity, slope: f64, r_squared: f64| {
        (found.per_kpa / slope - 1.0).abs() < 0.05 && found.r_squared >= r_squared
    };
    rows.iter()
        .filter(|row| row.gel.starts_with("paper"))
        .all(|row| good(row.below_50_kpa, 0.48, 0.973) && good(row.to_160_kpa, 0.30, 0.967))
}

/// Sensitivities of each gel, a line each.
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

/// Fits to made-up presses of a known sensor, without and with images of its single lamps.
pub fn recoveries(seed: u64) -> Vec<Recovery> {
    let effort = Effort { steps: [25, 25], ..Effort::default() };
    RECOVERY_ROWS
        .iter()
        .flat_map(|&presses| [(presses, false), (presses, true)])
        .map(|(presses, single_lamps)| recover(presses, single_lamps, RECOVERY_NOISE, &effort, seed))
        .collect()
}

/// Errors of the fits, a line each.
pub fn recovery_table(rows: &[Recovery]) -> String {
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

/// Presses of a folder or a video, rendered with a calibration.
pub struct RenderedPresses {
    pub presses: usize,
    /// Mean over the presses, of whole images.
    pub similarity: Similarity,
    /// Errors of their surfaces, by look-up and by the network, if the way from colours to slopes is beside the calibration.
    pub surfaces: Option<[Accuracy; 2]>,
    /// Images that cannot be used.
    pub left_out: Vec<LeftOut>,
}

/// Renders the presses of `folder` with the calibration in `file`. `diameter` is the ball's (m) where the labels do not say it, and
/// `background` the untouched gel's image if it is not called so.
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
        let image = sensor.render(&sensor.ball(press.center, press.radius, press.diameter))?;
        all.push(similarity::compare(&single(&image.rgb), &single(&press.photo.rgb), columns, 0..columns, 0..rows));
    }
    let similarity = Similarity::mean(&all).context("no presses")?;
    let surfaces = if Photometry::path(file).exists() {
        let errors = Photometry::read(file, &sensor)?.errors(&presses, &sensor);
        Some(errors.map(|errors| errors.accuracy()))
    } else {
        None
    };
    Ok(RenderedPresses { presses: all.len(), similarity, surfaces, left_out: presses.left_out })
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
