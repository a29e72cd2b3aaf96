//! `ftac hand`: checks of the hand, closing of any hand, export of scenes for a second engine.

mod close;
pub mod inspect;

use std::path::Path;
use std::sync::Arc;

use ftac::lab::arguments::hand::{CheckArgs, HandLabCommand};
use ftac::options::renamed_options;
use ftac::terminal::{Outcome, Terminal};
use hand_model::Hand;
use lab::hand_check as check;
use lab::hand_check::engine::EngineResult;
use lab::hand_check::feix::GraspTypeResult;
use lab::hand_check::feix::seeds::TypeOverSeeds;
use schemars::JsonSchema;
use serde::Serialize;

use super::rows::show_rows;

/// Output of `hand export`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ExportOutput<'a> {
    /// Folder with the files.
    folder: &'a Path,
}

/// Output of `hand check --engine`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct EngineSweepOutput {
    /// One row per setting of the engine.
    sweep: Vec<EngineResult>,
}

/// Output of `hand check --grasps`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct GraspTypesOutput<'a> {
    /// Seed of all random numbers.
    seed: u64,
    /// Number of seeds tried.
    seeds: u64,
    /// Maximum number of attempts per type.
    tries: usize,
    /// Results of each type with the first seed.
    types: &'a [GraspTypeResult],
    /// Results of each type over the seeds.
    over_seeds: &'a [TypeOverSeeds],
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &HandLabCommand) -> Outcome {
    match command {
        HandLabCommand::Check(args) => hand_check(terminal, args),
        HandLabCommand::Close(args) => close::run(terminal, args),
        HandLabCommand::Export { mjcf, friction, robot, refine } => {
            if !(0.0..=2.0).contains(friction) {
                anyhow::bail!("--friction: found {friction}, expected 0 to 2");
            }
            check::second_engine::export(&robot.model()?, mjcf, *friction, *refine)?;
            let text = format!(
                "{0}: scenes.json and its MJCF files; `python3 tests/mujoco/compare.py {0}` runs them\n",
                mjcf.display()
            );
            terminal.print(&ExportOutput { folder: mjcf }, &text)?;
            Ok(None)
        }
    }
}

/// Runs `ftac hand check`, or the variant that its options select.
fn hand_check(terminal: &Terminal, args: &CheckArgs) -> Outcome {
    renamed_options::note_renamed_options();
    if let Some(path) = &args.urdf {
        return inspect::run(terminal, path, args.pulls.as_deref());
    }
    let hand = args.robot.model()?.hand;
    if args.engine {
        let sweep = check::engine::sweep(&hand)?;
        let text = check::engine::table(&sweep);
        terminal.print(&EngineSweepOutput { sweep }, &text)?;
        return Ok(None);
    }
    if args.grasps {
        return hand_grasps(terminal, args, &hand);
    }
    let public_model = public_model(args.public_model.as_deref())?;
    let options =
        check::CheckOptions { public_model, out: args.out.as_deref(), seed: terminal.seed, seeds: args.seeds.into() };
    let rows = check::run(&hand, &options)?;
    show_rows(terminal, &rows, args.out.as_deref())
}

/// Checks that the named folder has the public model. Says that its row is left out if none is named.
fn public_model(named: Option<&Path>) -> anyhow::Result<Option<&Path>> {
    let Some(folder) = named else {
        eprintln!(
            "left out: joint frames beside the public model of this hand; it comes from {}, and --public-model FOLDER names it",
            check::public_model::MODEL_SOURCE
        );
        return Ok(None);
    };
    anyhow::ensure!(
        folder.join(check::public_model::MODEL_FILE).is_file(),
        "--public-model {}: found no {} in it, expected it, from {}",
        folder.display(),
        check::public_model::MODEL_FILE,
        check::public_model::MODEL_SOURCE
    );
    Ok(named)
}

fn hand_grasps(terminal: &Terminal, args: &CheckArgs, hand: &Arc<Hand>) -> Outcome {
    let numbers: Vec<usize> = args.types.iter().map(|number| usize::from(*number)).collect();
    let seeds = (terminal.seed, args.seeds.into());
    let types = if numbers.is_empty() { check::feix::types::all_types().len() } else { numbers.len() };
    let bar = progress::bar(types as u64 * seeds.1, "types", terminal.quiet || terminal.json);
    let done = || bar.inc(1);
    let (over_seeds, results) = check::feix::seeds::over_seeds(hand, seeds, args.tries as usize, &numbers, done);
    bar.finish_and_clear();
    let found = GraspTypesOutput {
        seed: terminal.seed,
        seeds: args.seeds.into(),
        tries: args.tries as usize,
        types: &results,
        over_seeds: &over_seeds,
    };
    if let Some(folder) = &args.out {
        check::feix::draw(hand, &results, folder)?;
        ftac_platform::data::write_atomically(
            &folder.join("grasps.json"),
            serde_json::to_string_pretty(&found)?.as_bytes(),
        )?;
    }
    let mut text = check::feix::table(&results);
    if args.seeds > 1 {
        text += &check::feix::seeds::table(&over_seeds);
    }
    terminal.print(&found, &text)?;
    let held = over_seeds.iter().filter(|kind| kind.held == kind.seeds).count();
    let seeds = if args.seeds > 1 { " with every seed" } else { "" };
    Ok((held < results.len()).then(|| format!("{held} of {} grasp types are held{seeds}", results.len())))
}
