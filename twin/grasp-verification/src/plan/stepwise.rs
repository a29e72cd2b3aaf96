//! Plan of one pair with its odds and proofs, in steps that are kept. A pair that was interrupted while it was planned
//! resumes after its last finished step.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use scenarios::combination::Combination;
use sim::tactile::TactileBoard;

use super::proof::{self, Effort, Prover};
use super::{Plan, odds, other_order, plan_one};
use crate::cache::Steps;
use crate::simulated_world::World;

/// Names of the steps, in this order: the choice of the grasps, then the rehearsals for the odds. The steps after
/// "other order" are done for the reversed plan of the same two objects.
const STEPS: [&str; 8] = [
    "plan",
    "odds",
    "other first grasps",
    "variations",
    "other order",
    "its odds",
    "its other first grasps",
    "its variations",
];

/// Plans a combination in steps that are kept. Returns `None` if nothing works without errors.
pub fn plan(
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    pair: &Combination,
    steps: &Steps<Option<Plan>>,
) -> Result<Option<Plan>> {
    let mut made: Option<Plan> = None;
    let turned = world.in_other_order();
    // Odds and orders exist for two objects only.
    let steps_of = if pair.objects.len() == 2 { &STEPS[..] } else { &STEPS[..1] };
    for (number, name) in steps_of.iter().enumerate() {
        if let Some(known) = steps.known(name) {
            made = known.clone();
            continue;
        }
        match (number, &mut made) {
            (0, made) => *made = plan_one(world, repertoire, board, pair)?,
            (4, Some(plan)) => plan.reversed = other_order::planned(&turned, repertoire, board, plan)?.map(Box::new),
            (1..4, Some(plan)) => odds::step(number - 1, world, repertoire, board, plan)?,
            (_, Some(Plan { reversed: Some(reversed), .. })) => {
                odds::step(number - 5, &turned, repertoire, board, reversed)?;
            }
            // Nothing to do.
            _ => continue,
        }
        steps.keep(name, &made)?;
    }
    Ok(made)
}

/// Adds proofs to `plan` at a level of effort, in steps that are kept.
pub fn prove(
    world: &World,
    repertoire: &Repertoire,
    mut plan: Plan,
    level: u32,
    steps: &Steps<Option<Plan>>,
) -> Result<Option<Plan>> {
    let prover = Prover::new(world, repertoire, Effort::of_level(level));
    for step in proof::STEPS {
        let name = format!("{step:?}");
        if let Some(Some(known)) = steps.known(&name) {
            plan = known.clone();
            continue;
        }
        prover.step(step, &mut plan)?;
        steps.keep(&name, &Some(plan.clone()))?;
    }
    Ok(Some(plan))
}
