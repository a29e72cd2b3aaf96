//! `ftac demonstrations`: a LeRobot data set of clean trials, and the call of the Python package that writes data sets.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::Stdio;

use anyhow::{Context as _, Result, bail};
use clap::Args;
use python_process::interpreter;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::terminal::{Outcome, Terminal};

/// Video quality of a data set: lossless, or a constant rate factor of H.264.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VideoQuality {
    Lossless,
    ConstantRateFactor(u8),
}

impl std::str::FromStr for VideoQuality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = text.parse().ok().filter(|number| (1..=40).contains(number));
        match number {
            _ if text == "lossless" => Ok(Self::Lossless),
            Some(number) => Ok(Self::ConstantRateFactor(number)),
            None => Err(format!("found `{text}`, expected lossless or a whole number from 1 to 40")),
        }
    }
}

impl VideoQuality {
    /// Returns the value as the Python package takes it.
    pub fn to_json(self) -> Value {
        match self {
            Self::Lossless => json!("lossless"),
            Self::ConstantRateFactor(number) => json!(number),
        }
    }
}

/// Arguments of `demonstrations`.
#[derive(Debug, Args)]
pub struct DemonstrationsArgs {
    /// Number of episodes.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    episodes: u32,
    /// Folder for the data set, which must not exist. An interrupted run leaves its finished files in OUT.partial; the
    /// same command continues after them.
    #[arg(long)]
    out: PathBuf,
    /// Random seed of the trials.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of combinations of which trials are run in turn.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=60))]
    combos: u16,
    /// Width and height of the images, pixels; an even number.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u16).range(16..=240))]
    images: u16,
    /// Video of the images: lossless, or a constant rate factor of H.264 from 1 (large) to 40 (small).
    #[arg(long, default_value = "lossless")]
    video: VideoQuality,
    /// Threads; default: one per core.
    #[arg(long)]
    jobs: Option<u16>,
    /// Complete the data set with the episodes so far once this many minutes have passed.
    #[arg(long)]
    minutes: Option<f64>,
    /// Number of episodes whose actions are repeated blindly, to state in the card how exact they are.
    #[arg(long, default_value_t = 40)]
    replayed: u32,
}

/// JSON output of `demonstrations`, as the Python package reports it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DemonstrationsOutput {
    /// Folder of the data set.
    dataset: String,
    /// Number of episodes.
    episodes: u64,
    /// Number of frames of all episodes.
    frames: u64,
    /// Size of the data set, bytes.
    bytes: u64,
    /// Number of trials that were run.
    trials: u64,
    /// Number of clean trials among them.
    clean: u64,
    /// Time of the trials and of writing them, s.
    seconds: f64,
    /// Number of episodes whose actions were repeated.
    replayed: u64,
    /// Number of those that ended with both objects in the hand.
    replayed_success: u64,
    /// Number of those that were clean as well.
    replayed_clean_success: u64,
}

/// Runs `ftac demonstrations`. The shortfall is a smaller number of episodes than asked for.
pub fn run(terminal: &Terminal, args: &DemonstrationsArgs) -> Outcome {
    let arguments = json!({
        "episodes": args.episodes,
        "out": path_text(&args.out)?,
        "seed": args.seed,
        "images": args.images,
        "combinations": args.combos,
        "video": args.video.to_json(),
        "jobs": args.jobs,
        "minutes": args.minutes,
        "replayed": args.replayed,
        "quiet": terminal.quiet,
    });
    let told: DemonstrationsOutput = call_package("demonstrations", "demonstrations", &arguments)?;
    let text = format!(
        "{} episodes of {} trials, {} frames, {:.0} MB in {}; its card is README.md\n",
        told.episodes,
        told.trials,
        told.frames,
        told.bytes as f64 / 1e6,
        told.dataset
    );
    terminal.print(&told, &text)?;
    let asked = u64::from(args.episodes);
    Ok((told.episodes < asked).then(|| format!("{} episodes, expected {asked}: the time was over", told.episodes)))
}

/// Returns a path as text.
pub fn path_text(path: &std::path::Path) -> Result<&str> {
    path.to_str().with_context(|| format!("{}: found a name that is not UTF-8, expected UTF-8", path.display()))
}

/// Calls a function of the Python package's `ftac.lerobot` with `arguments`, for the command `what`.
pub fn call_package<T: DeserializeOwned>(what: &str, function: &str, arguments: &Value) -> Result<T> {
    let mut command = interpreter::module_command("ftac.lerobot");
    command.arg(function).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::inherit());
    let mut child = command.spawn().with_context(|| interpreter::missing_interpreter(what))?;
    if let Some(mut input) = child.stdin.take() {
        // A child that ends early has told the reason.
        drop(input.write_all(arguments.to_string().as_bytes()));
    }
    let output = child.wait_with_output().with_context(|| what.to_owned())?;
    if !output.status.success() {
        bail!("{what}: the data set was not written ({}); {}", output.status, interpreter::INTERPRETER_REQUIREMENTS);
    }
    serde_json::from_slice(&output.stdout).with_context(|| format!("{what}: its answer"))
}
