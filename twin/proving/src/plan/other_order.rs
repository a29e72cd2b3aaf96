//! The other order: where no sequence of grasps of a combination is sure, its objects are planned and rehearsed the other way round
//! as well. They stay where they are: what is taken first then is what stands in the second place of the layout.

use anyhow::Result;
use grasping::Repertoire;
use sim::tactile::TactileBoard;

use super::{Outcomes, Plan, Plans, odds, plan_pair};
use crate::simulated_world::World;

/// A sequence is sure if its best second grasp is worth this much near where it was rehearsed.
const SURE: f64 = 0.95;

/// Plans those of the `plans` the other way round in which nothing is sure; shows a progress bar unless `quiet`.
pub fn rehearse(world: &World, repertoire: &Repertoire, plans: &mut Plans, quiet: bool) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    plans.try_each("plans reversed", quiet, |plan| rehearse_one(world, repertoire, &board, plan))
}

/// The same for one plan.
fn rehearse_one(world: &World, repertoire: &Repertoire, board: &TactileBoard, plan: &mut Plan) -> Result<()> {
    let turned = world.in_other_order();
    let mut reversed = planned(&turned, repertoire, board, plan)?;
    if let Some(reversed) = &mut reversed {
        odds::rehearse(&turned, repertoire, board, reversed)?;
    }
    plan.reversed = reversed.map(Box::new);
    Ok(())
}

/// The plan, without odds, of the objects of `plan` taken the other way round, in a world in that order; none where `plan` is sure.
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

/// What the best second grasp of `plan` is worth, after whatever first grasp.
fn best(plan: &Plan) -> f64 {
    let others = plan.others.iter().flat_map(|other| &other.outcomes);
    plan.outcomes.iter().chain(others).map(Outcomes::worth_once_touched).fold(0.0, f64::max)
}
