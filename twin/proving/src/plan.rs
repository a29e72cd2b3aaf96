//! Plans: for each combination a first grasp and the second grasps that may follow it, rehearsed without noise.
//!
//! The rule: all ordered pairs of the scenario's objects, shuffled by the seed, are rehearsed in order. A pair for which some
//! first grasp can be followed by some second grasp without a collision becomes a combination; a pair for which nothing works
//! is listed as rejected, and the rule's next takes its place. Those that worked are tried again under draws of the noise: the share
//! that still works is a grasp's worth in this combination. The most worthy is the plan, the others are its alternatives.

pub mod without;

use std::path::Path;

use anyhow::{Context, Result, bail};
use control::worth::Candidate;
use grasping::{Grasp, Repertoire, Role};
use indicatif::ProgressBar;
use rayon::prelude::*;
use scenarios::combination::{Combination, draw_combinations};
use scenarios::noise::TrialNoise;
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;

use crate::rehearsal::{Snapshot, Start, misaimed, proving_errors, rehearse_first, rehearse_second};
use crate::world::World;

/// Format version of plan files.
const VERSION: u32 = 1;
/// How much a grasp that failed in this pair's rehearsal is still worth against one that did not.
const FAILED_WORTH: f64 = 0.3;

/// How many of the grasps that worked are tried again under noise, and what the others count against their general score.
const PROVEN: usize = 6;
/// See [`PROVEN`].
const UNPROVEN_WORTH: f64 = 0.6;
/// Draws of the expected noise under which a pair is tried.
const ERRORS: usize = 6;

/// One combination's plan.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plan {
    /// First object.
    pub first: String,
    /// Second object.
    pub second: String,
    /// Number of the first grasp in its repertoire.
    pub first_grasp: u32,
    /// (number of the second grasp, worth in this combination), the plan first.
    pub second_grasps: Vec<(u32, f64)>,
}

/// All plans of a scenario.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plans {
    /// Format version.
    pub version: u32,
    /// Seed of the draw.
    pub seed: u64,
    /// Pairs for which nothing worked without noise, in the order in which they were drawn.
    pub rejected: Vec<(String, String)>,
    /// The combinations.
    pub plans: Vec<Plan>,
}

impl Plans {
    /// Parses a plan file's text.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let plans: Self = serde_json::from_str(text).with_context(|| path.display().to_string())?;
        if plans.version != VERSION {
            bail!("{}: version: found {}, expected {VERSION}", path.display(), plans.version);
        }
        Ok(plans)
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        let lines: Vec<String> = self.plans.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        let rejected = serde_json::to_string(&self.rejected)?;
        let text = format!(
            "{{\"version\":{VERSION},\"seed\":{},\"rejected\":{rejected},\n\"plans\":[\n{}\n]}}\n",
            self.seed,
            lines.join(",\n")
        );
        hand_model::file::write_whole(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    }
}

impl Plan {
    /// The grasps behind the numbers.
    pub fn grasps(&self, repertoire: &Repertoire) -> Result<(Grasp, Vec<Candidate>)> {
        let find = |object: &str, role: Role, id: u32| {
            repertoire
                .of(object, role)
                .find(|grasp| grasp.id == id)
                .cloned()
                .with_context(|| format!("the plan names grasp {id} of {object}, which the repertoire lacks"))
        };
        let first = find(&self.first, Role::First, self.first_grasp)?;
        let candidates = self
            .second_grasps
            .iter()
            .map(|(id, worth)| Ok(Candidate { grasp: find(&self.second, Role::Second, *id)?, worth: *worth }))
            .collect::<Result<Vec<_>>>()?;
        Ok((first, candidates))
    }
}

/// Share of `errors` under which `second` takes its object without a collision; without error it is known to.
fn robustness(hold: &Snapshot, second: &Grasp, errors: &[TrialNoise]) -> Result<f64> {
    let mut held = 0;
    for noise in errors {
        let (collided, outcome) = rehearse_second(hold, &misaimed(second, noise, 1))?;
        held += usize::from(outcome.held && !collided);
    }
    Ok((1 + held) as f64 / (1 + errors.len()) as f64)
}

/// Rehearses pairs until `count` combinations stand.
pub fn make_plans(world: &World, repertoire: &Repertoire, count: usize, seed: u64, quiet: bool) -> Result<Plans> {
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(count as u64) };
    // With cameras, as in a trial: a look ends when its images have come.
    let board = TactileBoard::unit(&world.cell.hand, 0);
    let mut plans = Plans { version: VERSION, seed, rejected: Vec::new(), plans: Vec::new() };
    let pairs: Vec<Combination> = draw_combinations(&world.scenario, usize::MAX, seed).collect();
    for batch in pairs.chunks(8) {
        let made: Vec<Result<Option<Plan>>> =
            batch.par_iter().map(|pair| plan_pair(world, repertoire, &board, pair)).collect();
        for (pair, made) in batch.iter().zip(made) {
            match made? {
                Some(plan) if plans.plans.len() < count => {
                    plans.plans.push(plan);
                    bar.inc(1);
                }
                None if plans.plans.len() < count => plans.rejected.push((pair.first.clone(), pair.second.clone())),
                _ => {}
            }
        }
        if plans.plans.len() >= count {
            break;
        }
    }
    bar.finish_and_clear();
    if plans.plans.len() < count {
        bail!(
            "only {} of the scenario's {} pairs can be done by this hand without noise; {count} were asked for",
            plans.plans.len(),
            pairs.len()
        );
    }
    Ok(plans)
}

fn plan_pair(world: &World, repertoire: &Repertoire, board: &TactileBoard, pair: &Combination) -> Result<Option<Plan>> {
    let seconds: Vec<&Grasp> = repertoire.of(&pair.second, Role::Second).collect();
    let Some(any) = seconds.first() else { return Ok(None) };
    let errors = proving_errors(ERRORS);
    for first in repertoire.of(&pair.first, Role::First) {
        let Some((hold, _)) =
            rehearse_first(world, &world.protocol(), Start::Ready, first, any, &TrialNoise::none(), board)?
        else {
            continue;
        };
        let mut worked: Vec<&Grasp> = Vec::new();
        let mut failed = Vec::new();
        for second in &seconds {
            let (collided, outcome) = rehearse_second(&hold, second)?;
            if outcome.held && !collided {
                worked.push(second);
            } else {
                failed.push((second.id, FAILED_WORTH * second.score));
            }
        }
        if worked.is_empty() {
            continue;
        }
        let mut ranked = Vec::new();
        for (n, second) in worked.iter().enumerate() {
            let worth = if n < PROVEN { robustness(&hold, second, &errors)? } else { UNPROVEN_WORTH * second.score };
            ranked.push((second.id, worth));
        }
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        ranked.extend(failed);
        return Ok(Some(Plan {
            first: pair.first.clone(),
            second: pair.second.clone(),
            first_grasp: first.id,
            second_grasps: ranked,
        }));
    }
    Ok(None)
}
