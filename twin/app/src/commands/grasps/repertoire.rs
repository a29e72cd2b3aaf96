//! `ftac grasps repertoire` and `ftac grasps pairs`: make the benchmark's repertoire and its table of grasp pairs.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use anyhow::bail;
use clap::{Args, ValueEnum};
use dexterous_grasping::{Repertoire, digit_sets};
use grasp_verification::cache::SearchSteps;
use grasp_verification::grasp_pair::{self, GraspPairTable, other_order, outcomes, variations, verification};
use grasp_verification::preparation::SEARCH_EFFORT;
use grasp_verification::repertoire_search::{self, RepertoireEffort, RepertoireRequest, SearchProgress};
use grasp_verification::simulated_world::SimulatedWorld;
use scenarios::Scenario;
use schemars::JsonSchema;
use serde::Serialize;
use sim::tactile::TactileBoard;
use world::phase::ordinal;

use crate::options::object_name::object_name;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `grasps repertoire`.
#[derive(Debug, Args)]
pub struct RepertoireArgs {
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Object (repeatable); default: all of the scenario.
    #[arg(long, value_parser = object_name)]
    pub object: Vec<String>,
    /// Search only grasps for this role in a trial; those for the other role are kept.
    #[arg(long, value_enum)]
    pub role: Option<RoleArg>,
    /// Maximum number of random proposals for each object and role.
    #[arg(long, default_value_t = 128)]
    pub n: u32,
    /// Repertoire file to write (an existing one is extended).
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `grasps pairs`.
#[derive(Debug, Args)]
pub struct PairsArgs {
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Number of combinations.
    #[arg(long, default_value_t = 60)]
    pub combos: usize,
    /// Repertoire file; default: the built-in one.
    #[arg(long)]
    pub repertoire: Option<PathBuf>,
    /// Grasp pair file whose combinations and grasps are kept; only their success rates under errors are computed
    /// again.
    #[arg(long, conflicts_with = "combos")]
    pub pairs: Option<PathBuf>,
    /// Keep the success rates of that file, too; search new grasps only for combinations in which no known one
    /// succeeds.
    #[arg(long, requires = "pairs")]
    pub vary: bool,
    /// Keep that file; search the reverse order of objects only for combinations without a reliable sequence of grasps.
    #[arg(long, requires = "pairs", conflicts_with = "vary")]
    pub reverse: bool,
    /// Keep that file; search second grasps and verify them under random errors, for combinations that are not verified
    /// yet, or are uncertain after a search of less effort.
    #[arg(long, requires = "pairs", conflicts_with_all = ["vary", "reverse"])]
    pub verify: bool,
    /// Effort of that search: at 1 it takes 3 to 12 core minutes per combination; each level above adds as many
    /// proposals again.
    #[arg(long, requires = "verify", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=9))]
    pub effort: u32,
    /// Grasp pair file to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// Number of grasps of an object for a role in a trial.
#[derive(Debug, Serialize, JsonSchema)]
struct RoleGrasps<'a> {
    /// Name of the object.
    object: &'a str,
    /// Role in the trial: first or second.
    role: Cow<'static, str>,
    grasps: usize,
}

/// JSON output of `grasps repertoire`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RepertoireOutput<'a> {
    /// File of the repertoire.
    repertoire: &'a Path,
    /// One entry per object and role.
    objects: Vec<RoleGrasps<'a>>,
}

/// JSON output of `grasps pairs`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PairsOutput<'a> {
    /// File of the grasp pair table.
    pairs: &'a Path,
    /// Number of combinations.
    combinations: usize,
    /// Number of pairs that failed without noise and were replaced.
    rejected: usize,
}

/// Role in a trial of the object that a grasp takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RoleArg {
    /// Ring and little finger against the palm.
    First,
    /// Thumb, index and middle finger.
    Second,
}

