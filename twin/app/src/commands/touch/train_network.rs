//! `ftac touch train-network`: the network of photometric stereo learns from rendered (or real) presses.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use hand_model::Hand;
use indicatif::{ProgressBar, ProgressStyle};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use sim::tactile::TactileBoard;
use touch::network::Kind;
use touch::network::samples::{Sample, cut};
use touch::network::train::{Schedule, Training};
use touch::{CalibrationPress, PhotometricModel};

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use bench::builtin::builtin_calibration;
use lab::touch::real::{CONFIGURATION, Likeness, RealPresses};
use lab::touch::shapes::{drawn_press, each, seen};
use report::plot::Plot;
use report::write_whole;

/// The first of the hand units that networks learn from, and how many there are.
const UNITS: (u64, u64) = (100, 6);
/// White noise that is learnt with: 0.01 of the full scale, grey levels.
const NOISE: f64 = 2.55;
/// One press in so many is held out.
const HELD_OUT: usize = 10;

/// What a network looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum KindArg {
    /// Sees each pixel with its surroundings.
    EncoderDecoder,
    /// Sees each pixel alone: the customary baseline.
    PerPixel,
}

/// Arguments of `touch train-network`.
#[derive(Debug, Args)]
pub struct TrainNetworkArgs {
    /// The network file (JSON) to write; the training's state goes beside it after each epoch, its loss curves at the end.
    #[arg(long)]
    pub out: PathBuf,
    /// What the network looks like.
    #[arg(long, value_enum, default_value_t = KindArg::EncoderDecoder)]
    pub kind: KindArg,
    /// Presses to render.
    #[arg(long, default_value_t = 720)]
    pub presses: usize,
    /// Squares of 48 pixels cut from each press.
    #[arg(long, default_value_t = 10)]
    pub crops: usize,
    /// Passes over all squares.
    #[arg(long, default_value_t = 20)]
    pub epochs: usize,
    /// Squares a step.
    #[arg(long, default_value_t = 128)]
    pub batch: usize,
    /// Learning rate at the start; it is halved every five epochs.
    #[arg(long, default_value_t = 0.01)]
    pub rate: f64,
    /// Go on from the state beside --out.
    #[arg(long)]
    pub resume: bool,
    /// Learn for a real sensor that `optics calibrate` described in this file, from renders of it, not for the hand's pads.
    #[arg(long)]
    pub sensor: Option<PathBuf>,
    /// Learn for a real sensor from the even-numbered of these presses of a ball.
    #[arg(long, conflicts_with = "sensor", requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub folder: Option<PathBuf>,
    /// Diameter of that ball, mm.
    #[arg(long)]
    pub ball_diameter_mm: Option<f64>,
    /// Size of a pixel of those presses' images, mm.
    #[arg(long)]
    pub pixel_mm: Option<f64>,
}

/// Runs the command.
pub fn train_network(terminal: &Terminal, args: &TrainNetworkArgs) -> Outcome {
    for (name, found) in
        [("--presses", args.presses), ("--crops", args.crops), ("--epochs", args.epochs), ("--batch", args.batch)]
    {
        if found == 0 {
            bail!("{name}: found 0, expected at least 1");
        }
    }
    if !(args.rate > 0.0 && args.rate.is_finite()) {
        bail!("--rate: found {}, expected a positive number", args.rate);
    }
    let quiet = terminal.quiet || terminal.json;
    let kind = match args.kind {
        KindArg::EncoderDecoder => Kind::EncoderDecoder,
        KindArg::PerPixel => Kind::PerPixel,
    };
    let schedule =
        Schedule { kind, epochs: args.epochs, batch: args.batch, rate: args.rate, halving: 5, seed: terminal.seed };
    let state = args.out.with_extension("training");
    let mut training = if args.resume { resumed(&state, &schedule)? } else { Training::new(schedule.clone()) };
    training.schedule = schedule;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
    let Lesson { samples, held_out, conditioning } = lesson(args, terminal.seed, &bar)?;
    let steps = samples.len().div_ceil(args.batch);
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} steps [{elapsed} < {eta}] {msg}")?);
    bar.reset();
    bar.set_length((args.epochs * steps) as u64);
    bar.set_position((training.losses.len() * steps) as u64);
    while !training.done() {
        training.epoch(&samples, &held_out, || bar.inc(1))?;
        write_whole(&state, &serde_json::to_vec(&training)?)?;
        if let Some([learnt, held]) = training.losses.last() {
            bar.set_message(format!("loss {learnt:.4}, held out {held:.4}"));
        }
    }
    bar.finish_and_clear();
    let mut network = training.network(recipe(args, terminal.seed))?;
    network.conditioning = conditioning;
    write_whole(&args.out, &serde_json::to_vec(&network)?)?;
    let curve = args.out.with_extension("png");
    let mut png = std::io::Cursor::new(Vec::new());
    curves(&training).draw().write_to(&mut png, image::ImageFormat::Png)?;
    write_whole(&curve, png.get_ref())?;
    let [learnt, held] = training.losses.last().copied().unwrap_or([f64::NAN; 2]);
    if terminal.json {
        println!(
            "{}",
            json!({"squares": samples.len(), "held_out": held_out.len(), "losses": training.losses, "out": args.out})
        );
    } else {
        println!(
            "{}: {} squares, loss {learnt:.4}, on {} held out {held:.4}; curves in {}",
            args.out.display(),
            samples.len(),
            held_out.len(),
            curve.display()
        );
    }
    Ok(None)
}

