//! `ftac optics reconstruct`: normals, heights and contact from images of a calibrated real sensor.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use hand_model::file::write_whole;
use lab::optics::reconstruction::folder::{self, Arrivals};
use lab::optics::reconstruction::output;
use lab::optics::reconstruction::photometry::untouched;
use lab::optics::reconstruction::{Method, Photometry, Reconstructor};
use optics::calibration::{CalibratedSensor, Photo};
use serde_json::{Value, json};

use crate::terminal::{Outcome, Terminal};

/// How slopes are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodArg {
    /// Regression from the colour change at a place to the slope.
    LookUp,
    /// A network of the same inputs.
    Network,
}

/// Arguments of `optics reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// Folder of images of the sensor, or one image. `background.png` in it, if there is one, is the untouched gel.
    pub folder: PathBuf,
    /// The sensor: what `optics calibrate --out` wrote.
    #[arg(long)]
    pub sensor: PathBuf,
    /// Folder for the results of each image: height (NPY and EXR in m; 16-bit PNG, 0.1 um a level), normals with their expected
    /// error, contact mask, points in contact (PLY, m). Made if it is not there. Default: only the figures are printed.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// How slopes are found; default: what did better on the calibration's held-out presses.
    #[arg(long, value_enum)]
    pub method: Option<MethodArg>,
    /// Image of the untouched gel; default: FOLDER/background.png, else the calibration's.
    #[arg(long)]
    pub background: Option<PathBuf>,
    /// Go on with images as they come into the folder, until interrupted.
    #[arg(long)]
    pub watch: bool,
}

/// How often a watched folder is looked at.
const LOOK: Duration = Duration::from_millis(100);

/// Reconstructs all images, and those to come if wanted.
pub fn reconstruct(terminal: &Terminal, args: &ReconstructArgs) -> Outcome {
    let sensor = CalibratedSensor::read(&args.sensor)?;
    let photometry = Photometry::read(&args.sensor, &sensor)?;
    let method = match args.method {
        Some(MethodArg::LookUp) => Method::LookUp,
        Some(MethodArg::Network) => Method::Network,
        None => photometry.better(),
    };
    if args.watch && !args.folder.is_dir() {
        bail!("{}: found no folder; expected one to watch", args.folder.display());
    }
    let files = folder::images(&args.folder)?;
    if files.is_empty() && !args.watch {
        bail!("{}: found no images; expected PNG or JPEG", args.folder.display());
    }
    folder::check_names(&files)?;
    let (background, origin) = background(args, &sensor)?;
    if let Some(out) = &args.out {
        if out.canonicalize().is_ok_and(|out| args.folder.canonicalize().is_ok_and(|folder| folder == out)) {
            bail!("--out {}: found the folder of the images; expected another", out.display());
        }
        std::fs::create_dir_all(out).with_context(|| format!("--out {}", out.display()))?;
    }
    let job =
        Job { terminal, args, sensor: &sensor, reader: Reconstructor::new(&sensor, &photometry, &background, method) };
    if !terminal.quiet && !terminal.json {
        let accuracy = photometry.accuracy(method);
        eprintln!(
            "{}; background: {origin}; on {} balls {}: normals {:.1} deg, depth within {:.0} % (rms), height {:.3} mm (rms)",
            method.name(),
            accuracy.presses,
            if photometry.held_out { "held out" } else { "of half the calibration" },
            accuracy.normals_deg.mean,
            100.0 * accuracy.depth_relative,
            1e3 * accuracy.height
        );
        println!(
            "{:24} {:>10} {:>10} {:>12} {:>11} {:>8}",
            "image", "depth mm", "+- mm", "contact mm2", "normals deg", "ms"
        );
    }
    let mut rows = Vec::new();
    let mut failed = Vec::new();
    if args.watch {
        let mut arrivals = Arrivals::default();
        loop {
            for file in arrivals.next(&args.folder)? {
                match job.image(&file) {
                    Ok(row) if terminal.json => println!("{row}"),
                    Ok(_) => {}
                    // A live folder may hold anything; the next image may be good.
                    Err(error) => eprintln!("{error:#}"),
                }
            }
            std::thread::sleep(LOOK);
        }
    }
    for file in &files {
        match job.image(file) {
            Ok(row) => rows.push(row),
            Err(error) => failed.push(format!("{error:#}")),
        }
    }
    let result = json!({
        "method": method,
        "background": origin,
        "accuracy": photometry.accuracy(method),
        "accuracy_held_out": photometry.held_out,
        "height_png_level_m": output::LEVEL,
        "images": rows,
    });
    if failed.len() == files.len() {
        bail!("{}", failed.join("\n"));
    }
    if let Some(out) = &args.out {
        let path = out.join("reconstruction.json");
        write_whole(&path, serde_json::to_string_pretty(&result)?.as_bytes())
            .with_context(|| format!("--out {}", path.display()))?;
    }
    if terminal.json {
        println!("{result}");
    }
    Ok((!failed.is_empty())
        .then(|| format!("{} of {} images left out:\n{}", failed.len(), files.len(), failed.join("\n"))))
}

/// The untouched gel, and where its image comes from.
fn background(args: &ReconstructArgs, sensor: &CalibratedSensor) -> Result<(Photo, String)> {
    let found = args.background.clone().or_else(|| folder::background(&args.folder));
    let Some(path) = found else { return Ok((untouched(sensor), "the calibration's".to_owned())) };
    let mut photo = Photo::read(&path)?;
    let (columns, rows) = sensor.size();
    if (photo.width, photo.height) != (columns, rows) {
        bail!(
            "{}: found {} x {} pixels; expected {columns} x {rows}, by the calibration",
            path.display(),
            photo.width,
            photo.height
        );
    }
    if photo.is_grey() && !untouched(sensor).is_grey() {
        bail!("{}: found a grey image; expected colours, as in the calibration", path.display());
    }
    if let Some(lens) = &sensor.calibration().lens {
        photo = lens.rectify(&photo);
    }
    Ok((photo, path.display().to_string()))
}

struct Job<'a> {
    terminal: &'a Terminal,
    args: &'a ReconstructArgs,
    sensor: &'a CalibratedSensor,
    reader: Reconstructor,
}

impl Job<'_> {
    /// Reconstructs one image, writes and prints it.
    fn image(&self, file: &Path) -> Result<Value> {
        let mut photo = Photo::read(file)?;
        let started = Instant::now();
        let (columns, rows) = self.sensor.size();
        if let Some(lens) = self.sensor.calibration().lens.filter(|_| (photo.width, photo.height) == (columns, rows)) {
            photo = lens.rectify(&photo);
        }
        let surface = self.reader.surface(&photo).with_context(|| file.display().to_string())?;
        let wall = 1e3 * started.elapsed().as_secs_f64();
        let name = folder::name(file);
        if let (Some(out), Some(surface)) = (&self.args.out, &surface) {
            output::write(surface, out, &name).context("--out")?;
        }
        if !self.terminal.json {
            match &surface {
                Some(found) => println!(
                    "{name:24} {:>10.3} {:>10.3} {:>12.2} {:>11.1} {wall:>8.1}",
                    1e3 * found.deepest[0],
                    1e3 * found.deepest[1],
                    1e6 * found.area(),
                    output::mean_error(found)
                ),
                None => println!("{name:24} {:>10}", "untouched"),
            }
        }
        let mut row = output::summary(&name, surface.as_ref());
        row["wall_ms"] = wall.into();
        Ok(row)
    }
}