/// Tests grasps of objects in rollouts and adds those that hold to the repertoire file.
pub fn make_repertoire(terminal: &Terminal, args: &RepertoireArgs) -> Outcome {
    let places = args.role.map_or(vec![0, 1], |role| vec![role as usize]);
    let (n, out) = (args.n, &args.out);
    let robot = args.robot.model()?;
    let world = SimulatedWorld::new(&robot, Scenario::benchmark())?;
    let names = if args.object.is_empty() { world.scenario.object_names() } else { args.object.clone() };
    for name in &names {
        world.object(name)?;
    }
    let mut repertoire = if out.exists() { Repertoire::read_for(&robot, out)? } else { Repertoire::default() };
    repertoire.robot = Repertoire::robot_identity(&robot);
    repertoire.command = format!("ftac grasps repertoire --n {n} --seed {}", terminal.seed);
    repertoire.seed = terminal.seed;
    let effort = RepertoireEffort { proposals: n, variations: n / 2, ..SEARCH_EFFORT };
    let wanted = RepertoireRequest { names: &names, places: &places, effort };
    let bar = terminal.progress();
    let progress = SearchProgress { bar: &bar, steps: &SearchSteps::in_memory(), report_pace: &|_| {} };
    let (mut done, all) = (0, names.len() * places.len());
    let begun = Instant::now();
    // The file grows object by object: an interruption loses only the present object, and the others can be requested
    // by name.
    repertoire_search::fill_repertoire(
        &world,
        &wanted,
        &mut repertoire,
        &progress,
        |name, place, digits, repertoire| {
            repertoire.write(out)?;
            done += 1;
            if !terminal.quiet {
                let count = repertoire.for_digits(name, digits).count();
                let minutes = begun.elapsed().as_secs_f64() / 60.0;
                let role = ordinal(place);
                bar.suspend(|| {
                    eprintln!("{done:3} of {all}  {name:22} {count:3} {role:6} grasps  {minutes:5.1} min");
                });
            }
            Ok(())
        },
    )?;
    bar.finish_and_clear();
    let sets = digit_sets(&robot.hand, 2);
    let counts = names.iter().flat_map(|name| places.iter().map(move |place| (name, *place))).map(|(name, place)| {
        RoleGrasps { object: name, role: ordinal(place), grasps: repertoire.for_digits(name, &sets[place]).count() }
    });
    terminal
        .print(&RepertoireOutput { repertoire: out, objects: counts.collect() }, &format!("{}\n", out.display()))?;
    Ok(None)
}

/// Chooses grasps for each combination and verifies them in an ideal run.
pub fn make_pairs(terminal: &Terminal, args: &PairsArgs) -> Outcome {
    anyhow::ensure!(args.combos > 0, "--combos: found 0, expected at least 1");
    let robot = args.robot.model()?;
    let world = SimulatedWorld::new(&robot, Scenario::benchmark())?;
    let repertoire = match &args.repertoire {
        Some(file) => Repertoire::read_for(&robot, file)?,
        None if !grasp_verification::builtin::fits_robot(&robot)? => {
            bail!(
                "--repertoire: found none, expected grasps of {} (ftac grasps repertoire --robot-model FILE)",
                robot.name
            )
        }
        None => grasp_verification::builtin::repertoire()?,
    };
    let quiet = terminal.quiet || terminal.json;
    let mut plans = match &args.pairs {
        Some(file) => GraspPairTable::read(file)?,
        None => {
            let board = TactileBoard::unit(&world.cell.robot.hand, 0);
            let plans = grasp_pair::make_pairs(&world.scenario, args.combos, terminal.seed, quiet, |pair| {
                grasp_pair::plan_combination(&world, &repertoire, &board, pair)
            })?;
            anyhow::ensure!(
                plans.pairs.len() == args.combos,
                "--combos: found {}, expected at most {}: no more of the scenario's pairs succeed without noise",
                args.combos,
                plans.pairs.len()
            );
            // The success rates take longer than the grasp pairs, which are kept for --pairs after an interruption.
            plans.write(&args.out)?;
            eprintln!(
                "{} combinations; {} pairs failed without noise and were replaced",
                plans.pairs.len(),
                plans.rejected.len()
            );
            plans
        }
    };
    if args.verify {
        // The file is written after each combination: an interruption loses only those in progress, and `--pairs` with
        // this file resumes.
        let written = Mutex::new(plans.clone());
        verification::verify_pairs(
            &world,
            &repertoire,
            &mut plans,
            verification::VerificationEffort::of_level(args.effort),
            quiet,
            |verified| {
                let mut written = written.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(pair) = written.pairs.iter_mut().find(|pair| pair.objects() == verified.objects()) {
                    *pair = verified.clone();
                }
                written.write(&args.out)
            },
        )?;
        return write_pairs(terminal, args, &plans);
    }
    if args.reverse {
        other_order::plan_reversed(&world, &repertoire, &mut plans, quiet)?;
        return write_pairs(terminal, args, &plans);
    }
    if !args.vary {
        outcomes::roll_out_pairs(&world, &repertoire, &mut plans, quiet)?;
        plans.write(&args.out)?;
        outcomes::roll_out_alternatives(&world, &repertoire, &mut plans, quiet)?;
        plans.write(&args.out)?;
    }
    variations::search_variations(&world, &repertoire, &mut plans, quiet)?;
    plans.write(&args.out)?;
    other_order::plan_reversed(&world, &repertoire, &mut plans, quiet)?;
    write_pairs(terminal, args, &plans)
}

/// Writes `plans` and prints the result.
fn write_pairs(terminal: &Terminal, args: &PairsArgs, plans: &GraspPairTable) -> Outcome {
    plans.write(&args.out)?;
    let made = PairsOutput { pairs: &args.out, combinations: plans.pairs.len(), rejected: plans.rejected.len() };
    terminal.print(&made, &format!("{}\n", args.out.display()))?;
    Ok(None)
}
