//! `ftac touch eval`: measures accuracy and latency of touch, from images to poses.

use std::path::Path;

use anyhow::{Result, bail};
use bench::builtin::{HAND_UNIT, make_bench, replace_calibration};
use ftac::lab::arguments::touch::EvalArgs;
use ftac::options::robot::{instance_model, pad_calibration_text};
use ftac::terminal::{Outcome, Terminal};
use lab::touch::evaluation::{TouchEvaluation, table, under_changes};
use lab::touch::grasps::{SimulatedGrasps, grasps};
use lab::touch::images::{CameraUnit, OpticsChange};
use lab::touch::networks::Networks;
use lab::touch::normals::{RealSource, evaluate_real_presses};
use lab::touch::pictures;
use lab::touch::poses::evaluate_poses;
use scenarios::Scenario;

/// Origin of the presses of a real GelSight known to the program's networks.
const KNOWN_REAL_PRESSES: &str = "the Python package taxim 1.4.1 (https://pypi.org/project/taxim)";

/// Perceives the grasps, evaluates and prints.
pub fn eval(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    let quiet = terminal.quiet || terminal.json;
    let scenario = Scenario::benchmark();
    if args.combos == 0 || args.trials == 0 || args.combos > scenario.combination_count() {
        bail!(
            "--combos and --trials: found {} and {}, expected 1 to {} and at least 1",
            args.combos,
            args.trials,
            scenario.combination_count()
        );
    }
    let own = instance_model(args.instance.as_deref(), &args.robot.model()?)?;
    let networks = args.networks.as_deref().map_or_else(Networks::builtin, Networks::read)?;
    let source = real_source(args)?;
    let real = source.map(|source| evaluate_real_presses(&source, &networks).map(|rows| (source, rows))).transpose()?;
    let pads = pad_calibration_text(args.pads.as_deref(), &own)?;
    let mut bench = make_bench(&own, scenario, args.combos, terminal.seed, quiet)?;
    replace_calibration(&mut bench, pads.as_deref(), Path::new("--pads"))?;
    let selection = SimulatedGrasps { combos: args.combos, trials: args.trials, seed: terminal.seed };
    let grasps = grasps(&bench, selection, args.grasps.as_deref(), quiet)?;
    let bar = progress::bar(grasps.len() as u64, "felt", quiet);
    let detector = CameraUnit::new(&bench.world.cell.robot.hand, HAND_UNIT, &OpticsChange::NONE)?
        .with_drift(bench.world.scenario.effects.pads, terminal.seed);
    let felt = evaluate_poses(&bench, &detector, &bench.pipeline, &grasps, || bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(folder) = &args.out {
        let objects = pictures::write(&bench, &detector, &grasps, folder)?;
        if !quiet {
            eprintln!("{}: recordings and sheets of {objects} objects; see one with `ftac view`", folder.display());
        }
    }
    let changed = under_changes(&bench, &networks, &grasps, args.changed)?;
    let found = TouchEvaluation { felt, changed, real };
    terminal.print(&found.figures(terminal.seed), &table::to_text(&found))?;
    Ok(found.shortfall())
}

/// Returns the named real presses. Says that a real sensor is left out if none are named.
fn real_source(args: &EvalArgs) -> Result<Option<RealSource>> {
    let (Some(folder), Some(ball_diameter_mm), Some(pixel_mm)) = (&args.real, args.ball_diameter_mm, args.pixel_mm)
    else {
        eprintln!(
            "left out: a real GelSight; --real FOLDER --ball-diameter-mm D --pixel-mm P names presses of one, such as those in {KNOWN_REAL_PRESSES}"
        );
        return Ok(None);
    };
    if !(pixel_mm > 0.0 && pixel_mm.is_finite()) {
        bail!("--pixel-mm: found {pixel_mm}, expected a positive number");
    }
    Ok(Some(RealSource { folder: folder.clone(), ball_diameter_mm, pixel_mm }))
}
