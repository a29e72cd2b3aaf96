//! One grasp pair with its outcomes and verifications, in steps that are kept. A pair that was interrupted while it was
//! planned resumes after its last finished step.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use scenarios::combination::Combination;
use sim::tactile::TactileBoard;

use super::verification::{self, GraspVerifier, VerificationEffort};
use super::{GraspPair, other_order, outcome_model, plan_combination};
use crate::cache::SearchSteps;
use crate::simulated_world::SimulatedWorld;

/// Names of the steps, in this order: the choice of the grasps, then the rollouts for the outcome model. The steps
/// after "other order" are done for the reversed pair of the same two objects.
const STEP_NAMES: [&str; 8] = [
    "plan",
    "outcome model",
    "other first grasps",
    "variations",
    "other order",
    "its outcome model",
    "its other first grasps",
    "its variations",
];

/// Plans a combination in steps that are kept. Returns `None` if nothing works without errors.
pub fn plan_stepwise(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    pair: &Combination,
    steps: &SearchSteps<Option<GraspPair>>,
) -> Result<Option<GraspPair>> {
    let mut made: Option<GraspPair> = None;
    let turned = world.with_places_swapped();
    // Outcomes and orders exist for two objects only.
    let steps_of = if pair.objects.len() == 2 { &STEP_NAMES[..] } else { &STEP_NAMES[..1] };
    for (number, name) in steps_of.iter().enumerate() {
        if let Some(known) = steps.known(name) {
            made = known.clone();
            continue;
        }
        match (number, &mut made) {
            (0, made) => *made = plan_combination(world, repertoire, board, pair)?,
            (4, Some(plan)) => {
                plan.reversed = other_order::reversed_pair(&turned, repertoire, board, plan)?.map(Box::new)
            }
            (1..4, Some(plan)) => outcome_model::rollout_step(number - 1, world, repertoire, board, plan)?,
            (_, Some(GraspPair { reversed: Some(reversed), .. })) => {
                outcome_model::rollout_step(number - 5, &turned, repertoire, board, reversed)?;
            }
            // Nothing to do.
            _ => continue,
        }
        steps.keep(name, &made)?;
    }
    Ok(made)
}

/// Adds verifications to `plan` at a level of effort, in steps that are kept.
pub fn verify_stepwise(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    mut plan: GraspPair,
    level: u32,
    steps: &SearchSteps<Option<GraspPair>>,
) -> Result<Option<GraspPair>> {
    let prover = GraspVerifier::new(world, repertoire, VerificationEffort::of_level(level));
    for step in verification::VERIFICATION_STEPS {
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
