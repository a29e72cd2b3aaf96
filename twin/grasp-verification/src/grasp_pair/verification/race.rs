//! A race (successive halving): many grasps of a second object meet few draws of the circumstances and few grasps meet
//! many. Variations of the best then race in turn.

use anyhow::{Context as _, Result};
use control::extent::HeldExtent;
use control::outcome_model::TryOutcome;
use control::score::MISS_SCORE;
use dexterous_grasping::sampler::vary;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use hand_model::parameters::Handedness;
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest as _, Sha256};
use sim::tactile::TactileBoard;

use super::{HoldStatistics, Verification, VerificationEffort, VerifiedGrasp};
use crate::grasp_pair::GraspPair;
use crate::grasp_pair::outcomes::{outcome_letter, total_score};
use crate::proposals::{GraspProposals, carried_object};
use crate::rollout::circumstances::{ErrorMagnitude, draw_circumstances, hold_first};
use crate::rollout::{RolloutSnapshot, misaimed, roll_out_last, try_second, wide_errors};
use crate::simulated_world::SimulatedWorld;

/// Largest additional roll, rad.
const MAX_EXTRA_ROLL: f64 = 0.75;
/// Heats before the last one, which has all draws. Each is (draws that a grasp has met after it, grasps that go on).
pub(super) const HEATS: [(usize, usize); 3] = [(1, 24), (3, 12), (8, 6)];
/// Heats of the variations of a round, likewise.
pub(super) const VARIATION_HEATS: [(usize, usize); 3] = [(1, 10), (3, 5), (8, 3)];
/// Number of grasps that a round starts from.
pub(super) const PARENT_COUNT: usize = 3;
/// Number of grasps that have held under all draws after which no further round is run.
const SUFFICIENT_GRASPS: usize = 3;
/// Number of grasps that are kept.
const GRASPS_KEPT: usize = 4;
/// First number of the grasps that are found.
pub(super) const FIRST_NUMBER: u32 = 2_000_000;
/// Offset of the numbers of grasps found after another first grasp.
pub(super) const ANOTHER_FIRST_OFFSET: u32 = 100_000;
/// Number of draws in which other first grasps are compared.
const COMPARISON_DRAWS: usize = 6;

/// A grasp with its outcomes under the draws so far, one letter each.
#[derive(Clone)]
pub(super) struct Entrant {
    pub grasp: Grasp,
    outcomes: String,
}

impl Entrant {
    pub fn new(grasp: Grasp) -> Self {
        Self { grasp, outcomes: String::new() }
    }

    /// Returns the mean score of a try.
    pub fn mean_score(&self) -> f64 {
        total_score(self.outcomes.chars()) / self.outcomes.len().max(1) as f64
    }

    fn held(&self, draw: usize) -> bool {
        self.outcomes.as_bytes().get(draw) == Some(&b'h')
    }

    /// Returns the first draw in which it held its object.
    pub fn first_held(&self) -> Option<usize> {
        self.outcomes.find('h')
    }

    fn always_held(&self, draws: usize) -> bool {
        self.outcomes.len() == draws && self.outcomes.bytes().all(|letter| letter == b'h')
    }
}

pub(super) fn rank(entrants: &mut [Entrant]) {
    entrants.sort_by(|a, b| b.mean_score().total_cmp(&a.mean_score()).then(a.grasp.id.cmp(&b.grasp.id)));
}

/// Race for one grasp pair.
#[derive(Clone)]
pub(super) struct Race<'a> {
    pub world: &'a SimulatedWorld,
    pub repertoire: &'a Repertoire,
    pub board: &'a TactileBoard,
    pub effort: VerificationEffort,
    pub first: Grasp,
    /// Planned grasp of the second object.
    planned: Grasp,
    pub rng: ChaCha8Rng,
    /// First number of the grasps found in races after this first grasp. `number` is the next one.
    first_number: u32,
    pub number: u32,
}

