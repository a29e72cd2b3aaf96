//! Variations: if no second grasp of a combination scores high, the search continues around its best ones, in the
//! combination itself.
//!
//! A variation is selected under narrow errors that do not count for the outcome model. It is then tried under the
//! errors that all grasps meet, so that the selection does not bias its outcomes.

use anyhow::Result;
use dexterous_grasping::sampler::vary;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use scenarios::noise::TrialNoise;
use sha2::{Digest as _, Sha256};
use sim::tactile::TactileBoard;

use super::outcomes::{GOOD_SCORE, GraspOutcomes, NARROW_DRAWS, RolloutContext};
use super::{GraspPair, GraspPairTable};
use crate::rollout::{RolloutSnapshot, misaimed, narrow_errors, roll_out_last, try_second};
use crate::simulated_world::SimulatedWorld;
use control::outcome_model::TryOutcome;

/// Number of rounds of variation around the best grasps so far.
const ROUND_COUNT: usize = 2;
/// Number of variations per round.
const BATCH_SIZE: u32 = 16;
/// Number of grasps that a round starts from.
const PARENT_COUNT: usize = 3;
/// Number of variations that a combination keeps.
const VARIATIONS_KEPT: usize = 2;
/// First number of variations, beyond those of a repertoire, also of one without some digits.
const FIRST_NUMBER: u32 = 1_000_000;

/// Searches variations for those of the pairs `plans` without a second grasp that scores high. Shows a progress bar
/// unless `quiet`.
pub fn search_variations(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &mut GraspPairTable,
    quiet: bool,
) -> Result<()> {
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    plans.for_each_pair("pairs varied", quiet, |plan| search_pair_variations(world, repertoire, &board, plan))
}

/// Searches variations for one grasp pair.
pub fn search_pair_variations(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    plan: &mut GraspPair,
) -> Result<()> {
    plan.forget_variations();
    let sequences = std::iter::once((plan.first_grasp, &plan.outcomes))
        .chain(plan.alternative_firsts.iter().map(|other| (other.first_grasp, &other.outcomes)));
    let best = |outcomes: &[GraspOutcomes]| outcomes.iter().map(GraspOutcomes::score_once_touched).fold(0.0, f64::max);
    // The first of sequences of equal score, which is the planned one.
    let Some((first, outcomes)) = sequences.reduce(|a, b| if best(b.1) > best(a.1) { b } else { a }) else {
        return Ok(());
    };
    if best(outcomes) >= GOOD_SCORE {
        return Ok(());
    }
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let seconds: Vec<&Grasp> = repertoire.for_digits(&plan.second, &sets[1]).collect();
    let Some(grasp) = repertoire.for_digits(&plan.first, &sets[0]).find(|grasp| grasp.id == first) else {
        return Ok(());
    };
    let context = RolloutContext::new(world, board);
    let Some(hold) = context.hold_first(grasp, seconds.first().copied())? else { return Ok(()) };
    let tried = outcomes.iter().filter(|outcomes| outcomes.near.len() >= NARROW_DRAWS);
    let parents: Vec<(Grasp, f64)> = tried
        .filter_map(|outcomes| {
            let grasp = seconds.iter().find(|grasp| grasp.id == outcomes.grasp)?;
            Some(((*grasp).clone(), outcomes.score_once_touched()))
        })
        .collect();
    let kept =
        Climb { hold: &hold, errors: narrow_errors(2 * NARROW_DRAWS).split_off(NARROW_DRAWS) }.run(parents, plan)?;
    let grasps: Vec<&Grasp> = kept.iter().collect();
    let found = context.outcomes(&hold, &grasps, grasps.len())?;
    match plan.alternative_firsts.iter_mut().find(|other| other.first_grasp == first && first != plan.first_grasp) {
        Some(other) => other.outcomes.extend(found),
        None => plan.outcomes.extend(found),
    }
    plan.variations = kept;
    Ok(())
}

/// Climb from known grasps to better ones, while the first object is held.
struct Climb<'a> {
    hold: &'a RolloutSnapshot,
    /// Errors under which a variation is selected.
    errors: Vec<TrialNoise>,
}

impl Climb<'_> {
    /// Returns the best variations of `parents`, (grasp, score), that are better than the best parent.
    fn run(&self, mut parents: Vec<(Grasp, f64)>, plan: &GraspPair) -> Result<Vec<Grasp>> {
        let mut rng = ChaCha8Rng::from_seed(Sha256::digest(format!("{}, {}", plan.first, plan.second)).into());
        let rank =
            |grasps: &mut Vec<(Grasp, f64)>| grasps.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.id.cmp(&b.0.id)));
        rank(&mut parents);
        let standard = parents.first().map_or(0.0, |best| best.1);
        let mut number = FIRST_NUMBER;
        for _ in 0..ROUND_COUNT {
            parents.truncate(PARENT_COUNT);
            let from = parents.clone();
            let worst = from.iter().map(|parent| parent.1).fold(1.0, f64::min);
            for n in 0..BATCH_SIZE as usize {
                let Some((parent, _)) = from.get(n % from.len().max(1)) else { break };
                let varied = vary(parent, number, &mut rng);
                number += 1;
                parents.extend(self.select(varied, worst)?.filter(|(_, score)| *score > worst));
            }
            rank(&mut parents);
        }
        let better = parents.into_iter().filter(|(grasp, score)| grasp.id >= FIRST_NUMBER && *score > standard);
        Ok(better.map(|(grasp, _)| grasp).take(VARIATIONS_KEPT).collect())
    }

    /// Returns `grasp` with its held pose and its share of held tries. `None` if it fails without errors or can no
    /// longer reach `least`.
    fn select(&self, grasp: Grasp, least: f64) -> Result<Option<(Grasp, f64)>> {
        let (collided, outcome) = roll_out_last(self.hold, &grasp)?;
        if collided || !outcome.held {
            return Ok(None);
        }
        let count = self.errors.len();
        let may_fail = ((1.0 - least) * count as f64).floor() as usize;
        let mut failed = 0;
        for noise in &self.errors {
            failed += usize::from(try_second(self.hold, &misaimed(&grasp, noise, 1))? != TryOutcome::Held);
            if failed > may_fail {
                return Ok(None);
            }
        }
        let score = 1.0 - failed as f64 / count as f64;
        let (held, held_joints) = (Some(outcome.palm_from_object), Some(outcome.joints));
        Ok(Some((Grasp { held, held_joints, score, ..grasp }, score)))
    }
}
