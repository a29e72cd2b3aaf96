//! `ftac combos`: the object combinations that trials are numbered by.

use std::fmt::Write as _;

use anyhow::bail;
use bench::builtin::{COMBINATIONS, make_scenes};
use clap::Args;
use serde_json::json;

use crate::options::robot::RobotArgs;
use crate::options::scenario::ScenarioArgs;
use crate::terminal::{Made, Outcome, Terminal};

/// Arguments of `combos`.
#[derive(Debug, Args)]
pub struct CombosArgs {
    /// Pairs of a scenario of your own that have not been planned are planned first, as `bench` does.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// How many; default: 60, or all pairs of a scenario that has fewer.
    #[arg(long)]
    pub combos: Option<usize>,
    #[command(flatten)]
    pub robot: RobotArgs,
}

/// Prints them.
pub fn run(terminal: &Terminal, args: &CombosArgs) -> Outcome {
    let (scenario, _) = args.scenario.read()?;
    let pairs = scenario.combinations();
    let count = args.combos.unwrap_or(pairs.min(COMBINATIONS));
    if !(1..=pairs).contains(&count) {
        bail!("--combos: found {count}, expected 1 to {pairs}, the scenario's pairs");
    }
    let bench = make_scenes(&args.robot.model()?, scenario, count, terminal.seed, terminal.quiet || terminal.json)?;
    let width = bench.plans.plans.iter().map(|plan| plan.first.len()).max().unwrap_or(0);
    let mut text = format!("{:>5}  {:width$}  then\n", "COMBO", "first");
    let mut rows = Vec::new();
    for (number, plan) in bench.plans.plans.iter().enumerate() {
        let _ = writeln!(text, "{number:>5}  {:width$}  {}", plan.first, plan.second);
        rows.push(json!({ "combination": number, "first": plan.first, "second": plan.second }));
    }
    terminal.finish(Made { json: json!({ "combinations": rows }), text, shortfall: None })
}
