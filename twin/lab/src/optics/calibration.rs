//! A real sensor's image-formation model from presses of a ball: the fit, the presses held out, and the fit without each part
//! of the model. [`scale`] finds the size of a pixel and refuses what cannot be right; [`sheet`] shows the presses.

pub mod scale;
pub mod sheet;

use std::path::Path;

use anyhow::{Context, Result, bail};
use image::RgbImage;
use optics::calibration::relocation;
use optics::calibration::zhang::{self, LensFit};
use optics::calibration::{
    Assumptions, BallFit, BallPress, CalibratedSensor, Effort, HeldOut, LeftOut, Lens, PressFolder, SensorCalibration,
    Similarity, Views,
};
use serde_json::{Value, json};

use self::scale::{PixelSize, PixelSource};
use self::sheet::Tile;
use super::reconstruction::{Method, Photometry};

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
    /// Images in which no press was found.
    left_out: Vec<LeftOut>,
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
        let left_out = std::mem::take(&mut presses.left_out);
        let (fitted, held_out) = match split {
            Split::EvenOdd => presses.even_odd(),
            Split::Ball => presses.split(|_, press| press.diameter < 1.001 * smallest),
            Split::None => presses.split(|_, _| true),
        };
        Ok(Self { fitted, held_out, left_out, lens, checkerboards })
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
    photometry: Photometry,
    held_out: Option<HeldOut>,
    /// The same on the image's grid: the fit renders with round profiles, the renderer for other objects works on the grid.
    on_grid: Option<HeldOut>,
    /// The same on one frame of the untouched gel instead of the mean of several.
    on_single_background: Option<HeldOut>,
    ablations: Vec<Ablation>,
    /// What told the size of a pixel.
    source: PixelSource,
    /// Images that were left out, and why.
    left_out: Vec<(String, String)>,
    tiles: Vec<Tile>,
    /// Presses fitted, held out, and found in their images without a label.
    presses: [usize; 3],
    single_lamp_images: usize,
    checkerboards: Option<LensFit>,
}

impl CalibrationRun {
    /// Fits the model. With `ablation` it is fitted again without each part of it. `learned` is called after each pass of a network
    /// over the presses.
    pub fn fit(presses: SplitPresses, options: &FitOptions, seed: u64, learned: impl Fn()) -> Result<Self> {
        let SplitPresses { mut fitted, mut held_out, left_out, lens, checkerboards } = presses;
        let FitOptions { pixel: source, shallow, ablation } = options;
        let source = match (source, &lens) {
            (PixelSource::Ruler { ends, length }, Some(lens)) => {
                PixelSource::Ruler { ends: ends.map(|end| lens.rectified(end)), length: *length }
            }
            _ => *source,
        };
        let measured = source.measured(fitted.background.width)?;
        if let Some(PixelSize { size, .. }) = measured {
            scale::check(&fitted, size, *shallow, false)?;
            scale::check(&held_out, size, *shallow, false)?;
        }
        let PixelSize { size, interval } = measured.map_or_else(|| scale::from_presses(&fitted, seed), Ok)?;
        let effort = Effort::default();
        let assumptions = Assumptions::full(Some(size));
        if fitted.presses.iter().chain(&held_out.presses).any(|press| !press.labelled) {
            let first = BallFit::new(&relocation::reliable(&fitted), assumptions, &effort, seed)?;
            (fitted, held_out) = (first.relocated(&fitted), first.relocated(&held_out));
            for folder in [&fitted, &held_out] {
                scale::check(folder, size, *shallow, true)?;
            }
        }
        let mut fit = BallFit::new(&fitted, assumptions, &effort, seed)?;
        let mut tiles: Vec<Tile> = left_out.iter().map(tile_of).collect();
        let misfits = Misfits::of(&fit, &fitted, &held_out);
        misfits.refuse_labelled()?;
        if !misfits.presses.is_empty() {
            for (press, error) in misfits.presses() {
                tiles.push(Tile::press(press, format!("left out: {error:.1} grey"), false));
            }
            let good = |press: &BallPress| !misfits.presses.iter().any(|(bad, _)| bad.name == press.name);
            held_out = held_out.split(|_, press| good(press)).0;
            let kept = fitted.split(|_, press| good(press)).0;
            if kept.presses.len() < fitted.presses.len() {
                fitted = kept;
                fit = BallFit::new(&fitted, assumptions, &effort, seed)?;
            }
        }
        let left_out = left_out
            .iter()
            .map(|image| (image.name.clone(), image.reason.clone()))
            .chain(misfits.presses().map(|(press, error)| {
                (
                    press.name.clone(),
                    format!(
                        "found a circle that the model misses by {error:.1} grey levels, other presses by {:.1}",
                        misfits.typical
                    ),
                )
            }))
            .collect();
        for (folder, errors) in [(&fitted, fit.press_errors(&fitted)), (&held_out, fit.press_errors(&held_out))] {
            tiles.extend(
                folder.presses.iter().zip(errors).map(|(press, error)| {
                    Tile::press(press, format!("r {:.0} px, {error:.1} grey", press.radius), true)
                }),
            );
        }
        tiles.sort_by(|a, b| a.name.cmp(&b.name));
        fit.lens = lens;
        fit.pixel_interval = interval;
        fit.parameters.extend(checkerboards.iter().flat_map(|found| found.parameters.clone()));
        let sensor = CalibratedSensor::new(SensorCalibration::new(&fit, String::new()), fit.background.clone())?;
        let photometry = Photometry::learn(&fitted, &held_out, &sensor, seed, learned)?;
        // Where nothing is held out, half of the presses tells how well a fit to the other half renders.
        let (judge, judged) = if held_out.presses.is_empty() {
            let (even, odd) = fitted.even_odd();
            (BallFit::new(&even, assumptions, &effort, seed)?, odd)
        } else {
            (fit.clone(), held_out.clone())
        };
        let on_grid =
            fit.evaluate_with(&held_out, |press| sensor.render_ball(press.center, press.radius, press.diameter));
        let single: Vec<f32> = fitted.background.rgb.iter().map(|&value| f32::from(value)).collect();
        let mut ablations = Vec::new();
        if *ablation {
            for (model, assumptions) in Assumptions::ablations(Some(size)) {
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
            held_out: judge.evaluate(&judged),
            on_grid,
            on_single_background: fit.on_background(single).evaluate(&held_out),
            ablations,
            presses: [fitted.presses.len(), held_out.presses.len(), unlabelled],
            source,
            left_out,
            tiles,
            single_lamp_images: fitted.lamps.len(),
            checkerboards,
            photometry,
            fit,
        })
    }

