//! `ftac optics calibrate`: fits the model of a real sensor to presses of a ball.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use ftac_platform::file_access::folder_of;
use image::RgbImage;
use indicatif::ProgressStyle;
use schemars::JsonSchema;
use sensor_calibration::calibration::figures::CalibrationFigures;
use sensor_calibration::calibration::presses::{CHECKERBOARD_FOLDER, CheckedPresses, PressSource};
use sensor_calibration::calibration::scale::PixelSource;
use sensor_calibration::calibration::{CalibrationRun, FitOptions, HoldOutSplit, sheet};
use serde::Serialize;

use crate::options::output_file::is_same_place;
use crate::terminal::{Outcome, Terminal};

/// Presses held out to measure the calibration. The written calibration is then fitted to all presses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SplitArg {
    /// Hold out each press once: a quarter of them at a time, half of them from 24 presses on.
    #[value(alias = "none")]
    Folds,
    /// Hold out presses 1, 3, 5, ... by file name.
    EvenOdd,
    /// Hold out the presses of all balls but the smallest.
    Ball,
}

/// Arguments of `optics calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Folder with `background.png`, press images (PNG, JPEG, BMP) and optionally `labels.csv`, `lamps/` (the untouched
    /// gel under each lamp alone) and `checkerboards/` (three or more pictures and `board.toml` with `columns` and
    /// `rows`, its inner corners). Or a video of presses one after another, which begins untouched.
    pub folder: PathBuf,
    /// Image of the untouched gel, if it is not named `background.png`.
    #[arg(long)]
    pub background: Option<PathBuf>,
    /// Diameter of the ball, mm (for presses whose label does not give it).
    #[arg(long)]
    pub ball_diameter_mm: f64,
    /// Pixel size on the gel, mm. One of --pixel-mm, --field-mm, --ruler and --pixel-from-presses is needed.
    #[arg(long, group = "pixel")]
    pub pixel_mm: Option<f64>,
    /// Width of the field of view on the gel, mm, as data sheets give it.
    #[arg(long, group = "pixel")]
    pub field_mm: Option<f64>,
    /// Two points of an image, pixels, and their distance on the gel, mm: column,row,column,row,distance.
    #[arg(long, group = "pixel", value_delimiter = ',', num_args = 1)]
    pub ruler: Option<Vec<f64>>,
    /// Estimate the pixel size from the presses alone, which determine it only within a factor of two or three.
    #[arg(long, group = "pixel")]
    pub pixel_from_presses: bool,
    /// All presses are shallow: accept circles that are small against the ball.
    #[arg(long)]
    pub shallow: bool,
    /// File for a sheet of all presses (PNG) with their circles and errors; presses left out are red. It is written
    /// before the fit, and again with the errors.
    #[arg(long)]
    pub sheet: Option<PathBuf>,
    /// Presses held out to measure the calibration.
    #[arg(long, value_enum, default_value_t = SplitArg::Folds)]
    pub split: SplitArg,
    /// Lens parameters of the camera (TOML: focal, center, radial, tangential), if the images are not rectified yet and
    /// there are no checkerboards.
    #[arg(long)]
    pub lens: Option<PathBuf>,
    /// Detect the presses in the images even if there are labels.
    #[arg(long)]
    pub ignore_labels: bool,
    /// Ablation: fit again without each part of the model.
    #[arg(long)]
    pub ablation: bool,
    /// Calibration file (TOML) to write; the untouched gel's image and the data for `optics reconstruct` go beside it.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// JSON output of `optics calibrate`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CalibrateOutput<'a> {
    #[serde(flatten)]
    figures: CalibrationFigures<'a>,
    /// Wall time, s.
    wall_s: f64,
}

