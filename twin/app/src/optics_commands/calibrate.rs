//! `ftac optics calibrate`: a real sensor's model from presses of a ball.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use optics::calibration::{
    Assumptions, BallFit, CalibratedSensor, Effort, HeldOut, Lens, PressFolder, SensorCalibration, Views, zhang,
};
use serde_json::{Value, json};

use crate::cli::Cli;
use crate::optics_commands::Outcome;

/// Which presses are fitted and which are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Split {
    /// Fit presses 0, 2, 4, ... by file name, hold out the others.
    EvenOdd,
    /// Fit the presses of the smallest ball, hold out those of larger ones.
    Ball,
    /// Fit all presses; nothing is held out.
    None,
}

/// Arguments of `optics calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Folder with `background.png`, press images and perhaps `labels.csv`; perhaps `lamps/` (the untouched gel under each
    /// lamp alone) and `checkerboards/` (three or more pictures and `board.toml` with `columns` and `rows`, its inner corners).
    pub folder: PathBuf,
    /// Diameter of the ball, mm (where the labels do not say it).
    #[arg(long)]
    pub ball_diameter_mm: f64,
    /// Size of a pixel on the gel, mm; default: fitted, which a ball's shading allows only roughly.
    #[arg(long)]
    pub pixel_mm: Option<f64>,
    /// Which presses are held out.
    #[arg(long, value_enum, default_value_t = Split::EvenOdd)]
    pub split: Split,
    /// The camera's lens (TOML: focal, center, radial, tangential), if the images are not rectified yet and there are no
    /// checkerboards.
    #[arg(long)]
    pub lens: Option<PathBuf>,
    /// Find the presses in the images even if there are labels.
    #[arg(long)]
    pub ignore_labels: bool,
    /// Fit again without each part of the model.
    #[arg(long)]
    pub ablation: bool,
    /// The calibration file (TOML) to write; the untouched gel's image goes beside it.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Runs the command.
pub fn calibrate(cli: &Cli, args: &CalibrateArgs) -> Outcome {
    let started = Instant::now();
    let mut folder = PressFolder::read(&args.folder, 1e-3 * args.ball_diameter_mm, args.ignore_labels)?;
    let boards = args.folder.join("checkerboards");
    if args.lens.is_some() && boards.exists() {
        bail!("--lens: found {} as well; expected one of the two", boards.display());
    }
    let lens = args.lens.as_deref().map(Lens::read).transpose().context("--lens")?;
    let from_boards = if boards.exists() {
        Some(zhang::read(&boards, [folder.background.width, folder.background.height])?)
    } else {
        None
    };
    let lens = lens.or(from_boards.as_ref().map(|found| found.lens));
    if let Some(lens) = &lens {
        folder = folder.rectified(lens).context("the camera's lens")?;
    }
    let smallest = folder.presses.iter().map(|press| press.diameter).fold(f64::INFINITY, f64::min);
    let (fitted, held_out) = match args.split {
        Split::EvenOdd => folder.even_odd(),
        Split::Ball => folder.split(|_, press| press.diameter < 1.001 * smallest),
        Split::None => folder.split(|_, _| true),
    };
    if held_out.presses.is_empty() && args.split != Split::None {
        bail!("--split: found no presses to hold out in {}; expected some, or `--split none`", args.folder.display());
    }
    let effort = Effort::default();
    let assumptions = Assumptions::full(args.pixel_mm.map(|mm| 1e-3 * mm));
    if !cli.quiet && !cli.json {
        let lamps = match fitted.lamps.len() {
            0 => String::new(),
            count => format!(" and {count} images of single lamps"),
        };
        eprintln!("fitting {} presses{lamps}, holding out {}", fitted.presses.len(), held_out.presses.len());
    }
    let mut fit = BallFit::new(&fitted, assumptions, &effort, cli.seed)?;
    fit.lens = lens;
    fit.parameters.extend(from_boards.iter().flat_map(|found| found.parameters.clone()));
    let held = fit.evaluate(&held_out);
    // The fit renders with round profiles; the renderer that other objects need works on the image's grid. Both are reported.
    let sensor = CalibratedSensor::new(SensorCalibration::new(&fit, String::new()), fit.background.clone())?;
    let on_grid = fit.evaluate_with(&held_out, |press| sensor.render_ball(press.center, press.radius, press.diameter));
    let single: Vec<f32> = fitted.background.rgb.iter().map(|&value| f32::from(value)).collect();
    let on_single = fit.on_background(single).evaluate(&held_out);
    let mut table = Vec::new();
    if args.ablation {
        for (name, assumptions) in Assumptions::ablations(assumptions.pixel) {
            let again = if assumptions == fit.assumptions {
                fit.clone()
            } else {
                fit.again(&fitted, assumptions, &effort, cli.seed)
            };
            let similarity = again.evaluate(if held_out.presses.is_empty() { &fitted } else { &held_out });
            table.push((name, again.residual, similarity.map(|held| held.rendered)));
        }
    }
    if let Some(path) = &args.out {
        SensorCalibration::write(&fit, path)?;
    }
    let wall = started.elapsed().as_secs_f64();
    if cli.json {
        let mut value =
            as_json(&fit, &fitted, &held_out, held.as_ref(), &table, [on_grid.as_ref(), on_single.as_ref()], wall)?;
        value["checkerboards"] =
            json!(from_boards.map(|found| json!({"pictures": found.pictures, "residual_px": found.residual})));
        println!("{value}");
    } else {
        if let Some(found) = &from_boards {
            println!("lens: {} checkerboards, residual {:.3} px", found.pictures, found.residual);
        }
        tell(&fit, held.as_ref(), &table, [on_grid.as_ref(), on_single.as_ref()], wall);
    }
    let worse = held.is_some_and(|held| held.rendered.crop.psnr <= held.floor.crop.psnr);
    Ok(worse.then(|| "the model renders the held-out presses no better than the background alone does".to_owned()))
}

