//! `ftac optics calibrate`: a real sensor's model from presses of a ball.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use indicatif::ProgressStyle;
use lab::optics::calibration::scale::PixelSource;
use lab::optics::calibration::{CHECKERBOARDS, CalibrationRun, FitOptions, Split, SplitPresses};

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
    /// Size of a pixel on the gel, mm. One of --pixel-mm, --field-mm, --ruler and --pixel-from-presses is needed.
    #[arg(long, group = "pixel")]
    pub pixel_mm: Option<f64>,
    /// Width of the gel that an image shows, mm, as data sheets give it.
    #[arg(long, group = "pixel")]
    pub field_mm: Option<f64>,
    /// Two points of an image and their distance on the gel: column,row,column,row (pixels), mm.
    #[arg(long, group = "pixel", value_delimiter = ',', num_args = 1)]
    pub ruler: Option<Vec<f64>>,
    /// Take the size of a pixel from the presses alone, which tell it only within a factor of two or three.
    #[arg(long, group = "pixel")]
    pub pixel_from_presses: bool,
    /// All presses are shallow: circles may be small against the ball.
    #[arg(long)]
    pub shallow: bool,
    /// A sheet of all presses (PNG) with their circles and errors; what is left out is red.
    #[arg(long)]
    pub sheet: Option<PathBuf>,
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
    /// The calibration file (TOML) to write; the untouched gel's image and what `optics reconstruct` needs go beside it.
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
    let pixel = pixel_source(args)?;
    if let Some(path) = &args.out {
        check_out(path, &args.folder)?;
    }
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
    let bar = terminal.progress();
    bar.set_style(ProgressStyle::with_template("learning normals, pass {pos} [{elapsed}]")?);
    let options = FitOptions { pixel, shallow: args.shallow, ablation: args.ablation };
    let run = CalibrationRun::fit(presses, &options, terminal.seed, || bar.inc(1))?;
    bar.finish_and_clear();
    for warning in run.warnings() {
        eprintln!("{warning}");
    }
    if let Some(path) = &args.sheet {
        run.sheet()?.save(path).with_context(|| format!("--sheet {}", path.display()))?;
    }
    let short = run.shortfall();
    if let (Some(path), None) = (&args.out, &short) {
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
    Ok(short)
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
            "found nothing that tells the size of a pixel; expected --pixel-mm, --field-mm or --ruler, or --pixel-from-presses, \
             which tells it only within a factor of two or three"
        ),
    })
}

/// An error unless the calibration can be written where it does not become one of the presses.
fn check_out(path: &Path, presses: &Path) -> Result<()> {
    let name = || format!("--out {}", path.display());
    if path.extension().is_none_or(|ending| ending != "toml") {
        bail!("{}: expected a name that ends in .toml", name());
    }
    if path.is_dir() {
        bail!("{}: found a folder; expected a file", name());
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let inside = folder.canonicalize().with_context(name)?;
    if presses.canonicalize().is_ok_and(|presses| inside == presses) {
        bail!("{}: found the folder of the presses, whose images the background would join; expected another", name());
    }
    tempfile::tempfile_in(&inside).map(drop).with_context(|| format!("{}: cannot be written", name()))
}
