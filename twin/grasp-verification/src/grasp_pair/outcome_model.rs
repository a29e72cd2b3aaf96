//! Rollouts of one grasp pair for the outcome model of its second grasps.

use anyhow::Result;
use dexterous_grasping::Repertoire;
use sim::tactile::TactileBoard;

use super::outcomes::RolloutContext;
use super::{GraspPair, variations};
use crate::simulated_world::SimulatedWorld;

/// Runs one step of a grasp pair's rollouts: 0 tries its second grasps, 1 those after other first grasps, 2 variations
/// of them.
pub(super) fn rollout_step(
    number: usize,
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut GraspPair,
) -> Result<()> {
    let context = RolloutContext::new(world, board);
    match number {
        0 => context.roll_out_pair(repertoire, plan)?,
        1 => plan.alternative_firsts = context.alternatives(repertoire, plan)?,
        _ => variations::search_pair_variations(world, repertoire, board, plan)?,
    }
    Ok(())
}

/// Runs all steps for one grasp pair.
pub(super) fn roll_out_steps(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut GraspPair,
) -> Result<()> {
    (0..3).try_for_each(|number| rollout_step(number, world, repertoire, board, plan))
}