type Table = [(&'static str, f64, Option<Views>)];

fn as_json(
    fit: &BallFit,
    fitted: &PressFolder,
    held_out: &PressFolder,
    held: Option<&HeldOut>,
    table: &Table,
    others: [Option<&HeldOut>; 2],
    wall: f64,
) -> Result<Value> {
    let found = fitted.presses.iter().chain(&held_out.presses).filter(|press| !press.labelled).count();
    let ablation: Vec<Value> = table
        .iter()
        .map(|(name, residual, views)| json!({"model": name, "residual_grey": residual, "held_out": views}))
        .collect();
    let file = SensorCalibration::new(fit, String::new());
    Ok(json!({
        "presses": {"fitted": fitted.presses.len(), "held_out": held_out.presses.len(), "found_without_label": found},
        "single_lamp_images": fitted.lamps.len(),
        "held_out": held.map(|held| held.rendered),
        "floor": held.map(|held| held.floor),
        "held_out_on_grid": others[0].map(|held| held.rendered),
        "held_out_on_single_background": others[1].map(|held| held.rendered),
        "ceiling": held.map(|held| held.ceiling),
        "ceiling_of_single_frames": others[1].map(|held| held.ceiling),
        "residual_grey": fit.residual,
        "pixel_mm": 1e3 * fit.pixel,
        "pixel_given": fit.assumptions.pixel.is_some(),
        "parameters": fit.parameters,
        "lens": file.lens,
        "model": file.model,
        "ablation": ablation,
        "wall_s": wall,
    }))
}

fn tell(fit: &BallFit, held: Option<&HeldOut>, table: &Table, others: [Option<&HeldOut>; 2], wall: f64) {
    println!("{:34} {:>12}  {:>10}", "parameter", "value", "deviation");
    for parameter in &fit.parameters {
        let certainty = match (parameter.deviation, parameter.on_bound) {
            (_, true) => "on bound".to_owned(),
            (Some(deviation), _) => format!("{deviation:.2e}"),
            (None, _) => "unknown".to_owned(),
        };
        println!("{:34} {:>12.5e}  {certainty:>10}", parameter.name, parameter.value);
    }
    println!("residual {:.2} grey levels", fit.residual);
    println!("\n{:18} {:>28}   {:>28}", "L1 / SSIM / PSNR", "full frame", "crop");
    let row = |name: &str, views: &Views| {
        let cell = |s: optics::calibration::Similarity| format!("{:.4} / {:.4} / {:.2} dB", s.l1, s.ssim, s.psnr);
        println!("{name:18} {:>28}   {:>28}", cell(views.full), cell(views.crop));
    };
    if let Some(held) = held {
        row("floor", &held.floor);
        row("held out", &held.rendered);
        row("ceiling", &held.ceiling);
    }
    for (name, held) in ["  on the grid", "  single frame"].iter().zip(others) {
        if let Some(held) = held {
            row(name, &held.rendered);
        }
    }
    for (name, _, views) in table {
        if let Some(views) = views {
            row(name, views);
        }
    }
    println!("{wall:.0} s");
}