impl<'a> Race<'a> {
    /// Creates a race after the planned first grasp.
    pub fn new(
        world: &'a SimulatedWorld,
        repertoire: &'a Repertoire,
        board: &'a TactileBoard,
        plan: &GraspPair,
        effort: VerificationEffort,
    ) -> Result<Self> {
        let grasps = plan.grasps(&world.cell.robot.hand, repertoire)?;
        let planned = grasps.second_candidates.first().map(|planned| planned.grasp.clone());
        let planned = planned.with_context(|| format!("the grasp pair of {} has no second grasp", plan.first))?;
        let level = if effort.level > 1 { format!(", effort {}", effort.level) } else { String::new() };
        let seed = format!("proof of {}, {}{level}", plan.first, plan.second);
        let rng = ChaCha8Rng::from_seed(Sha256::digest(seed).into());
        let race = Self {
            world,
            repertoire,
            board,
            effort,
            first: grasps.first,
            planned,
            rng,
            first_number: FIRST_NUMBER,
            number: 0,
        };
        Ok(race.numbered(plan, FIRST_NUMBER))
    }

    /// Returns the race with `first` as the first grasp.
    pub fn with_first(&self, first: Grasp) -> Self {
        Self { first, ..self.clone() }
    }

    /// Returns the race after another first grasp, with its own numbers.
    pub fn for_other_first(&self, plan: &GraspPair, first: Grasp) -> Self {
        self.with_first(first).numbered(plan, FIRST_NUMBER + ANOTHER_FIRST_OFFSET)
    }

    /// Numbers new grasps from `first` on, beyond those that the pair already has.
    pub fn numbered(self, plan: &GraspPair, first: u32) -> Self {
        let block = first..first + ANOTHER_FIRST_OFFSET;
        let known = plan.variations.iter().map(|grasp| grasp.id).filter(|id| block.contains(id)).max();
        Self { first_number: first, number: known.map_or(first, |known| known + 1), ..self }
    }

    /// Returns the share of a few draws in which the best of `seconds` holds. If `seconds` is empty, it is the share in
    /// which the first grasp holds.
    pub fn sampled_hold_share(&self, seconds: &[Grasp]) -> Result<f64> {
        let mut held = vec![0; seconds.len().max(1)];
        for number in 0..COMPARISON_DRAWS {
            let Some(hold) = self.hold(ErrorMagnitude::Wide, number)? else { continue };
            held[0] += usize::from(seconds.is_empty());
            for (second, held) in seconds.iter().zip(&mut held) {
                *held += usize::from(try_second(&hold, second)? == TryOutcome::Held);
            }
        }
        Ok(held.into_iter().max().unwrap_or(0) as f64 / COMPARISON_DRAWS as f64)
    }

    /// Runs the race. Returns the verification of the best grasps and those of them that are new, or `None` if the
    /// first grasp holds too seldom.
    pub fn run(mut self, plan: &GraspPair) -> Result<Option<(Verification, Vec<Grasp>)>> {
        let VerificationEffort { selection_draws: selecting, rounds, batch, .. } = self.effort;
        let mut holds = Vec::with_capacity(selecting);
        for number in 0..2 * selecting {
            if holds.len() < selecting {
                holds.extend(self.hold(ErrorMagnitude::Wide, number)?);
            }
        }
        if holds.len() < selecting {
            return Ok(None);
        }
        let mut entrants = self.entrants(plan, &holds[0])?;
        let outcome = |draw: usize, grasp: &Grasp| try_second(&holds[draw], grasp);
        run_heats(&mut entrants, (&HEATS, GRASPS_KEPT), selecting, outcome)?;
        for _ in 0..rounds {
            if entrants.is_empty()
                || entrants.iter().filter(|entrant| entrant.always_held(selecting)).count() >= SUFFICIENT_GRASPS
            {
                break;
            }
            let parents: Vec<Grasp> = entrants.iter().take(PARENT_COUNT).map(|entrant| entrant.grasp.clone()).collect();
            let mut varied: Vec<Entrant> =
                (0..batch).map(|n| Entrant::new(self.vary(&parents[n % parents.len()]))).collect();
            run_heats(&mut varied, (&VARIATION_HEATS, PARENT_COUNT), selecting, outcome)?;
            entrants.append(&mut varied);
            rank(&mut entrants);
        }
        let kept = complementary(entrants, selecting)
            .into_iter()
            .map(|entrant| with_observed_pose(entrant, &holds))
            .collect::<Result<_>>()?;
        drop(holds);
        self.try_kept(kept, plan).map(Some)
    }

