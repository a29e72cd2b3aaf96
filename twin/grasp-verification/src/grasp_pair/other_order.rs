//! Reversed order: if no sequence of grasps of a combination is sure, its objects are also planned and rolled out in
//! the other order. They stay in place, so the object in the layout's second place is then taken first.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use sim::tactile::TactileBoard;

use super::{GraspOutcomes, GraspPair, GraspPairTable, outcome_model, plan_pair};
use crate::simulated_world::SimulatedWorld;

/// Threshold above which a sequence is sure: the score of its best second grasp near its planned pose.
const SURE_SCORE: f64 = 0.95;

/// Plans, in the reversed order, those of the pairs `plans` in which nothing is sure. Shows a progress bar unless
/// `quiet`.
pub fn plan_reversed(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &mut GraspPairTable,
    quiet: bool,
) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    plans.for_each_pair("pairs reversed", quiet, |plan| plan_reversed_pair(world, repertoire, &board, plan))
}

/// Plans the objects of one pair in the reversed order.
fn plan_reversed_pair(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut GraspPair,
) -> Result<()> {
    let turned = world.with_places_swapped();
    let mut reversed = reversed_pair(&turned, repertoire, board, plan)?;
    if let Some(reversed) = &mut reversed {
        outcome_model::roll_out_steps(&turned, repertoire, board, reversed)?;
    }
    plan.reversed = reversed.map(Box::new);
    Ok(())
}

/// Plans the objects of `plan` in the reversed order, without outcomes, in a world in that order. Returns `None` if
/// `plan` is sure.
pub(super) fn reversed_pair(
    turned: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &GraspPair,
) -> Result<Option<GraspPair>> {
    if best_score(plan) >= SURE_SCORE {
        return Ok(None);
    }
    plan_pair(turned, repertoire, board, [&plan.second, &plan.first])
}

/// Returns the score of the best second grasp of `plan`, after any of its first grasps.
fn best_score(plan: &GraspPair) -> f64 {
    let others = plan.alternative_firsts.iter().flat_map(|other| &other.outcomes);
    plan.outcomes.iter().chain(others).map(GraspOutcomes::score_once_touched).fold(0.0, f64::max)
}