fn resumed(state: &Path, schedule: &Schedule) -> Result<Training> {
    let text = std::fs::read(state).with_context(|| format!("--resume: {}", state.display()))?;
    let training: Training =
        serde_json::from_slice(&text).with_context(|| format!("--resume: {}: not a training", state.display()))?;
    training.check(schedule).with_context(|| format!("--resume: {}", state.display()))?;
    Ok(training)
}

struct Lesson {
    samples: Vec<Sample>,
    held_out: Vec<Sample>,
    conditioning: Option<PhotometricModel>,
}

fn lesson(args: &TrainNetworkArgs, seed: u64, bar: &ProgressBar) -> Result<Lesson> {
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} presses [{elapsed} < {eta}]")?);
    if let (Some(folder), Some(diameter), Some(pixel)) = (&args.folder, args.ball_diameter_mm, args.pixel_mm) {
        let real = RealPresses::read(folder, 1e-3 * diameter, 1e-3 * pixel)?;
        let size = real.pixel;
        let [even, _] = real.even_odd();
        return of_sensor(even, size, args.crops, seed);
    }
    bar.set_length(args.presses as u64);
    let reliefs = seen();
    if let Some(file) = &args.sensor {
        let likeness = Likeness::read(file)?;
        let presses = each(args.presses, |n| {
            bar.inc(1);
            likeness.press(&reliefs, n, NOISE, seed)
        })?;
        return of_sensor(presses, likeness.pixel, args.crops, seed);
    }
    let hand = Hand::ftac();
    let calibration = builtin_calibration()?;
    let boards: Result<Vec<TactileBoard>, _> = (UNITS.0..UNITS.0 + UNITS.1)
        .map(|serial| TactileBoard::changed(&hand, serial, |_, model| model.noise = NOISE))
        .collect();
    let boards = boards?;
    let cuts = each(args.presses, |n| {
        let press = drawn_press(&hand, &boards, &reliefs, n, seed)?;
        let camera = &hand.cameras[press.camera];
        let configuration = hand.pads[camera.pad].configuration;
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6375_7473 ^ (n as u64) << 32);
        bar.inc(1);
        let model = calibration.model(configuration)?;
        Ok(cut(&press, (configuration, model), camera.pixel_size(), args.crops, &mut rng))
    })?;
    Ok(split(cuts, None))
}

/// A sensor of its own: its photometric model is fitted to the same presses.
fn of_sensor(presses: Vec<CalibrationPress>, pixel: (f64, f64), crops: usize, seed: u64) -> Result<Lesson> {
    let labelled: Vec<(&CalibrationPress, (f64, f64))> = presses.iter().map(|press| (press, pixel)).collect();
    let model = PhotometricModel::fit(CONFIGURATION, &labelled)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x6375_7473);
    let cuts = presses.iter().map(|press| cut(press, (CONFIGURATION, &model), pixel, crops, &mut rng)).collect();
    Ok(split(cuts, Some(model)))
}

fn split(cuts: Vec<Vec<Sample>>, conditioning: Option<PhotometricModel>) -> Lesson {
    let (mut samples, mut held_out) = (Vec::new(), Vec::new());
    for (n, cuts) in cuts.into_iter().enumerate() {
        if n % HELD_OUT == HELD_OUT - 1 { held_out.extend(cuts) } else { samples.extend(cuts) }
    }
    Lesson { samples, held_out, conditioning }
}

/// The command that makes the same network again.
fn recipe(args: &TrainNetworkArgs, seed: u64) -> String {
    let mut text = "ftac touch train-network".to_owned();
    if args.kind == KindArg::PerPixel {
        text += " --kind per-pixel";
    }
    let TrainNetworkArgs { presses, crops, epochs, batch, rate, .. } = args;
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    if let (Some(folder), Some(diameter), Some(pixel)) = (&args.folder, args.ball_diameter_mm, args.pixel_mm) {
        text += &format!(" --folder {} --ball-diameter-mm {diameter} --pixel-mm {pixel}", name(folder));
    } else {
        text += &format!(" --presses {presses}");
    }
    if let Some(sensor) = &args.sensor {
        text += &format!(" --sensor {}", name(sensor));
    }
    format!("{text} --crops {crops} --epochs {epochs} --batch {batch} --rate {rate} --seed {seed}")
}

fn curves(training: &Training) -> Plot {
    let line = |k: usize| training.losses.iter().enumerate().map(|(n, loss)| [1.0 + n as f64, loss[k]]).collect();
    Plot {
        title: "photometric stereo network".into(),
        x: "epoch".into(),
        y: "mean error of the normal (1 = 57 deg)".into(),
        lines: vec![("learnt from".into(), line(0)), ("held out".into(), line(1))],
    }
}
