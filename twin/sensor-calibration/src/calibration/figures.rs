//! Results of a calibration, as JSON and as a table.

use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::SensorModel;
use tactile_optics::calibration::{FittedParameter, Lens, SensorCalibration, Similarity, ViewSimilarity};

use super::CalibrationRun;
use super::scale::PixelSource;
use crate::reconstruction::{Accuracy, SlopeMethod};

/// Numbers of presses.
#[derive(Debug, Serialize, JsonSchema)]
struct PressCounts {
    fitted: usize,
    /// Presses that were held out once.
    held_out: usize,
    /// Presses found in their images without a label.
    found_without_label: usize,
}

/// Errors of reconstructed surfaces of held-out presses.
#[derive(Debug, Serialize, JsonSchema)]
struct Surfaces<'a> {
    look_up: &'a Accuracy,
    network: &'a Accuracy,
    /// Presses from which the saved tables were learned.
    learned_from: usize,
}

/// Result of a fit that leaves out a part of the model.
#[derive(Debug, Serialize, JsonSchema)]
struct AblationFigures {
    /// Part that was left out.
    model: &'static str,
    /// RMS residual of the fit, grey levels.
    residual_grey: f64,
    /// Similarity of renders to the held-out presses.
    held_out: Option<ViewSimilarity>,
}

#[derive(Debug, Serialize, JsonSchema)]
struct Checkerboards {
    /// Number of pictures.
    pictures: usize,
    /// Root mean square reprojection error, pixels.
    residual_px: f64,
}

/// Results of a calibration.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CalibrationFigures<'a> {
    presses: PressCounts,
    single_lamp_images: usize,
    /// Similarity of renders to the held-out presses.
    held_out: Option<ViewSimilarity>,
    /// Similarity of the untouched image to the held-out presses: the baseline without a model.
    floor: Option<ViewSimilarity>,
    /// As `held_out`, rendered on the image's grid.
    held_out_on_grid: Option<ViewSimilarity>,
    /// As `held_out`, rendered on one frame of the untouched gel.
    held_out_on_single_background: Option<ViewSimilarity>,
    /// Best similarity that camera noise and drift allow.
    ceiling: Option<ViewSimilarity>,
    /// As `ceiling`, for one frame of the untouched gel.
    ceiling_of_single_frames: Option<ViewSimilarity>,
    /// Errors of reconstructed surfaces of held-out presses.
    reconstruction: Surfaces<'a>,
    /// RMS residual of the fit, grey levels.
    residual_grey: f64,
    /// Size of a pixel on the gel, mm.
    pixel_mm: f64,
    /// 95 % interval of the pixel's size, mm.
    pixel_interval_mm: Option<[f64; 2]>,
    /// False if the pixel size follows from the presses alone.
    pixel_measured: bool,
    /// Rejected images, with the reasons.
    left_out: &'a [(String, String)],
    parameters: &'a [FittedParameter],
    /// The camera's lens, if images are rectified first.
    lens: Option<Lens>,
    /// The fitted sensor.
    model: SensorModel,
    /// Doubts about the calibration.
    warnings: Vec<String>,
    ablation: Vec<AblationFigures>,
    /// Pictures of checkerboards from which the lens was fitted.
    checkerboards: Option<Checkerboards>,
}