    /// Writes the calibration file, with the untouched gel's image and the way from colours to slopes beside it.
    pub fn write(&self, path: &Path) -> Result<()> {
        SensorCalibration::write(&self.fit, path)?;
        self.photometry.write(path)
    }

    /// In which respect the fit falls short, so that it must not be used.
    pub fn shortfall(&self) -> Option<String> {
        let Some(HeldOut { rendered, floor, .. }) = &self.held_out else {
            return Some("no press could be held out: there is no figure for the quality of the fit".to_owned());
        };
        let (found, least) = (rendered.crop.psnr, floor.crop.psnr);
        if !found.is_finite() || !least.is_finite() {
            return Some(format!("the quality of the fit cannot be told: {found} dB, {least} dB without a model"));
        }
        (found <= least).then(|| {
            format!(
                "the model renders the held-out presses no better than the background alone does: {found:.2} dB, {least:.2} dB"
            )
        })
    }

    /// Draws all presses with their circles and errors.
    pub fn sheet(&self) -> Result<RgbImage> {
        sheet::draw(&self.tiles)
    }

    /// What a user has to know beside the result.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> =
            self.left_out.iter().map(|(name, reason)| format!("{name} left out: {reason}")).collect();
        if let (PixelSource::Presses, Some([low, high])) = (self.source, self.fit.pixel_interval) {
            warnings.push(format!(
                "the size of a pixel is known only to lie between {:.4} and {:.4} mm, and every depth as little: measure it \
                 (--ruler, --field-mm or --pixel-mm)",
                1e3 * low,
                1e3 * high
            ));
        }
        warnings
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
            "reconstruction": {
                "look_up": self.photometry.accuracy(Method::LookUp),
                "network": self.photometry.accuracy(Method::Network),
                "held_out": self.photometry.held_out,
            },
            "residual_grey": self.fit.residual,
            "pixel_mm": 1e3 * self.fit.pixel,
            "pixel_interval_mm": file.pixel_interval_mm,
            "pixel_measured": self.source != PixelSource::Presses,
            "left_out": self.left_out,
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
        text += &format!(
            "\n{:18} {:>12} {:>14} {:>14} {:>12} {:>8}\n",
            "reconstruction", "normals deg", "found / depth", "depth rms", "height rms", "presses"
        );
        for method in Method::ALL {
            let found = self.photometry.accuracy(method);
            text += &format!(
                "{:18} {:>12.2} {:>14.3} {:>12.1} % {:>9.3} mm {:>8}\n",
                method.name(),
                found.normals_deg.mean,
                found.depth_ratio,
                100.0 * found.depth_relative,
                1e3 * found.height,
                found.presses
            );
        }
        text
    }
}

/// How to fit.
#[derive(Debug, Clone, Copy)]
pub struct FitOptions {
    /// What tells the size of a pixel.
    pub pixel: PixelSource,
    /// Whether all presses may be shallow.
    pub shallow: bool,
    /// Fit again without each part of the model.
    pub ablation: bool,
}

/// Presses that the model cannot explain, while it explains the others.
struct Misfits {
    /// With their errors, grey levels.
    presses: Vec<(BallPress, f64)>,
    /// Median of all presses' errors, grey levels.
    typical: f64,
}

/// A press is a misfit if its error is more than so many times the median, and by so many grey levels more.
const MISFIT: (f64, f64) = (2.5, 4.0);

impl Misfits {
    fn of(fit: &BallFit, fitted: &PressFolder, held_out: &PressFolder) -> Self {
        let errors = [fitted, held_out].map(|folder| fit.press_errors(folder)).concat();
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let typical = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let all = fitted.presses.iter().chain(&held_out.presses).cloned().zip(errors);
        let presses = all.filter(|(_, error)| *error > MISFIT.0 * typical && *error > typical + MISFIT.1).collect();
        Self { presses, typical }
    }

    fn presses(&self) -> impl Iterator<Item = (&BallPress, f64)> {
        self.presses.iter().map(|(press, error)| (press, *error))
    }

    /// A label says that there is a ball: an error where there is none.
    fn refuse_labelled(&self) -> Result<()> {
        if let Some((press, error)) = self.presses().find(|(press, _)| press.labelled) {
            bail!(
                "{}: found what the model of a ball misses by {error:.1} grey levels, other presses by {:.1}; expected a ball where \
                 the label says",
                press.name,
                self.typical
            );
        }
        Ok(())
    }
}

fn tile_of(image: &LeftOut) -> Tile {
    Tile {
        name: image.name.clone(),
        photo: image.photo.clone(),
        circle: None,
        note: "no press found".to_owned(),
        used: false,
    }
}

fn cell(found: Similarity) -> String {
    format!("{:.4} / {:.4} / {:.2} dB", found.l1, found.ssim, found.psnr)
}