/// Runs `ftac optics calibrate`: fits, evaluates, and writes the calibration file.
pub fn calibrate(terminal: &Terminal, args: &CalibrateArgs) -> Outcome {
    let started = Instant::now();
    let boards = args.folder.join(CHECKERBOARD_FOLDER);
    if args.lens.is_some() && boards.exists() {
        bail!("--lens: found {} as well; expected one of the two", boards.display());
    }
    let split = match args.split {
        SplitArg::Folds => HoldOutSplit::Folds,
        SplitArg::EvenOdd => HoldOutSplit::EvenOdd,
        SplitArg::Ball => HoldOutSplit::Ball,
    };
    let pixel = pixel_source(args)?;
    if let Some(path) = &args.out {
        check_out(path, &args.folder)?;
    }
    if let Some(sheet) = args.sheet.as_ref().filter(|sheet| is_same_place(folder_of(sheet), &args.folder)) {
        bail!("--sheet {}: found the folder of the presses, expected another", sheet.display());
    }
    let presses = CheckedPresses::read(
        &PressSource {
            path: &args.folder,
            diameter: 1e-3 * args.ball_diameter_mm,
            ignore_labels: args.ignore_labels,
            background: args.background.as_deref(),
            lens: args.lens.as_deref(),
            pixel,
            shallow: args.shallow,
        },
        |tiles| match &args.sheet {
            Some(path) => save_sheet(&sheet::draw(tiles)?, path),
            None => Ok(()),
        },
    )?;
    // Presses out of line are reported before the fit.
    let left_out: Vec<String> = presses.left_out().map(|(name, reason)| format!("{name} left out: {reason}")).collect();
    left_out.iter().for_each(|line| eprintln!("{line}"));
    if !terminal.quiet && !terminal.json {
        let lamps = match presses.lamps() {
            0 => String::new(),
            count => format!(" and {count} images of single lamps"),
        };
        eprintln!("fitting {} presses{lamps}", presses.count());
    }
    let bar = terminal.progress();
    bar.set_style(ProgressStyle::with_template("learning normals, pass {pos} [{elapsed}]")?);
    let options = FitOptions { split, ablation: args.ablation };
    let run = CalibrationRun::fit(presses, &options, terminal.seed, &|| bar.inc(1))?;
    bar.finish_and_clear();
    for warning in run.warnings().iter().filter(|warning| !left_out.contains(warning)) {
        eprintln!("{warning}");
    }
    if let Some(path) = &args.sheet {
        save_sheet(&run.sheet()?, path)?;
    }
    let short = run.shortfall();
    if let (Some(path), None) = (&args.out, &short) {
        run.write(path)?;
    }
    let wall_s = started.elapsed().as_secs_f64();
    terminal.print(&CalibrateOutput { figures: run.figures(), wall_s }, &format!("{}{wall_s:.0} s\n", run.table()))?;
    Ok(short)
}

fn save_sheet(sheet: &RgbImage, path: &Path) -> Result<()> {
    sheet.save(path).with_context(|| format!("--sheet {}", path.display()))
}

fn pixel_source(args: &CalibrateArgs) -> Result<PixelSource> {
    Ok(match (args.pixel_mm, args.field_mm, &args.ruler) {
        (Some(mm), ..) => PixelSource::Known(1e-3 * mm),
        (_, Some(mm), _) => PixelSource::Field(1e-3 * mm),
        (_, _, Some(ruler)) => match *ruler.as_slice() {
            [a, b, c, d, mm] => PixelSource::Ruler { ends: [[a, b], [c, d]], length: 1e-3 * mm },
            _ => bail!("--ruler: found {} numbers, expected 5: column,row,column,row (pixels), mm", ruler.len()),
        },
        _ if args.pixel_from_presses => PixelSource::Presses,
        _ => bail!(
            "found nothing that gives the size of a pixel; expected --pixel-mm, --field-mm or --ruler, or --pixel-from-presses, \
             which determines it only within a factor of two or three"
        ),
    })
}

/// Checks that the calibration can be written, and not into the folder of presses, where its background image would
/// become one of them.
fn check_out(path: &Path, presses: &Path) -> Result<()> {
    let name = || format!("--out {}", path.display());
    if path.extension().is_none_or(|ending| ending != "toml") {
        bail!("{}: expected a name that ends in .toml", name());
    }
    if path.is_dir() {
        bail!("{}: found a folder; expected a file", name());
    }
    let inside = folder_of(path).canonicalize().with_context(name)?;
    if is_same_place(&inside, presses) {
        bail!("{}: found the folder of the presses, whose images the background would join; expected another", name());
    }
    tempfile::tempfile_in(&inside).map(drop).with_context(|| format!("{}: cannot be written", name()))
}
