//! `ftac touch train-network`: trains the network for photometric stereo on rendered (or real) presses.

use std::path::Path;

use anyhow::{Result, bail};
use ftac::lab::arguments::touch::{NetworkKindArg, TrainNetworkArgs};
use ftac::terminal::{Outcome, Terminal};
use ftac_platform::data::write_atomically;
use hand_model::RobotModel;
use indicatif::ProgressStyle;
use lab::touch::network_training::{Training, TrainingSchedule};
use lab::touch::training::{TrainingSet, TrainingSource, loss_curves, resume};
use schemars::JsonSchema;
use serde::Serialize;
use tactile_perception::network::NetworkKind;

/// Output once the network is written.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TrainingOutput<'a> {
    /// Number of training samples.
    squares: usize,
    /// Number of held-out samples.
    held_out: usize,
    /// Loss after each epoch, on the training samples and on the held-out ones.
    losses: &'a [[f64; 2]],
    /// Path of the written network.
    out: &'a Path,
}

/// Renders or reads the presses, trains, and writes the network.
pub fn train_network(terminal: &Terminal, args: &TrainNetworkArgs) -> Outcome {
    check(args)?;
    let kind = match args.kind {
        NetworkKindArg::EncoderDecoder => NetworkKind::EncoderDecoder,
        NetworkKindArg::PerPixel => NetworkKind::PerPixel,
    };
    let schedule = TrainingSchedule {
        kind,
        epochs: args.epochs,
        batch: args.batch,
        rate: args.rate,
        halving: 5,
        seed: terminal.seed,
    };
    let state = args.out.with_extension("training");
    let mut training = if args.resume { resume(&state, &schedule)? } else { Training::new(schedule.clone()) };
    training.schedule = schedule;
    let robot = args.robot.model()?;
    let source = source(args, &robot);
    let bar = terminal.progress();
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} presses [{elapsed} < {eta}]")?);
    if let TrainingSource::Pads { presses, .. } | TrainingSource::Sensor { presses, .. } = source {
        bar.set_length(presses as u64);
    }
    let TrainingSet { samples, held_out, conditioning } =
        TrainingSet::make(source, args.crops, terminal.seed, || bar.inc(1))?;
    let steps = samples.len().div_ceil(args.batch);
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} steps [{elapsed} < {eta}] {msg}")?);
    bar.reset();
    bar.set_length((args.epochs * steps) as u64);
    bar.set_position((training.losses.len() * steps) as u64);
    while !training.is_finished() {
        training.epoch(&samples, &held_out, || bar.inc(1))?;
        write_atomically(&state, &serde_json::to_vec(&training)?)?;
        if let Some([learned, held]) = training.losses.last() {
            bar.set_message(format!("loss {learned:.4}, held out {held:.4}"));
        }
    }
    bar.finish_and_clear();
    let mut network = training.network(recipe(args, terminal.seed))?;
    network.conditioning = conditioning;
    write_atomically(&args.out, &serde_json::to_vec(&network)?)?;
    let curve = args.out.with_extension("png");
    let mut png = std::io::Cursor::new(Vec::new());
    loss_curves(&training).draw().write_to(&mut png, image::ImageFormat::Png)?;
    write_atomically(&curve, png.get_ref())?;
    let [learned, held] = training.losses.last().copied().unwrap_or([f64::NAN; 2]);
    let text = format!(
        "{}: {} squares, loss {learned:.4}, on {} held out {held:.4}; curves in {}\n",
        args.out.display(),
        samples.len(),
        held_out.len(),
        curve.display()
    );
    let trained =
        TrainingOutput { squares: samples.len(), held_out: held_out.len(), losses: &training.losses, out: &args.out };
    terminal.print(&trained, &text)?;
    Ok(None)
}

fn check(args: &TrainNetworkArgs) -> Result<()> {
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
    Ok(())
}

fn source<'a>(args: &'a TrainNetworkArgs, robot: &'a RobotModel) -> TrainingSource<'a> {
    let presses = args.presses;
    match (&args.folder, args.ball_diameter_mm, args.pixel_mm, &args.sensor) {
        (Some(folder), Some(diameter), Some(pixel), _) => {
            TrainingSource::RealPresses { folder, ball_diameter: 1e-3 * diameter, pixel: 1e-3 * pixel }
        }
        (_, _, _, Some(file)) => TrainingSource::Sensor { file, presses },
        _ => TrainingSource::Pads { robot, presses },
    }
}

/// Returns the command that reproduces the network.
fn recipe(args: &TrainNetworkArgs, seed: u64) -> String {
    let mut text = "ftac touch train-network".to_owned();
    if args.kind == NetworkKindArg::PerPixel {
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
