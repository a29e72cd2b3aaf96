//! `ftac touch eval`: how accurate touch is, from images to poses, and how long it takes.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use bench::builtin::{HAND_UNIT, make_bench, read_pads_by};
use clap::Args;
use lab::touch::evaluation::{TouchEvaluation, json, table, under_changes};
use lab::touch::grasps::{Played, grasps};
use lab::touch::images::{Change, Eyes};
use lab::touch::networks::Networks;
use lab::touch::normals::{RealSource, real};
use lab::touch::pictures;
use lab::touch::poses::feel;
use scenarios::Scenario;

use crate::options::robot::{RobotArgs, individual_of, pads};
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
    /// Presses of a ball into a real GelSight, as `optics calibrate` reads them; default: those of the Python package taxim, if they lie at
    /// ../shared/data/real-gelsight/taxim_gelsight. The networks that come with the program learned from that sensor; `optics calibrate` measures
    /// those that it trains for another.
    #[arg(long, requires = "ball_diameter_mm", requires = "pixel_mm")]
    pub real: Option<PathBuf>,
    /// Diameter of that ball, mm (where the labels do not say it).
    #[arg(long, requires = "real")]
    pub ball_diameter_mm: Option<f64>,
    /// Size of a pixel of those images on the gel, mm.
    #[arg(long, requires = "real")]
    pub pixel_mm: Option<f64>,
    /// Robot of `ftac twin identify`: hand, cables, servos and arm are its, for the body as for perception; its pads' calibration is the
    /// designed one. Grasps kept by --grasps are those of another robot.
    #[arg(long, conflicts_with = "grasps")]
    pub individual: Option<PathBuf>,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Calibration of the pads by which grasps are felt: a file of `ftac touch train`, or of the hand's own pads; default: the designed
    /// pads'.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Folder for a recording and a sheet of images of the first grasp of each object.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Where the presses of the GelSight that the program's networks know lie beside a checkout, their ball and pixel size (mm).
const REAL: (&str, f64, f64) = ("../shared/data/real-gelsight/taxim_gelsight", 4.0, 0.0295);
/// Where they come from.
const REAL_SOURCE: &str = "the Python package taxim 1.4.1 (https://pypi.org/project/taxim)";

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
    let own = individual_of(args.individual.as_deref(), &args.robot.model()?)?;
    let networks = args.networks.as_deref().map_or_else(Networks::builtin, Networks::read)?;
    let source = real_source(args)?;
    let real = source.map(|source| real(&source, &networks).map(|rows| (source, rows))).transpose()?;
    let pads = pads(args.pads.as_deref(), &own)?;
    let mut bench = make_bench(&own, scenario, args.combos, terminal.seed, quiet)?;
    read_pads_by(&mut bench, pads.as_deref(), Path::new("--pads"))?;
    let played = Played { combos: args.combos, trials: args.trials, seed: terminal.seed };
    let grasps = grasps(&bench, played, args.grasps.as_deref(), quiet)?;
    let bar = progress::bar(grasps.len() as u64, "felt", quiet);
    let eyes = Eyes::new(&bench.world.cell.robot.hand, HAND_UNIT, &Change::NONE)?
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

/// The real presses that were named, else the known ones if they are at hand.
fn real_source(args: &EvalArgs) -> Result<Option<RealSource>> {
    let (Some(folder), Some(ball_diameter_mm), Some(pixel_mm)) = (&args.real, args.ball_diameter_mm, args.pixel_mm)
    else {
        let (folder, ball_diameter_mm, pixel_mm) = REAL;
        let known = RealSource { folder: folder.into(), ball_diameter_mm, pixel_mm };
        if known.folder.is_dir() {
            return Ok(Some(known));
        }
        eprintln!(
            "left out: a real GelSight, whose presses are not at {folder}; they come from {REAL_SOURCE}, and --real FOLDER names them or those \
             of another sensor"
        );
        return Ok(None);
    };
    if !(pixel_mm > 0.0 && pixel_mm.is_finite()) {
        bail!("--pixel-mm: found {pixel_mm}, expected a positive number");
    }
    Ok(Some(RealSource { folder: folder.clone(), ball_diameter_mm, pixel_mm }))
}
