//! `ftac combos`: the numbered object combinations of trials.

use std::collections::BTreeMap;

use anyhow::bail;
use bench::builtin::{COMBINATION_COUNT, make_scene_bench};
use clap::Args;
use grasp_verification::grasp_pair::GraspPair;
use schemars::JsonSchema;
use serde::Serialize;

use crate::options::robot::RobotArgs;
use crate::options::scenario::ScenarioArgs;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `combos`.
#[derive(Debug, Args)]
pub struct CombosArgs {
    /// Combinations of another scenario that have no grasp pairs yet are planned first, as by `bench`.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Number of combinations; default: 60, or all of a scenario that has fewer.
    #[arg(long)]
    pub combos: Option<usize>,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// A combination.
#[derive(Debug, Serialize, JsonSchema)]
struct CombinationRow<'a> {
    /// Number of the combination, from 0.
    combination: usize,
    /// Name of each object, by the scenario's list that contains it: first, second.
    #[serde(flatten)]
    objects: BTreeMap<&'a str, &'a str>,
}

/// JSON output of `combos`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CombosOutput<'a> {
    combinations: Vec<CombinationRow<'a>>,
}

/// Runs `ftac combos`.
pub fn run(terminal: &Terminal, args: &CombosArgs) -> Outcome {
    let (scenario, _) = args.scenario.read()?;
    let pairs = scenario.combination_count();
    let count = args.combos.unwrap_or(pairs.min(COMBINATION_COUNT));
    if !(1..=pairs).contains(&count) {
        bail!("--combos: found {count}, expected 1 to {pairs}, the scenario's combinations");
    }
    let bench =
        make_scene_bench(&args.robot.model()?, scenario, count, terminal.seed, terminal.quiet || terminal.json)?;
    let lists: Vec<&str> = bench.world.scenario.object_lists().into_iter().map(|(field, _)| field).collect();
    let width = bench.grasp_pairs.pairs.iter().flat_map(GraspPair::objects).map(str::len).max().unwrap_or(0);
    let row = |number: &str, names: &[&str]| {
        let names: Vec<String> = names.iter().map(|name| format!("{name:width$}")).collect();
        format!("{number:>5}  {}", names.join("  ")).trim_end().to_owned() + "\n"
    };
    let heading = if lists.len() == 2 { vec!["first", "then"] } else { lists.clone() };
    let mut text = row("COMBO", &heading);
    let mut combinations = Vec::new();
    for (combination, plan) in bench.grasp_pairs.pairs.iter().enumerate() {
        text += &row(&combination.to_string(), &plan.objects());
        let objects = lists.iter().copied().zip(plan.objects()).collect();
        combinations.push(CombinationRow { combination, objects });
    }
    terminal.print(&CombosOutput { combinations }, &text)?;
    Ok(None)
}
