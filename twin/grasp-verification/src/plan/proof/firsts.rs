//! Other first grasps of a plan: those of the repertoire, and new ones that hold where those do not.

use anyhow::Result;
use control::odds::TryOutcome;
use dexterous_grasping::sampler::vary;
use dexterous_grasping::{Grasp, digit_sets};

use super::race::{ANOTHER, Entrant, FIRST_NUMBER, HEATS, PARENTS, Race, VARIED, heats};
use crate::plan::Plan;
use crate::proposals::Proposals;
use crate::rehearsal::circumstances::Errors;

/// Maximum number of first grasps that are found.
const FOUND: usize = 4;

impl Race<'_> {
    /// Returns the first grasps that hold most often under the selecting draws: known ones of the repertoire and of the
    /// plan, proposals, and variations of the best.
    pub fn firsts(&self, plan: &Plan) -> Result<Vec<Grasp>> {
        let mut race = self.clone().numbered(plan, FIRST_NUMBER + 2 * ANOTHER);
        let hand = &self.world.cell.robot.hand;
        let digits = digit_sets(hand, 2).swap_remove(0);
        let known = self.repertoire.of(&plan.first, &digits).chain(plan.varied(&plan.first, &digits));
        let mut entrants: Vec<Entrant> = known.cloned().map(Entrant::new).collect();
        let object = self.world.object(&plan.first)?;
        let proposals = Proposals::new(hand, &object, &digits, None, true)?;
        for _ in 0..self.effort.drawn {
            entrants.extend(proposals.drawn(race.number, &mut race.rng).map(Entrant::new));
            race.number += 1;
        }
        for _ in 0..self.effort.synthesized {
            entrants.extend(proposals.synthesized(race.number, &mut race.rng).map(Entrant::new));
            race.number += 1;
        }
        let draws = self.effort.selecting;
        let holds = |draw: usize, grasp: &Grasp| race.held_by(grasp, draw);
        heats(&mut entrants, (&HEATS, FOUND), draws, holds)?;
        let parents: Vec<Grasp> = entrants.iter().take(PARENTS).map(|entrant| entrant.grasp.clone()).collect();
        let batch = if parents.is_empty() { 0 } else { self.effort.batch };
        let (mut rng, first) = (race.rng.clone(), race.number);
        let vary_one = |n: usize| vary(&parents[n % parents.len()], first + n as u32, &mut rng);
        let mut varied: Vec<Entrant> = (0..batch).map(vary_one).map(Entrant::new).collect();
        heats(&mut varied, (&VARIED, FOUND), draws, holds)?;
        entrants.append(&mut varied);
        super::race::rank(&mut entrants);
        entrants.truncate(FOUND);
        entrants.into_iter().map(|entrant| race.seen_first(entrant)).collect()
    }

    fn held_by(&self, first: &Grasp, draw: usize) -> Result<TryOutcome> {
        let hold = self.with_first(first.clone()).hold(Errors::Wider, draw)?;
        Ok(if hold.is_some() { TryOutcome::Held } else { TryOutcome::Missed })
    }

    /// Returns the grasp of an entrant with the pose in which it holds the object in the first draw in which it does.
    fn seen_first(&self, entrant: Entrant) -> Result<Grasp> {
        let Some(draw) = entrant.first_held().filter(|_| entrant.grasp.held.is_none()) else {
            return Ok(entrant.grasp);
        };
        let score = entrant.worth();
        let race = self.with_first(Grasp { score, ..entrant.grasp });
        let Some(hold) = race.hold(Errors::Wider, draw)? else { return Ok(race.first) };
        let truth = hold.robot.truth();
        let held = Some(truth.palm.inverse() * truth.objects[0]);
        Ok(Grasp { held, held_joints: Some(truth.hand), ..race.first })
    }
}
