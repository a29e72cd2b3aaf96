//! Other first grasps of a grasp pair: those of the repertoire, and new ones that hold in draws in which those do not.

use anyhow::Result;
use control::outcome_model::TryOutcome;
use dexterous_grasping::sampler::vary;
use dexterous_grasping::{Grasp, digit_sets};

use super::race::{ANOTHER_FIRST_OFFSET, Entrant, FIRST_NUMBER, HEATS, PARENT_COUNT, Race, VARIATION_HEATS, run_heats};
use crate::grasp_pair::GraspPair;
use crate::proposals::GraspProposals;
use crate::rollout::circumstances::ErrorMagnitude;

/// Maximum number of first grasps that are found.
const MAX_FOUND: usize = 4;

impl Race<'_> {
    /// Returns the first grasps that hold most often under the selecting draws: known ones of the repertoire and of the
    /// pair, proposals, and variations of the best.
    pub fn first_grasps(&self, plan: &GraspPair) -> Result<Vec<Grasp>> {
        let mut race = self.clone().numbered(plan, FIRST_NUMBER + 2 * ANOTHER_FIRST_OFFSET);
        let hand = &self.world.cell.robot.hand;
        let digits = digit_sets(hand, 2).swap_remove(0);
        let known = self.repertoire.for_digits(&plan.first, &digits).chain(plan.variations_for(&plan.first, &digits));
        let mut entrants: Vec<Entrant> = known.cloned().map(Entrant::new).collect();
        let object = self.world.object(&plan.first)?;
        let proposals = GraspProposals::new(hand, &object, &digits, None, true)?;
        for _ in 0..self.effort.drawn_proposals {
            entrants.extend(proposals.drawn(race.number, &mut race.rng).map(Entrant::new));
            race.number += 1;
        }
        for _ in 0..self.effort.synthesized {
            entrants.extend(proposals.synthesized(race.number, &mut race.rng).map(Entrant::new));
            race.number += 1;
        }
        let draws = self.effort.selection_draws;
        let holds = |draw: usize, grasp: &Grasp| race.held_by(grasp, draw);
        run_heats(&mut entrants, (&HEATS, MAX_FOUND), draws, holds)?;
        let parents: Vec<Grasp> = entrants.iter().take(PARENT_COUNT).map(|entrant| entrant.grasp.clone()).collect();
        let batch = if parents.is_empty() { 0 } else { self.effort.batch };
        let (mut rng, first) = (race.rng.clone(), race.number);
        let vary_one = |n: usize| vary(&parents[n % parents.len()], first + n as u32, &mut rng);
        let mut varied: Vec<Entrant> = (0..batch).map(vary_one).map(Entrant::new).collect();
        run_heats(&mut varied, (&VARIATION_HEATS, MAX_FOUND), draws, holds)?;
        entrants.append(&mut varied);
        super::race::rank(&mut entrants);
        entrants.truncate(MAX_FOUND);
        entrants.into_iter().map(|entrant| race.with_first_pose(entrant)).collect()
    }

    fn held_by(&self, first: &Grasp, draw: usize) -> Result<TryOutcome> {
        let hold = self.with_first(first.clone()).hold(ErrorMagnitude::Wide, draw)?;
        Ok(if hold.is_some() { TryOutcome::Held } else { TryOutcome::Missed })
    }

    /// Returns the grasp of an entrant with the pose in which it holds the object in the first draw in which it does.
    fn with_first_pose(&self, entrant: Entrant) -> Result<Grasp> {
        let Some(draw) = entrant.first_held().filter(|_| entrant.grasp.held.is_none()) else {
            return Ok(entrant.grasp);
        };
        let score = entrant.mean_score();
        let race = self.with_first(Grasp { score, ..entrant.grasp });
        let Some(hold) = race.hold(ErrorMagnitude::Wide, draw)? else { return Ok(race.first) };
        let truth = hold.robot.truth();
        let held = Some(truth.palm.inverse() * truth.objects[0]);
        Ok(Grasp { held, held_joints: Some(truth.hand), ..race.first })
    }
}
