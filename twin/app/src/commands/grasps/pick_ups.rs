//! `ftac grasps rehearse` and `ftac grasps plan`: what the program's own repertoire and plans were made with.

use clap::ValueEnum;
use std::path::Path;

use grasping::Role;
use scenarios::Scenario;

use crate::terminal::Outcome;
use crate::terminal::Terminal;
use proving::pick_ups::{self, Effort};
use proving::plan;
use proving::world::World;

/// A grasp's role on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RoleArg {
    /// Ring and little finger against the palm.
    First,
    /// Thumb, index and middle finger.
    Second,
}

/// Rehearses grasps of objects and keeps those that hold in the file `out`, beside what it has.
pub fn grasps_rehearse(terminal: &Terminal, objects: &[String], role: Option<RoleArg>, n: u32, out: &Path) -> Outcome {
    let roles = match role {
        Some(RoleArg::First) => vec![Role::First],
        Some(RoleArg::Second) => vec![Role::Second],
        None => vec![Role::First, Role::Second],
    };
    let world = World::new(Scenario::benchmark())?;
    let names = if objects.is_empty() { world.scenario.objects() } else { objects.to_vec() };
    for name in &names {
        world.object(name)?;
    }
    let mut repertoire = if out.exists() { grasping::Repertoire::read(out)? } else { grasping::Repertoire::default() };
    repertoire.command = format!("ftac grasps rehearse --n {n} --seed {}", terminal.seed);
    repertoire.seed = terminal.seed;
    let effort = Effort { proposals: n, variations: n / 2, keep_first: 4, keep_second: 14 };
    pick_ups::generate(
        &world,
        &world.rehearsal_protocol(),
        &names,
        &roles,
        effort,
        &mut repertoire,
        terminal.quiet || terminal.json,
    )?;
    repertoire.write(out)?;
    for name in &names {
        let count = |role| repertoire.of(name, role).count();
        eprintln!("{name:16} {:3} first grasps, {:3} second grasps", count(Role::First), count(Role::Second));
    }
    Ok(None)
}

/// Chooses grasps for each combination and proves them in an ideal run.
pub fn grasps_plan(terminal: &Terminal, combos: usize, file: Option<&Path>, out: &Path) -> Outcome {
    let world = World::new(Scenario::benchmark())?;
    let repertoire = match file {
        Some(file) => grasping::Repertoire::read(file)?,
        None => proving::builtin::repertoire()?,
    };
    let plans = plan::make_plans(&world, &repertoire, combos, terminal.seed, terminal.quiet || terminal.json)?;
    plans.write(out)?;
    eprintln!(
        "{} combinations; {} pairs could not be done without noise and were replaced",
        plans.plans.len(),
        plans.rejected.len()
    );
    Ok(None)
}
