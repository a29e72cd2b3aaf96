//! `ftac optics calibrate`: a real sensor's model from presses of a ball.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use clap::{Args, ValueEnum};
use lab::optics::calibration::{CHECKERBOARDS, CalibrationRun, Split, SplitPresses};

use crate::terminal::{Outcome, Terminal};

/// Which presses are fitted and which are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SplitArg {
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
    #[arg(long, value_enum, default_value_t = SplitArg::EvenOdd)]
    pub split: SplitArg,
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

/// Fits, evaluates, and writes the calibration file.
pub fn calibrate(terminal: &Terminal, args: &CalibrateArgs) -> Outcome {
    let started = Instant::now();
    let boards = args.folder.join(CHECKERBOARDS);
    if args.lens.is_some() && boards.exists() {
        bail!("--lens: found {} as well; expected one of the two", boards.display());
    }
    let split = match args.split {
        SplitArg::EvenOdd => Split::EvenOdd,
        SplitArg::Ball => Split::Ball,
        SplitArg::None => Split::None,
    };
    let diameter = 1e-3 * args.ball_diameter_mm;
    let presses = SplitPresses::read(&args.folder, diameter, args.ignore_labels, args.lens.as_deref(), split)?;
    if presses.held_out.presses.is_empty() && split != Split::None {
        bail!("--split: found no presses to hold out in {}; expected some, or `--split none`", args.folder.display());
    }
    if !terminal.quiet && !terminal.json {
        let lamps = match presses.fitted.lamps.len() {
            0 => String::new(),
            count => format!(" and {count} images of single lamps"),
        };
        let [fitted, held_out] = [&presses.fitted, &presses.held_out].map(|part| part.presses.len());
        eprintln!("fitting {fitted} presses{lamps}, holding out {held_out}");
    }
    let run = CalibrationRun::fit(presses, args.pixel_mm.map(|mm| 1e-3 * mm), args.ablation, terminal.seed)?;
    if let Some(path) = &args.out {
        run.write(path)?;
    }
    let wall = started.elapsed().as_secs_f64();
    if terminal.json {
        let mut value = run.to_json();
        value["wall_s"] = wall.into();
        println!("{value}");
    } else {
        print!("{}", run.table());
        println!("{wall:.0} s");
    }
    Ok(run.shortfall())
}
