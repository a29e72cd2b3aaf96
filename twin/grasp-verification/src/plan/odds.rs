//! Rehearsals of one plan for the odds of its second grasps.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use sim::tactile::TactileBoard;

use super::outcomes::Rehearsals;
use super::{Plan, variations};
use crate::simulated_world::World;

/// Runs one step of a plan's rehearsals: 0 tries its second grasps, 1 those after other first grasps, 2 variations of
/// them.
pub(super) fn step(
    number: usize,
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut Plan,
) -> Result<()> {
    let rehearsals = Rehearsals::new(world, board);
    match number {
        0 => rehearsals.rehearse(repertoire, plan)?,
        1 => plan.others = rehearsals.others(repertoire, plan)?,
        _ => variations::rehearse_one(world, repertoire, board, plan)?,
    }
    Ok(())
}

/// Runs all steps for one plan.
pub(super) fn rehearse(world: &World, repertoire: &Repertoire, board: &TactileBoard, plan: &mut Plan) -> Result<()> {
    (0..3).try_for_each(|number| step(number, world, repertoire, board, plan))
}
