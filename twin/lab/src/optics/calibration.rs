//! A real sensor's image-formation model from presses of a ball: the fit, the presses held out, and the fit without each part
//! of the model.

use std::path::Path;

use anyhow::{Context, Result};
use optics::calibration::zhang::{self, LensFit};
use optics::calibration::{
    Assumptions, BallFit, CalibratedSensor, Effort, HeldOut, Lens, PressFolder, SensorCalibration, Similarity, Views,
};
use serde_json::{Value, json};

/// Which presses are fitted and which are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// Fit presses 0, 2, 4, ... by file name, hold out the others.
    EvenOdd,
    /// Fit the presses of the smallest ball, hold out those of larger ones.
    Ball,
    /// Fit all presses; nothing is held out.
    None,
}

/// Folder of pictures of a checkerboard inside a folder of presses.
pub const CHECKERBOARDS: &str = "checkerboards";

/// The presses of a folder, rectified, in two parts.
pub struct SplitPresses {
    /// Presses that the model is fitted to.
    pub fitted: PressFolder,
    /// Presses that it is then compared with.
    pub held_out: PressFolder,
    lens: Option<Lens>,
    checkerboards: Option<LensFit>,
}

impl SplitPresses {
    /// Reads `folder`. `diameter` is the ball's (m) where the labels do not say it. The images are rectified with `lens`, or
    /// with the lens fitted to the folder's checkerboards.
    pub fn read(folder: &Path, diameter: f64, ignore_labels: bool, lens: Option<&Path>, split: Split) -> Result<Self> {
        let mut presses = PressFolder::read(folder, diameter, ignore_labels)?;
        let lens = lens.map(Lens::read).transpose().context("--lens")?;
        let boards = folder.join(CHECKERBOARDS);
        let checkerboards = if boards.exists() {
            Some(zhang::read(&boards, [presses.background.width, presses.background.height])?)
        } else {
            None
        };
        let lens = lens.or(checkerboards.as_ref().map(|fit| fit.lens));
        if let Some(lens) = &lens {
            presses = presses.rectified(lens).context("the camera's lens")?;
        }
        let smallest = presses.presses.iter().map(|press| press.diameter).fold(f64::INFINITY, f64::min);
        let (fitted, held_out) = match split {
            Split::EvenOdd => presses.even_odd(),
            Split::Ball => presses.split(|_, press| press.diameter < 1.001 * smallest),
            Split::None => presses.split(|_, _| true),
        };
        Ok(Self { fitted, held_out, lens, checkerboards })
    }
}

/// The fit without a part of the model.
struct Ablation {
    model: &'static str,
    residual_grey: f64,
    /// On the held-out presses, or on the fitted ones where none are held out.
    similarity: Option<Views>,
}

/// A fitted sensor and how well it renders presses that it has not seen.
pub struct CalibrationRun {
    fit: BallFit,
    held_out: Option<HeldOut>,
    /// The same on the image's grid: the fit renders with round profiles, the renderer for other objects works on the grid.
    on_grid: Option<HeldOut>,
    /// The same on one frame of the untouched gel instead of the mean of several.
    on_single_background: Option<HeldOut>,
    ablations: Vec<Ablation>,
    /// Presses fitted, held out, and found in their images without a label.
    presses: [usize; 3],
    single_lamp_images: usize,
    checkerboards: Option<LensFit>,
}

impl CalibrationRun {
    /// Fits the model; `pixel` is a pixel's size on the gel (m) where it is known. With `ablation` it is fitted again without
    /// each part of it.
    pub fn fit(presses: SplitPresses, pixel: Option<f64>, ablation: bool, seed: u64) -> Result<Self> {
        let SplitPresses { fitted, held_out, lens, checkerboards } = presses;
        let effort = Effort::default();
        let mut fit = BallFit::new(&fitted, Assumptions::full(pixel), &effort, seed)?;
        fit.lens = lens;
        fit.parameters.extend(checkerboards.iter().flat_map(|found| found.parameters.clone()));
        let sensor = CalibratedSensor::new(SensorCalibration::new(&fit, String::new()), fit.background.clone())?;
        let on_grid =
            fit.evaluate_with(&held_out, |press| sensor.render_ball(press.center, press.radius, press.diameter));
        let single: Vec<f32> = fitted.background.rgb.iter().map(|&value| f32::from(value)).collect();
        let mut ablations = Vec::new();
        if ablation {
            for (model, assumptions) in Assumptions::ablations(pixel) {
                let again = if assumptions == fit.assumptions {
                    fit.clone()
                } else {
                    fit.again(&fitted, assumptions, &effort, seed)
                };
                let similarity = again.evaluate(if held_out.presses.is_empty() { &fitted } else { &held_out });
                ablations.push(Ablation {
                    model,
                    residual_grey: again.residual,
                    similarity: similarity.map(|held| held.rendered),
                });
            }
        }
        let unlabelled = fitted.presses.iter().chain(&held_out.presses).filter(|press| !press.labelled).count();
        Ok(Self {
            held_out: fit.evaluate(&held_out),
            on_grid,
            on_single_background: fit.on_background(single).evaluate(&held_out),
            ablations,
            presses: [fitted.presses.len(), held_out.presses.len(), unlabelled],
            single_lamp_images: fitted.lamps.len(),
            checkerboards,
            fit,
        })
    }

    /// Writes the calibration file, with the untouched gel's image beside it.
    pub fn write(&self, path: &Path) -> Result<()> {
        Ok(SensorCalibration::write(&self.fit, path)?)
    }

    /// In which respect the fit falls short.
    pub fn shortfall(&self) -> Option<String> {
        let worse = self.held_out.as_ref().is_some_and(|held| held.rendered.crop.psnr <= held.floor.crop.psnr);
        worse.then(|| "the model renders the held-out presses no better than the background alone does".to_owned())
    }

    /// Everything found, but for the time it took.
    pub fn to_json(&self) -> Value {
        let held = self.held_out.as_ref();
        let (grid, single) = (self.on_grid.as_ref(), self.on_single_background.as_ref());
        let ablation: Vec<Value> = self
            .ablations
            .iter()
            .map(|row| json!({"model": row.model, "residual_grey": row.residual_grey, "held_out": row.similarity}))
            .collect();
        let [fitted, held_out, unlabelled] = self.presses;
        let file = SensorCalibration::new(&self.fit, String::new());
        let boards = self.checkerboards.as_ref();
        json!({
            "presses": {"fitted": fitted, "held_out": held_out, "found_without_label": unlabelled},
            "single_lamp_images": self.single_lamp_images,
            "held_out": held.map(|held| held.rendered),
            "floor": held.map(|held| held.floor),
            "held_out_on_grid": grid.map(|held| held.rendered),
            "held_out_on_single_background": single.map(|held| held.rendered),
            "ceiling": held.map(|held| held.ceiling),
            "ceiling_of_single_frames": single.map(|held| held.ceiling),
            "residual_grey": self.fit.residual,
            "pixel_mm": 1e3 * self.fit.pixel,
            "pixel_given": self.fit.assumptions.pixel.is_some(),
            "parameters": self.fit.parameters,
            "lens": file.lens,
            "model": file.model,
            "ablation": ablation,
            "checkerboards": boards.map(|found| json!({"pictures": found.pictures, "residual_px": found.residual})),
        })
    }

    /// The same as text: parameters, then similarities.
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
        text
    }
}

fn cell(found: Similarity) -> String {
    format!("{:.4} / {:.4} / {:.2} dB", found.l1, found.ssim, found.psnr)
}