    /// Returns the hold of the first object under draw `number`, or `None` if it is not held.
    pub fn hold(&self, errors: ErrorMagnitude, number: usize) -> Result<Option<RolloutSnapshot>> {
        hold_first(
            self.world,
            [&self.first, &self.planned],
            &draw_circumstances(self.world, errors, number),
            self.board,
        )
    }

    /// Returns the pose of the first object in the palm over the draws of a verification.
    pub fn hold_statistics(&self) -> Result<Option<HoldStatistics>> {
        let object = self.world.object(&self.first.object)?;
        let holds = (0..self.effort.verification_draws).map(|number| self.hold(ErrorMagnitude::Residual, number));
        let poses = holds.filter_map(|hold| hold.map(|hold| hold.as_ref().map(in_palm)).transpose());
        Ok(HoldStatistics::from_poses(&poses.collect::<Result<Vec<_>>>()?, &object.symmetry))
    }

    /// Returns the known grasps and the proposals next to the object held in `hold`.
    fn entrants(&mut self, plan: &GraspPair, hold: &RolloutSnapshot) -> Result<Vec<Entrant>> {
        let hand = &self.world.cell.robot.hand;
        let digits = digit_sets(hand, 2).swap_remove(1);
        let known = self.repertoire.for_digits(&plan.second, &digits).chain(plan.variations_for(&plan.second, &digits));
        let mut entrants: Vec<Entrant> = known.cloned().map(Entrant::new).collect();
        let (first, second) = (self.world.object(&plan.first)?, self.world.object(&plan.second)?);
        let proposals = GraspProposals::new(hand, &second, &digits, Some(&carried_object(hold, &first)), true)?;
        let side = if hand.parameters.handedness == Handedness::Left { 1.0 } else { -1.0 };
        for n in 0..self.effort.drawn_proposals {
            let Some(mut grasp) = proposals.drawn(self.number, &mut self.rng) else { break };
            self.number += 1;
            if n % 2 == 1 {
                grasp.roll += side * self.rng.random_range(0.0..MAX_EXTRA_ROLL);
            }
            entrants.push(Entrant::new(grasp));
        }
        for _ in 0..self.effort.synthesized {
            entrants.extend(proposals.synthesized(self.number, &mut self.rng).map(Entrant::new));
            self.number += 1;
        }
        Ok(entrants)
    }

    fn vary(&mut self, parent: &Grasp) -> Grasp {
        self.number += 1;
        vary(parent, self.number - 1, &mut self.rng)
    }

    /// Tries the `kept` grasps and the planned one under the draws that played no part in the selection.
    fn try_kept(&self, mut kept: Vec<Grasp>, plan: &GraspPair) -> Result<(Verification, Vec<Grasp>)> {
        if !kept.iter().any(|grasp| grasp.id == self.planned.id) {
            kept.push(self.planned.clone());
        }
        let wide = wide_errors(self.effort.wide_draws);
        let (mut holds, mut grasps) = (Vec::new(), Vec::new());
        grasps.extend(kept.iter().map(|grasp| VerifiedGrasp { grasp: grasp.id, ..VerifiedGrasp::default() }));
        let object = self.world.object(&self.first.object)?;
        let mut poses = Vec::new();
        for number in 0..self.effort.verification_draws {
            let Some(hold) = self.hold(ErrorMagnitude::Residual, number)? else {
                holds.push(None);
                continue;
            };
            let pose = in_palm(&hold);
            poses.push(pose);
            let HeldExtent(extent) = HeldExtent::from_shape(&object.shape, &pose);
            holds.push(Some(extent.map(|reach| (reach * 1e5).round() / 1e2)));
            for (grasp, verified) in kept.iter().zip(&mut grasps) {
                verified.near.push(outcome_letter(try_second(&hold, grasp)?));
                if let Some(error) = wide.get(number) {
                    verified.wide.push(outcome_letter(try_second(&hold, &misaimed(grasp, error, 1))?));
                }
            }
        }
        // Grasps that earlier races found already belong to the plan.
        kept.retain(|grasp| grasp.id >= self.first_number && plan.variations.iter().all(|known| known.id != grasp.id));
        let hold = HoldStatistics::from_poses(&poses, &object.symmetry);
        Ok((Verification { effort: self.effort.level, holds, hold, grasps }, kept))
    }
}

