//! `ftac combos`: the object combinations that trials are numbered by.

use anyhow::bail;
use bench::builtin::{COMBINATIONS, make_scenes};
use clap::Args;
use proving::plan::Plan;
use serde_json::json;

use crate::options::robot::RobotArgs;
use crate::options::scenario::ScenarioArgs;
use crate::terminal::{Made, Outcome, Terminal};

/// Arguments of `combos`.
#[derive(Debug, Args)]
pub struct CombosArgs {
    /// Combinations of a scenario of your own that have not been planned are planned first, as `bench` does.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// How many; default: 60, or all of a scenario that has fewer.
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
        bail!("--combos: found {count}, expected 1 to {pairs}, the scenario's combinations");
    }
    let bench = make_scenes(&args.robot.model()?, scenario, count, terminal.seed, terminal.quiet || terminal.json)?;
    let lists: Vec<&str> = bench.world.scenario.lists().into_iter().map(|(field, _)| field).collect();
    let width = bench.plans.plans.iter().flat_map(Plan::objects).map(str::len).max().unwrap_or(0);
    let row = |number: &str, names: &[&str]| {
        let names: Vec<String> = names.iter().map(|name| format!("{name:width$}")).collect();
        format!("{number:>5}  {}", names.join("  ")).trim_end().to_owned() + "\n"
    };
    let heading = if lists.len() == 2 { vec!["first", "then"] } else { lists.clone() };
    let mut text = row("COMBO", &heading);
    let mut rows = Vec::new();
    for (number, plan) in bench.plans.plans.iter().enumerate() {
        text += &row(&number.to_string(), &plan.objects());
        let mut one = json!({ "combination": number });
        for (list, name) in lists.iter().zip(plan.objects()) {
            one[*list] = name.into();
        }
        rows.push(one);
    }
    terminal.finish(Made { json: json!({ "combinations": rows }), text, shortfall: None })
}
