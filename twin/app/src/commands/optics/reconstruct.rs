//! `ftac optics reconstruct`: reconstructs normals, heights and contact from images of a calibrated real sensor.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use ftac_platform::file::write_atomically;
use schemars::JsonSchema;
use sensor_calibration::reconstruction::folder::{self, FolderWatcher, Inputs};
use sensor_calibration::reconstruction::output::{self, ImageFigures};
use sensor_calibration::reconstruction::photometry::untouched_photo;
use sensor_calibration::reconstruction::{Accuracy, Photometry, Reconstructor, SlopeMethod};
use sensor_calibration::video;
use serde::Serialize;
use tactile_optics::calibration::image_files::IMAGE_FORMATS;
use tactile_optics::calibration::{CalibratedSensor, Photo, press_checks};

use crate::terminal::{Outcome, Terminal};

/// Method that estimates the slopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodArg {
    /// Regression from the colour change at a pixel to the slope.
    LookUp,
    /// Neural network with the same inputs.
    Network,
}

/// Arguments of `optics reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// Folder of images (PNG, JPEG, BMP) and videos of the sensor, or one such file. A `background.png` in it is the
    /// image of the untouched gel.
    pub folder: PathBuf,
    /// Sensor file of `optics calibrate --out`.
    #[arg(long)]
    pub sensor: PathBuf,
    /// Folder for the results of each image: height in contact (NPY and EXR in m; 16-bit PNG, 0.1 um per level),
    /// normals with their expected error, contact mask, validity mask (255 where the surface is known, 128 beyond the
    /// range of the calibration's presses), points in contact (PLY, m). It is created if missing. Default: only the
    /// figures are printed.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Method that estimates the slopes; default: the better one on the calibration's held-out presses.
    #[arg(long, value_enum)]
    pub method: Option<MethodArg>,
    /// Image of the untouched gel; default: FOLDER/background.png, else that of the calibration.
    #[arg(long)]
    pub background: Option<PathBuf>,
    /// Watch the folder and reconstruct images as they arrive, until interrupted.
    #[arg(long)]
    pub watch: bool,
}

/// JSON output of `optics reconstruct`, also written beside the images. For a watched folder each image is printed on
/// its own.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ReconstructOutput<'a> {
    /// Method that estimated the slopes.
    method: SlopeMethod,
    /// Origin of the untouched gel's image.
    background: String,
    /// Errors on presses held out of the calibration.
    accuracy: &'a Accuracy,
    /// Steepest slope in the calibration's presses, degrees.
    steepest_deg: f64,
    /// Indentation of one level of the 16-bit height image, m.
    height_png_level_m: f64,
    images: Vec<ImageFigures>,
}