impl CalibrationRun {
    /// Returns all results except the run time.
    pub fn figures(&self) -> CalibrationFigures<'_> {
        let held = self.held_out.as_ref();
        let (grid, single) = (self.on_grid.as_ref(), self.on_single_background.as_ref());
        let ablation = self.ablations.iter().map(|row| AblationFigures {
            model: row.model,
            residual_grey: row.residual_grey,
            held_out: row.similarity,
        });
        let [fitted, held_out, unlabelled] = self.presses;
        let file = SensorCalibration::new(&self.fit, String::new());
        let boards = self.checkerboards.as_ref();
        CalibrationFigures {
            presses: PressCounts { fitted, held_out, found_without_label: unlabelled },
            single_lamp_images: self.single_lamp_images,
            held_out: held.map(|held| held.rendered),
            floor: held.map(|held| held.floor),
            held_out_on_grid: grid.map(|held| held.rendered),
            held_out_on_single_background: single.map(|held| held.rendered),
            ceiling: held.map(|held| held.ceiling),
            ceiling_of_single_frames: single.map(|held| held.ceiling),
            reconstruction: Surfaces {
                look_up: self.photometry.accuracy(SlopeMethod::LookUp),
                network: self.photometry.accuracy(SlopeMethod::Network),
                learned_from: self.photometry.presses,
            },
            residual_grey: self.fit.residual,
            pixel_mm: 1e3 * self.fit.pixel,
            pixel_interval_mm: file.pixel_interval_mm,
            pixel_measured: self.source != PixelSource::Presses,
            left_out: &self.left_out,
            parameters: &self.fit.parameters,
            lens: file.lens,
            model: file.model,
            warnings: self.warnings(),
            ablation: ablation.collect(),
            checkerboards: boards.map(|found| Checkerboards { pictures: found.pictures, residual_px: found.residual }),
        }
    }

    /// Returns the results as text: parameters, then similarities.
    pub fn table(&self) -> String {
        let mut text = String::new();
        if let Some(found) = &self.checkerboards {
            text += &format!("lens: {} checkerboards, residual {:.3} px\n", found.pictures, found.residual);
        }
        text += &format!("{:34} {:>12}  {:>10}\n", "parameter", "value", "deviation");
        for parameter in &self.fit.parameters {
            let certainty = match (parameter.deviation, parameter.on_bound) {
                (_, true) => "on bound".to_owned(),
                (Some(deviation), _) => format!("{deviation:.2e}"),
                (None, _) => "unknown".to_owned(),
            };
            text += &format!("{:34} {:>12.5e}  {certainty:>10}\n", parameter.name, parameter.value);
        }
        text += &match self.fit.pixel_interval {
            Some([low, high]) => {
                format!("pixel {:.5} mm, 95 % interval {:.5} to {:.5}\n", 1e3 * self.fit.pixel, 1e3 * low, 1e3 * high)
            }
            None => format!("pixel {:.5} mm, as given\n", 1e3 * self.fit.pixel),
        };
        text += &format!("residual {:.2} grey levels\n", self.fit.residual);
        text += &format!("\n{:18} {:>28}   {:>28}\n", "L1 / SSIM / PSNR", "full frame", "crop");
        let held = self.held_out.as_ref();
        let rows = [
            ("floor", held.map(|held| held.floor)),
            ("held out", held.map(|held| held.rendered)),
            ("ceiling", held.map(|held| held.ceiling)),
            ("  on the grid", self.on_grid.as_ref().map(|held| held.rendered)),
            ("  single frame", self.on_single_background.as_ref().map(|held| held.rendered)),
        ];
        let ablations = self.ablations.iter().map(|row| (row.model, row.similarity));
        for (name, views) in rows.into_iter().chain(ablations) {
            if let Some(views) = views {
                text += &format!("{name:18} {:>28}   {:>28}\n", cell(views.full), cell(views.crop));
            }
        }
        text.push('\n');
        text += &accuracy_table(&SlopeMethod::ALL.map(|method| self.photometry.accuracy(method)));
        text
    }
}

/// Formats the errors of reconstructed surfaces of held-out presses, by look-up and by the network.
pub fn accuracy_table(accuracy: &[&Accuracy; 2]) -> String {
    let mut text = format!(
        "{:12} {:>11} {:>9} {:>12} {:>14} {:>12} {:>12} {:>8}\n",
        "held out", "normals deg", "level deg", "found/slope", "found/depth", "depth rms", "height rms", "presses"
    );
    for (method, found) in SlopeMethod::ALL.iter().zip(accuracy) {
        text += &format!(
            "{:12} {:>11.2} {:>9.1} {:>12.3} {:>14.3} {:>10.1} % {:>9.3} mm {:>8}\n",
            method.name(),
            found.normals_deg.mean,
            found.level_deg,
            found.slope_ratio,
            found.depth_ratio,
            100.0 * found.depth_relative,
            1e3 * found.height,
            found.presses
        );
    }
    text
}

fn cell(found: Similarity) -> String {
    format!("{:.4} / {:.4} / {:.2} dB", found.l1, found.ssim, found.psnr)
}
