//! Reversed order: if no sequence of grasps of a combination is sure, its objects are also planned and rehearsed in the
//! other order. They stay where they are, so the object in the layout's second place is then taken first.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use sim::tactile::TactileBoard;

use super::{Outcomes, Plan, Plans, odds, plan_pair};
use crate::simulated_world::World;

/// Threshold above which a sequence is sure: the worth of its best second grasp near its rehearsed pose.
const SURE: f64 = 0.95;

/// Plans, in the reversed order, those of the `plans` in which nothing is sure. Shows a progress bar unless `quiet`.
pub fn rehearse(world: &World, repertoire: &Repertoire, plans: &mut Plans, quiet: bool) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    plans.try_each("plans reversed", quiet, |plan| rehearse_one(world, repertoire, &board, plan))
}

/// Plans one plan's objects in the reversed order.
fn rehearse_one(world: &World, repertoire: &Repertoire, board: &TactileBoard, plan: &mut Plan) -> Result<()> {
    let turned = world.in_other_order();
    let mut reversed = planned(&turned, repertoire, board, plan)?;
    if let Some(reversed) = &mut reversed {
        odds::rehearse(&turned, repertoire, board, reversed)?;
    }
    plan.reversed = reversed.map(Box::new);
    Ok(())
}

/// Plans the objects of `plan` in the reversed order, without odds, in a world in that order. Returns `None` if `plan`
/// is sure.
pub(super) fn planned(
    turned: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &Plan,
) -> Result<Option<Plan>> {
    if best(plan) >= SURE {
        return Ok(None);
    }
    plan_pair(turned, repertoire, board, [&plan.second, &plan.first])
}

/// Returns the worth of the best second grasp of `plan`, after any of its first grasps.
fn best(plan: &Plan) -> f64 {
    let others = plan.others.iter().flat_map(|other| &other.outcomes);
    plan.outcomes.iter().chain(others).map(Outcomes::worth_once_touched).fold(0.0, f64::max)
}