/// Polling period of a watched folder.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs `ftac optics reconstruct`: all images, and with `--watch` those still to come.
pub fn reconstruct(terminal: &Terminal, args: &ReconstructArgs) -> Outcome {
    let sensor = CalibratedSensor::read(&args.sensor)?;
    let photometry = Photometry::read(&args.sensor, &sensor)?;
    let method = match args.method {
        Some(MethodArg::LookUp) => SlopeMethod::LookUp,
        Some(MethodArg::Network) => SlopeMethod::Network,
        None => photometry.better_method(),
    };
    if args.watch && !args.folder.is_dir() {
        bail!("{}: found no folder; expected one to watch", args.folder.display());
    }
    let Inputs { files, background: beside } = Inputs::find(&args.folder, args.background.as_deref())?;
    if files.is_empty() && !args.watch {
        bail!("{}: found no images; expected {IMAGE_FORMATS}, or a video", args.folder.display());
    }
    folder::check_names(&files)?;
    let (background, origin) = load_background(beside, &sensor)?;
    let fault = photometry.accuracy(method).fault();
    if let Some(fault) = fault {
        bail!("{}: {} is of no use: {fault}", args.sensor.display(), method.name());
    }
    if let Some(out) = &args.out {
        if out.canonicalize().is_ok_and(|out| args.folder.canonicalize().is_ok_and(|folder| folder == out)) {
            bail!("--out {}: found the folder of the images; expected another", out.display());
        }
        std::fs::create_dir_all(out).with_context(|| format!("--out {}", out.display()))?;
    }
    let reader = Reconstructor::new(&sensor, &photometry, &background, method);
    let mut job =
        ReconstructionJob { terminal, args, sensor: &sensor, reader, background, rows: Vec::new(), failed: Vec::new() };
    if !terminal.quiet && !terminal.json {
        let accuracy = photometry.accuracy(method);
        eprintln!(
            "{}; background: {origin}; on {} presses held out of the calibration: normals {:.1} deg, depth within {:.0} % (rms), height {:.3} mm (rms)",
            method.name(),
            accuracy.presses,
            accuracy.normals_deg.mean,
            100.0 * accuracy.depth_relative,
            1e3 * accuracy.height
        );
        println!(
            "{:24} {:>10} {:>10} {:>12} {:>11} {:>8}",
            "image", "depth mm", "+- mm", "contact mm2", "normals deg", "ms"
        );
    }
    if args.watch {
        let mut arrivals = FolderWatcher::default();
        loop {
            for file in arrivals.new_files(&args.folder, args.background.as_deref())? {
                job.process_file(&file);
                job.rows.drain(..).try_for_each(|row| terminal.print(&row, ""))?;
                // A watched folder may hold anything; the next image may be good.
                job.failed.drain(..).for_each(|error| eprintln!("{error}"));
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
    files.iter().for_each(|file| job.process_file(file));
    let ReconstructionJob { rows, failed, .. } = job;
    let result = ReconstructOutput {
        method,
        background: origin,
        accuracy: photometry.accuracy(method),
        steepest_deg: photometry.range().steepest_deg().into(),
        height_png_level_m: output::HEIGHT_PER_LEVEL.into(),
        images: rows,
    };
    if result.images.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    if let Some(out) = &args.out {
        let path = out.join("reconstruction.json");
        write_atomically(&path, serde_json::to_string_pretty(&result)?.as_bytes())
            .with_context(|| format!("--out {}", path.display()))?;
    }
    terminal.print(&result, "")?;
    let all = result.images.len() + failed.len();
    Ok((!failed.is_empty()).then(|| format!("{} of {all} images left out:\n{}", failed.len(), failed.join("\n"))))
}

/// Returns the image of the untouched gel, and its origin in words.
fn load_background(found: Option<PathBuf>, sensor: &CalibratedSensor) -> Result<(Photo, String)> {
    let Some(path) = found else { return Ok((untouched_photo(sensor), "the calibration's".to_owned())) };
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
    if photo.is_grey() && !untouched_photo(sensor).is_grey() {
        bail!("{}: found a grey image; expected colours, as in the calibration", path.display());
    }
    if let Some(lens) = &sensor.calibration().lens {
        photo = lens.rectify(&photo);
    }
    if let Some(reason) = press_checks::background_mismatch(&photo, &untouched_photo(sensor)) {
        bail!("{}: {reason} of the calibration", path.display());
    }
    Ok((photo, path.display().to_string()))
}

struct ReconstructionJob<'a> {
    terminal: &'a Terminal,
    args: &'a ReconstructArgs,
    sensor: &'a CalibratedSensor,
    reader: Reconstructor,
    background: Photo,
    /// Figures of the images, and errors of those that are left out.
    rows: Vec<ImageFigures>,
    failed: Vec<String>,
}

impl ReconstructionJob<'_> {
    /// Reconstructs an image file, or the frames of a video.
    fn process_file(&mut self, file: &Path) {
        let name = folder::image_name(file);
        let done = if video::is_video(file) {
            video::frames(file, &mut |n, photo| {
                let frame = video::frame_name(&name, n);
                let done = self.process_photo(photo, &frame);
                self.failed.extend(done.err().map(|error| format!("{}, frame {n}: {error:#}", file.display())));
                Ok(true)
            })
        } else {
            self.process_image(file, &name).with_context(|| file.display().to_string())
        };
        self.failed.extend(done.err().map(|error| format!("{error:#}")));
    }

    fn process_image(&mut self, file: &Path, name: &str) -> Result<()> {
        let (photo, depth) = Photo::read_deep(file)?;
        if let Some(depth) = depth.filter(|depth| depth.bits < 16 && !self.terminal.quiet) {
            eprintln!("{name}: {depth}");
        }
        self.process_photo(photo, name)
    }

    /// Reconstructs one image, and writes and prints the result.
    fn process_photo(&mut self, mut photo: Photo, name: &str) -> Result<()> {
        let started = Instant::now();
        let (columns, rows) = self.sensor.size();
        if let Some(lens) = self.sensor.calibration().lens.filter(|_| (photo.width, photo.height) == (columns, rows)) {
            photo = lens.rectify(&photo);
        }
        let surface = self.reader.surface(&photo)?;
        if let Some(reason) = press_checks::background_mismatch(&photo, &self.background) {
            bail!("{reason}");
        }
        let wall = 1e3 * started.elapsed().as_secs_f64();
        if let (Some(out), Some(surface)) = (&self.args.out, &surface) {
            output::write(surface, out, name).context("--out")?;
        }
        if !self.terminal.json {
            match &surface {
                Some(found) => println!(
                    "{name:24} {:>10} {:>10} {:>12.2} {:>11.1} {wall:>8.1}",
                    format_millimetres(found.deepest),
                    format_millimetres(found.depth_error),
                    1e6 * found.area(),
                    output::mean_error(found)
                ),
                None => println!("{name:24} {:>10}", "untouched"),
            }
            for note in surface.iter().flat_map(|found| &found.notes) {
                println!("  {note}");
            }
        }
        self.rows.push(ImageFigures::new(name, surface.as_ref(), wall));
        Ok(())
    }
}

/// Formats a length, given in m, in mm, or as `unknown`.
fn format_millimetres(length: Option<f64>) -> String {
    length.map_or_else(|| "unknown".to_owned(), |length| format!("{:.3}", 1e3 * length))
}