/// Returns `palm_from_object` of the first object.
fn in_palm(hold: &RolloutSnapshot) -> Isometry3<f64> {
    let truth = hold.robot.truth();
    truth.palm.inverse() * truth.objects[0]
}

/// Runs the heats, then one under all draws. `left` entrants remain at most, the best first.
pub(super) fn run_heats(
    entrants: &mut Vec<Entrant>,
    (heats, left): (&[(usize, usize)], usize),
    all: usize,
    outcome: impl Fn(usize, &Grasp) -> Result<TryOutcome>,
) -> Result<()> {
    let last = (all, left);
    for (draws, going_on) in heats.iter().chain([&last]) {
        let draws = &all.min(*draws);
        for entrant in entrants.iter_mut() {
            while entrant.outcomes.len() < *draws {
                entrant.outcomes.push(outcome_letter(outcome(entrant.outcomes.len(), &entrant.grasp)?));
            }
        }
        rank(entrants);
        entrants.truncate(*going_on);
        entrants.retain(|entrant| entrant.mean_score() > MISS_SCORE);
    }
    Ok(())
}

/// Returns the best of `entrants`, then those that hold most often in draws in which none of the earlier ones does.
fn complementary(mut entrants: Vec<Entrant>, draws: usize) -> Vec<Entrant> {
    let mut kept: Vec<Entrant> = Vec::new();
    while kept.len() < GRASPS_KEPT && !entrants.is_empty() {
        let open = |draw: &usize| !kept.iter().any(|known| known.held(*draw));
        let covered = |entrant: &Entrant| (0..draws).filter(open).filter(|draw| entrant.held(*draw)).count();
        // The entrants are in order of score: of those that cover as many draws, the one with the higher score is
        // taken.
        let best = (0..entrants.len()).rev().max_by_key(|n| covered(&entrants[*n])).unwrap_or(0);
        let best = entrants.remove(best);
        kept.push(best);
    }
    kept
}

/// Returns the grasp of an entrant with the pose in which it holds the object, from the first draw in which it holds to
/// the end of the trial.
fn with_observed_pose(entrant: Entrant, holds: &[RolloutSnapshot]) -> Result<Grasp> {
    let score = entrant.mean_score();
    let mut grasp = Grasp { score, ..entrant.grasp };
    for (hold, letter) in holds.iter().zip(entrant.outcomes.chars()) {
        if letter != 'h' {
            continue;
        }
        let (collided, outcome) = roll_out_last(hold, &grasp)?;
        if outcome.held && !collided {
            (grasp.held, grasp.held_joints) = (Some(outcome.palm_from_object), Some(outcome.joints));
            break;
        }
    }
    Ok(grasp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entrant(id: u32, letters: &str) -> Entrant {
        let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
        let any = repertoire.grasps.values().flatten().next().expect("a grasp");
        Entrant { grasp: Grasp { id, ..any.clone() }, outcomes: letters.chars().cycle().take(16).collect() }
    }

    /// After the best grasp comes the one that holds in draws in which it does not, although others hold more often.
    #[test]
    fn kept_grasps_complement_each_other() {
        let mut entrants = vec![entrant(1, "hhhm"), entrant(2, "hhmm"), entrant(3, "hhmm"), entrant(4, "mmmh")];
        rank(&mut entrants);
        let kept: Vec<u32> = complementary(entrants, 16).iter().map(|entrant| entrant.grasp.id).collect();
        assert_eq!(kept, [1, 4, 2, 3]);
    }
}
