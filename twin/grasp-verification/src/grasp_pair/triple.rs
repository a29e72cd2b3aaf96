//! Combinations of three objects: the little finger takes one, the ring finger the next, and thumb, index and middle
//! finger the last.
//!
//! Each grasp is rolled out without errors from the hold of the grasps before it, in the repertoire's order.

use anyhow::Result;
use control::score::NO_ROLLOUT_FACTOR;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use sim::tactile::TactileBoard;

use super::{FAILED_SCORE_FACTOR, GraspPair};
use crate::rollout::{FirstGraspRollout, roll_out_first, roll_out_last, roll_out_next};
use crate::simulated_world::SimulatedWorld;

/// Number of grasps of each object that are tried, the best ones.
const GRASPS_TESTED: [usize; 3] = [2, 3, 8];

/// Returns the first sequence of grasps that holds all three objects to the end of the trial without a collision, or
/// `None`.
pub(super) fn plan_triple(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    names: [&str; 3],
) -> Result<Option<GraspPair>> {
    let sets = digit_sets(&world.cell.robot.hand, 3);
    let grasps = |n: usize| repertoire.for_digits(names[n], &sets[n]).take(GRASPS_TESTED[n]).collect::<Vec<&Grasp>>();
    let [firsts, seconds, thirds] = [0, 1, 2].map(grasps);
    let (Some(any_second), Some(any_third)) = (seconds.first(), thirds.first()) else { return Ok(None) };
    for first in firsts {
        let standing = [first, *any_second, *any_third];
        let rollout = FirstGraspRollout::ideal(world, &standing);
        let Some((one, _)) = roll_out_first(world, &rollout, board)? else { continue };
        for second in &seconds {
            let Some(two) = roll_out_next(&one, 1, second)? else { continue };
            if let Some(worth) = ranked(&thirds, |third| {
                let (collided, outcome) = roll_out_last(&two, third)?;
                Ok(outcome.held && !collided)
            })? {
                let others = seconds.iter().filter(|other| other.id != second.id);
                let others = others.map(|other| (other.id, NO_ROLLOUT_FACTOR * other.score));
                let seconds = std::iter::once((second.id, second.score)).chain(others).collect();
                let third = Some((names[2].to_owned(), worth));
                return Ok(Some(GraspPair { third, ..GraspPair::new([names[0], names[1]], first.id, seconds) }));
            }
        }
    }
    Ok(None)
}

/// Returns the first grasp that works, then those that were not tried, then those that failed, as (number, score).
/// `None` if none works.
fn ranked(grasps: &[&Grasp], works: impl Fn(&Grasp) -> Result<bool>) -> Result<Option<Vec<(u32, f64)>>> {
    for (n, grasp) in grasps.iter().enumerate() {
        if works(grasp)? {
            let open = grasps[n + 1..].iter().map(|other| (other.id, NO_ROLLOUT_FACTOR * other.score));
            let failed = grasps[..n].iter().map(|other| (other.id, FAILED_SCORE_FACTOR * other.score));
            return Ok(Some(std::iter::once((grasp.id, grasp.score)).chain(open).chain(failed).collect()));
        }
    }
    Ok(None)
}
