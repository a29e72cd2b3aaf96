//! Holds of planned grasps: each grasp is rolled out once without errors, up to the end of the trial.

use anyhow::Result;
use control::outcome_model::TryOutcome;
use dexterous_grasping::synthesis::held::HeldContact;
use dexterous_grasping::{Grasp, Repertoire};
use nalgebra::Isometry3;
use rayon::prelude::*;
use sim::tactile::TactileBoard;

use super::{GraspPair, GraspPairTable};
use crate::rollout::{FirstGraspRollout, HoldOutcome, roll_out_first, roll_out_last};
use crate::simulated_world::SimulatedWorld;

/// Grasp of a grasp pair that holds its object.
#[derive(Debug, Clone)]
pub struct PlannedHold {
    /// Names of the objects of the combination.
    pub combination: [String; 2],
    /// Place of the grasp's object in the combination, from 0.
    pub place: usize,
    pub grasp: Grasp,
    pub palm_from_object: Isometry3<f64>,
    /// Joint angles, rad.
    pub joints: Vec<f64>,
    /// Contacts, palm frame.
    pub contacts: Vec<HeldContact>,
}

/// Rolls out, for each combination, the planned first grasp and those of its verifications, each with the second grasp
/// that holds most often after it. Grasps that do not hold without errors are left out. Shows a progress bar unless
/// `quiet`.
pub fn holds_of_pairs(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &GraspPairTable,
    quiet: bool,
) -> Result<Vec<PlannedHold>> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let progress = progress::bar(plans.pairs.len() as u64, "combinations run", quiet);
    let held = plans.pairs.par_iter().map(|plan| {
        let held = holds_of_pair(world, repertoire, plan, &board)?;
        progress.inc(1);
        Ok(held)
    });
    let held: Vec<Vec<PlannedHold>> = held.collect::<Result<_>>()?;
    progress.finish_and_clear();
    Ok(held.into_iter().flatten().collect())
}

fn holds_of_pair(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plan: &GraspPair,
    board: &TactileBoard,
) -> Result<Vec<PlannedHold>> {
    let grasps = plan.grasps(&world.cell.robot.hand, repertoire)?;
    let planned = (grasps.first, grasps.second_candidates);
    let sequences = std::iter::once(planned)
        .chain(grasps.alternative_firsts.into_iter().map(|other| (other.first, other.second_candidates)));
    let mut held = Vec::new();
    for (first, seconds) in sequences {
        let share = |n: &usize| seconds[*n].rollouts.iter().filter(|one| one.outcome == TryOutcome::Held).count();
        // The first of equals, which is the planned one.
        let Some(best) = (0..seconds.len()).rev().max_by_key(share) else { continue };
        let second = seconds[best].grasp.clone();
        let both = [&first, &second];
        let Some((snapshot, first_held)) = roll_out_first(world, &FirstGraspRollout::ideal(world, &both), board)?
        else {
            continue;
        };
        let of = |place: usize, grasp: &Grasp, outcome: HoldOutcome| PlannedHold {
            combination: [plan.first.clone(), plan.second.clone()],
            place,
            grasp: grasp.clone(),
            palm_from_object: outcome.palm_from_object,
            joints: outcome.joints,
            contacts: outcome.contacts,
        };
        held.push(of(0, &first, first_held));
        let (collided, outcome) = roll_out_last(&snapshot, &second)?;
        if outcome.held && !collided {
            held.push(of(1, &second, outcome));
        }
    }
    Ok(held)
}
