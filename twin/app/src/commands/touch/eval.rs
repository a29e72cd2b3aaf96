//! `ftac touch eval`: how accurate touch is, from images to poses, and how long it takes.

use std::path::PathBuf;

use anyhow::bail;
use bench::builtin::{HAND_UNIT, make_bench};
use bench::networks::Networks;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use lab::touch::evaluation::{TouchEvaluation, json, table, under_changes};
use lab::touch::grasps::{Played, grasps};
use lab::touch::images::{Change, Eyes};
use lab::touch::normals::real;
use lab::touch::pictures;
use lab::touch::poses::feel;
use scenarios::Scenario;

use crate::terminal::{Outcome, Terminal};

/// Arguments of `touch eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Combinations whose first grasps are felt.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Trials of each combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Keep the simulated grasps in this file, and use them again from there.
    #[arg(long)]
    pub grasps: Option<PathBuf>,
    /// Grasps that are felt again under each change of the optics that touch was not trained on; 0 leaves them out.
    #[arg(long, default_value_t = 120)]
    pub changed: usize,
    /// Measure the networks in this folder instead of those that come with the program.
    #[arg(long)]
    pub networks: Option<PathBuf>,
    /// Presses of a 4 mm ball into a real GelSight, as `optics calibrate` reads them, 0.0295 mm a pixel; left out where they
    /// are not at hand.
    #[arg(long)]
    pub real: Option<PathBuf>,
    /// Folder for a recording and a sheet of images of the first grasp of each object.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Where the real presses lie beside a checkout.
const REAL: &str = "../shared/data/real-gelsight/taxim_gelsight";

/// Feels the grasps, measures, prints.
pub fn eval(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    let quiet = terminal.quiet || terminal.json;
    let scenario = Scenario::benchmark();
    if args.combos == 0 || args.trials == 0 || args.combos > scenario.combinations() {
        bail!(
            "--combos and --trials: found {} and {}, expected 1 to {} and at least 1",
            args.combos,
            args.trials,
            scenario.combinations()
        );
    }
    let networks = args.networks.as_deref().map_or_else(Networks::builtin, Networks::read)?;
    let presses = match &args.real {
        Some(folder) => Some(folder.clone()),
        None => Some(PathBuf::from(REAL)).filter(|folder| folder.exists()),
    };
    let real = presses.as_deref().map(|folder| real(folder, &networks)).transpose()?;
    let bench = make_bench(scenario, args.combos, terminal.seed, quiet)?;
    let played = Played { combos: args.combos, trials: args.trials, seed: terminal.seed };
    let grasps = grasps(&bench, played, args.grasps.as_deref(), quiet)?;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(grasps.len() as u64) };
    bar.set_style(ProgressStyle::with_template("{bar:28} {pos}/{len} felt [{elapsed} < {eta}]")?);
    let eyes = Eyes::new(&bench.world.cell.hand, HAND_UNIT, &Change::NONE)?
        .drifting(bench.world.scenario.effects.pads, terminal.seed);
    let felt = feel(&bench, &eyes, &bench.pipeline, &grasps, || bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        let objects = pictures::write(&bench, &eyes, &grasps, folder)?;
        if !quiet {
            eprintln!("{}: recordings and sheets of {objects} objects; see one with `ftac view`", folder.display());
        }
    }
    let changed = under_changes(&bench, &networks, &grasps, args.changed)?;
    let found = TouchEvaluation { felt, changed, real };
    if terminal.json {
        println!("{}", json::to_json(&found, terminal.seed)?);
    } else {
        print!("{}", table::to_text(&found));
    }
    Ok(found.shortfall())
}
