//! Grasp pairs: for each combination, a first grasp and the second grasps that may follow it, rolled out without noise.
//! For a single object, it is the grasp that holds the object to the end of the trial.
//!
//! All combinations of the scenario's objects are shuffled by the seed and rolled out in that order. A pair becomes a
//! combination if some first grasp can be followed by some second grasp without a collision. Otherwise it is listed as
//! rejected and the next pair takes its place. The results of the policies blind and touch play no part in this.
//!
//! Grasps are planned as in the paper, without any disturbance: the first grasp in the repertoire's order that holds
//! its object, and after it the first second grasp in the repertoire's order that works. The other second grasps are
//! alternatives. [`outcomes`] tries the planned grasp and the first alternatives under errors, for the outcome model of
//! a policy. If all of them score low, it also tries second grasps after other first grasps, and [`other_order`] plans
//! the two objects in the reverse order.

pub mod holds;
pub mod other_order;
mod outcome_model;
pub mod outcomes;
pub mod reduced_digits;
pub mod stepwise;
pub mod triple;
pub mod variations;
pub mod verification;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, bail};
use control::score::{GraspCandidate, GraspSequence};
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use hand_model::{Digit, Hand};
use indicatif::ProgressBar;
use rayon::prelude::*;
use scenarios::Scenario;
use scenarios::combination::{Combination, draw_combinations};
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;

use crate::rollout::{FirstGraspRollout, roll_out_carry, roll_out_first, roll_out_last};
use crate::simulated_world::SimulatedWorld;

pub use self::outcomes::GraspOutcomes;
use self::verification::Verification;

/// Format version of the files of grasp pairs.
const VERSION: u32 = 1;
/// Factor on the general score of a grasp that failed in this pair's rollout.
const FAILED_SCORE_FACTOR: f64 = 0.3;

/// Grasp pair of one combination.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct GraspPair {
    /// First object.
    pub first: String,
    /// Second object. Empty if there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub second: String,
    /// Number of the first grasp in its repertoire.
    pub first_grasp: u32,
    /// (number of the second grasp, score in this combination), the planned one first.
    pub second_grasps: Vec<(u32, f64)>,
    /// Outcomes of the first of them under aim errors.
    #[serde(default)]
    pub outcomes: Vec<GraspOutcomes>,
    /// Outcomes of grasps of the fallen second object under aim errors, by the name of its resting pose.
    #[serde(default)]
    pub fallen: BTreeMap<String, Vec<GraspOutcomes>>,
    /// Other first grasps, with the outcomes of second grasps after them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(alias = "others")]
    pub alternative_firsts: Vec<AlternativeFirstGrasp>,
    /// Grasps of this combination alone, which the repertoire lacks. Outcomes and verifications refer to them as to the
    /// repertoire's own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub variations: Vec<Grasp>,
    /// Second grasps after the planned first grasp, found and tried in drawn circumstances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "proof")]
    pub verification: Option<Verification>,
    /// Level of effort of the verification. 0 if there was none, or if it did not finish.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[serde(alias = "proven")]
    pub verification_level: u32,
    /// Third object and its grasps, as (number of the grasp, score in this combination), the planned grasp first.
    /// `None` if there are fewer objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub third: Option<(String, Vec<(u32, f64)>)>,
    /// Grasp pair of the same two objects in the same places, taken in the other order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reversed: Option<Box<GraspPair>>,
}

fn is_zero(level: &u32) -> bool {
    *level == 0
}

/// Another first grasp than the planned one, with the outcomes of second grasps after it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct AlternativeFirstGrasp {
    /// Number of the first grasp in its repertoire.
    pub first_grasp: u32,
    /// Outcomes of second grasps under aim errors.
    pub outcomes: Vec<GraspOutcomes>,
    /// Second grasps after it, found and tried in drawn circumstances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "proof")]
    pub verification: Option<Verification>,
}

/// Grasps that a grasp pair names.
#[derive(Debug, Clone)]
pub struct PlannedGrasps {
    pub first: Grasp,
    /// Second grasps: the planned one, then its alternatives. Empty for a single object.
    pub second_candidates: Vec<GraspCandidate>,
    /// Grasps of the third object in the same order. Empty if there are fewer objects.
    pub third_candidates: Vec<GraspCandidate>,
    /// Grasps of the second object in its fallen poses, with rollouts. Each names its pose as its object.
    pub fallen_candidates: Vec<GraspCandidate>,
    /// Other first grasps, each with the second grasps that have rollouts after it.
    pub alternative_firsts: Vec<GraspSequence>,
}

impl PlannedGrasps {
    /// Returns the planned grasp of each object, in the order in which they are taken.
    pub fn planned(&self) -> Vec<&Grasp> {
        let others =
            [&self.second_candidates, &self.third_candidates].into_iter().filter_map(|candidates| candidates.first());
        std::iter::once(&self.first).chain(others.map(|candidate| &candidate.grasp)).collect()
    }
}

/// Grasp pairs of a scenario.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct GraspPairTable {
    /// Format version.
    pub version: u32,
    /// Seed of the draw.
    pub seed: u64,
    /// Combinations for which nothing worked without noise, in the order of the draw.
    pub rejected: Vec<Vec<String>>,
    /// The combinations.
    #[serde(alias = "plans")]
    pub pairs: Vec<GraspPair>,
}

impl GraspPairTable {
    /// Reads a file of grasp pairs.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&ftac_platform::data::read_text(path)?, path)
    }

    /// Parses the text of a file of grasp pairs.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let plans: Self = serde_json::from_str(text).with_context(|| path.display().to_string())?;
        if plans.version != VERSION {
            bail!("{}: version: found {}, expected {VERSION}", path.display(), plans.version);
        }
        Ok(plans)
    }

    /// Returns the grasp pair of a combination, or `Some(None)` if it was rejected. Returns `None` if the combination
    /// is not in the table.
    pub fn for_combination(&self, combination: &Combination) -> Option<Option<&GraspPair>> {
        let planned = self.pairs.iter().find(|plan| plan.objects() == combination.objects).map(Some);
        planned.or_else(|| self.rejected.contains(&combination.objects).then_some(None))
    }

    /// Writes the file. It is written whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        let lines: Vec<String> = self.pairs.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        let rejected = serde_json::to_string(&self.rejected)?;
        let text = format!(
            "{{\"version\":{VERSION},\"seed\":{},\"rejected\":{rejected},\n\"pairs\":[\n{}\n]}}\n",
            self.seed,
            lines.join(",\n")
        );
        ftac_platform::file::write_atomically(path, text.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))
    }

    /// Runs `work` on every grasp pair in parallel. Shows a progress bar called `what` unless `quiet`.
    fn for_each_pair(
        &mut self,
        what: &str,
        quiet: bool,
        work: impl Fn(&mut GraspPair) -> Result<()> + Sync,
    ) -> Result<()> {
        let progress = progress::bar(self.pairs.len() as u64, what, quiet);
        self.pairs.par_iter_mut().try_for_each(|plan| {
            work(plan)?;
            progress.inc(1);
            Ok::<(), anyhow::Error>(())
        })?;
        progress.finish_and_clear();
        Ok(())
    }
}

impl GraspPair {
    /// Creates a pair of these objects with these grasps, before anything has been tried under errors.
    pub(crate) fn new([first, second]: [&str; 2], first_grasp: u32, second_grasps: Vec<(u32, f64)>) -> Self {
        Self {
            first: first.to_owned(),
            second: second.to_owned(),
            first_grasp,
            second_grasps,
            outcomes: Vec::new(),
            fallen: BTreeMap::new(),
            alternative_firsts: Vec::new(),
            variations: Vec::new(),
            verification: None,
            verification_level: 0,
            third: None,
            reversed: None,
        }
    }

    /// Returns the names of the objects, in the order in which they are taken.
    pub fn objects(&self) -> Vec<&str> {
        let third = self.third.iter().map(|(name, _)| name);
        let all = [&self.first, &self.second].into_iter().chain(third);
        all.map(String::as_str).filter(|name| !name.is_empty()).collect()
    }

    /// Returns the grasps of this combination alone that take an object with these digits, or with some of them.
    fn variations_for<'a>(&'a self, object: &'a str, digits: &'a [Digit]) -> impl Iterator<Item = &'a Grasp> {
        self.variations
            .iter()
            .filter(move |grasp| grasp.object == object && grasp.digits.iter().all(|digit| digits.contains(digit)))
    }

    /// Removes the variations with their outcomes, and the verifications.
    fn forget_variations(&mut self) {
        (self.verification, self.verification_level) = (None, 0);
        let gone: Vec<u32> = self.variations.drain(..).map(|grasp| grasp.id).collect();
        let known = |outcomes: &GraspOutcomes| !gone.contains(&outcomes.grasp);
        self.outcomes.retain(known);
        for other in &mut self.alternative_firsts {
            other.outcomes.retain(known);
            other.verification = None;
        }
    }

    /// Returns the grasps of `hand` behind the pair's numbers.
    pub fn grasps(&self, hand: &Hand, repertoire: &Repertoire) -> Result<PlannedGrasps> {
        let sets = digit_sets(hand, self.objects().len());
        let find = |object: &str, place: usize, id: u32| {
            repertoire
                .for_digits(object, &sets[place])
                .chain(self.variations_for(object, &sets[place]))
                .find(|grasp| grasp.id == id)
                .cloned()
                .with_context(|| format!("the grasp pair names grasp {id} of {object}, which the repertoire lacks"))
        };
        // The verification's draws may hold the first object less often than errors of aim alone suggest. The score is
        // then its share of holds, and the held pose is the mean over its draws.
        let first = |id: u32, proof: &Option<Verification>| {
            let first = find(&self.first, 0, id)?;
            let score = proof.as_ref().map_or(first.score, Verification::first_holds);
            let hold = proof.as_ref().and_then(|proof| proof.hold);
            let (held, held_spread) = hold.map_or((first.held, None), |hold| (Some(hold.mean), Some(hold.sigmas)));
            Ok::<_, anyhow::Error>(Grasp { score, held, held_sigmas: held_spread, ..first })
        };
        // Variations after another first grasp do not belong to the pair's own sequence.
        let own = self.variations.iter().filter(|grasp| was_tested(&self.outcomes, &self.verification, grasp.id));
        let named = self.second_grasps.iter().copied().chain(own.map(|grasp| (grasp.id, grasp.score)));
        let second = named
            .map(|(id, worth)| grasp_candidate(find(&self.second, 1, id)?, worth, &self.outcomes, &self.verification));
        let fallen = self.fallen.iter().flat_map(|(way, tried)| tried.iter().map(move |one| (way, tried, one.grasp)));
        let fallen = fallen.map(|(way, outcomes, id)| {
            let grasp = find(way, 1, id)?;
            let worth = grasp.score;
            grasp_candidate(grasp, worth, outcomes, &None)
        });
        // Outcomes after a single hold are not comparable with verifications after many holds.
        let others =
            self.alternative_firsts.iter().filter(|other| self.verification.is_none() || other.verification.is_some());
        let others = others.map(|other| {
            let verified =
                other.verification.iter().flat_map(|proof| proof.grasps.iter().map(|verified| verified.grasp));
            let numbers = match &other.verification {
                Some(_) => verified.collect(),
                None => other.outcomes.iter().map(|outcomes| outcomes.grasp).collect::<Vec<_>>(),
            };
            let second = numbers.into_iter().map(|id| {
                let grasp = find(&self.second, 1, id)?;
                let worth = grasp.score;
                grasp_candidate(grasp, worth, &other.outcomes, &other.verification)
            });
            Ok(GraspSequence {
                first: first(other.first_grasp, &other.verification)?,
                second_candidates: second.collect::<Result<_>>()?,
            })
        });
        let third = self.third.iter().flat_map(|(name, grasps)| grasps.iter().map(move |grasp| (name, grasp)));
        let third = third.map(|(name, (id, worth))| Ok(GraspCandidate::new(find(name, 2, *id)?, *worth)));
        Ok(PlannedGrasps {
            third_candidates: third.collect::<Result<_>>()?,
            alternative_firsts: others.collect::<Result<_>>()?,
            first: first(self.first_grasp, &self.verification)?,
            second_candidates: second.collect::<Result<_>>()?,
            fallen_candidates: fallen.collect::<Result<_>>()?,
        })
    }
}

/// True if the grasp was tried under errors.
fn was_tested(outcomes: &[GraspOutcomes], verification: &Option<Verification>, id: u32) -> bool {
    let verified =
        verification.iter().flat_map(|verification| &verification.grasps).any(|verified| verified.grasp == id);
    verified || outcomes.iter().any(|outcomes| outcomes.grasp == id)
}

/// Returns a grasp with its rollouts. If some grasps were verified, the rollouts of the others are too optimistic,
/// because they start from a single hold. They are then left out.
fn grasp_candidate(
    grasp: Grasp,
    score: f64,
    outcomes: &[GraspOutcomes],
    verification: &Option<Verification>,
) -> Result<GraspCandidate> {
    let rollouts = match verification {
        Some(verification) => verification.rollouts(&grasp)?,
        None => {
            let outcomes = outcomes.iter().find(|outcomes| outcomes.grasp == grasp.id);
            outcomes.map(|outcomes| outcomes.rollouts(&grasp)).transpose()?
        }
    };
    Ok(GraspCandidate { rollouts: rollouts.unwrap_or_default().into(), ..GraspCandidate::new(grasp, score) })
}

/// Plans combinations of `scenario`, drawn by `seed`, until there are `count` grasp pairs or all combinations have been
/// tried. `plan` returns `None` for a combination that cannot be done without noise. If the scenario has objects of a
/// user's own, the combinations with each of them come first, until one of them can be done. Shows a progress bar
/// unless `quiet`.
pub fn make_pairs(
    scenario: &Scenario,
    count: usize,
    seed: u64,
    quiet: bool,
    plan: impl Fn(&Combination) -> Result<Option<GraspPair>> + Sync,
) -> Result<GraspPairTable> {
    let bar = progress::bar(count as u64, "combinations planned", quiet);
    let mut drawn = DrawnCombinations {
        pairs: draw_combinations(scenario, usize::MAX, seed).collect(),
        results: BTreeMap::new(),
        decided: BTreeSet::new(),
        pairs_table: GraspPairTable { version: VERSION, seed, rejected: Vec::new(), pairs: Vec::new() },
        count,
    };
    for object in &scenario.object {
        let name = &object.name;
        let has = |plan: &GraspPair| plan.objects().contains(&name.as_str());
        let with = drawn.places(|drawn| drawn.objects.contains(name));
        for batch in with.chunks(rayon::current_num_threads().max(1)) {
            if drawn.is_full() || drawn.pairs_table.pairs.iter().any(has) {
                break;
            }
            drawn.plan_batch(batch, &plan)?;
            for place in batch {
                if !drawn.pairs_table.pairs.iter().any(has) {
                    drawn.decide(*place, &bar);
                }
            }
        }
    }
    let all = drawn.places(|_| true);
    for batch in all.chunks(8) {
        if drawn.is_full() {
            break;
        }
        drawn.plan_batch(batch, &plan)?;
        batch.iter().for_each(|place| drawn.decide(*place, &bar));
    }
    bar.finish_and_clear();
    Ok(drawn.pairs_table)
}

/// Combinations of a scenario in the order of the draw, with their grasp pairs so far.
struct DrawnCombinations {
    pairs: Vec<Combination>,
    /// Results of the combinations that were planned, by their place in the draw. Several are planned at once, and some
    /// in vain.
    results: BTreeMap<usize, Option<GraspPair>>,
    /// Places in the draw whose grasp pair or rejection is final.
    decided: BTreeSet<usize>,
    pairs_table: GraspPairTable,
    count: usize,
}

impl DrawnCombinations {
    fn is_full(&self) -> bool {
        self.pairs_table.pairs.len() >= self.count
    }

    fn places(&self, wanted: impl Fn(&Combination) -> bool) -> Vec<usize> {
        (0..self.pairs.len()).filter(|place| wanted(&self.pairs[*place])).collect()
    }

    /// Plans the combinations of `batch` that have not been planned yet.
    fn plan_batch(
        &mut self,
        batch: &[usize],
        plan: &(impl Fn(&Combination) -> Result<Option<GraspPair>> + Sync),
    ) -> Result<()> {
        let open: Vec<usize> = batch.iter().copied().filter(|place| !self.results.contains_key(place)).collect();
        let made: Vec<Result<Option<GraspPair>>> = open.par_iter().map(|place| plan(&self.pairs[*place])).collect();
        for (place, made) in open.into_iter().zip(made) {
            self.results.insert(place, made?);
        }
        Ok(())
    }

    /// Makes the grasp pair or rejection of `place` final, as long as more pairs are wanted.
    fn decide(&mut self, place: usize, bar: &ProgressBar) {
        if self.is_full() || !self.decided.insert(place) {
            return;
        }
        let pair = &self.pairs[place];
        match self.results.get(&place).cloned().flatten() {
            Some(plan) => {
                self.pairs_table.pairs.push(plan);
                bar.inc(1);
            }
            None => self.pairs_table.rejected.push(pair.objects.clone()),
        }
    }
}

/// Plans a combination, without outcomes. Returns `None` if nothing works without errors. `board` has cameras as in a
/// trial, because a tactile snapshot ends when its images have arrived.
pub fn plan_combination(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    combination: &Combination,
) -> Result<Option<GraspPair>> {
    match &combination.objects[..] {
        [only] => plan_single(world, repertoire, board, only),
        [first, second] => plan_pair(world, repertoire, board, [first, second]),
        [first, second, third] => triple::plan_triple(world, repertoire, board, [first, second, third]),
        objects => bail!("{}: found {} objects, expected one to three", objects.join(", "), objects.len()),
    }
}

/// Plans a single object: the first grasp in the repertoire's order that holds it to the end of the trial.
fn plan_single(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    name: &str,
) -> Result<Option<GraspPair>> {
    for grasp in repertoire.for_digits(name, &digit_sets(&world.cell.robot.hand, 1)[0]) {
        let grasps = [grasp];
        let Some((hold, _)) = roll_out_first(world, &FirstGraspRollout::ideal(world, &grasps), board)? else {
            continue;
        };
        if roll_out_carry(&hold)?.held {
            return Ok(Some(GraspPair::new([name, ""], grasp.id, Vec::new())));
        }
    }
    Ok(None)
}

/// Plans two objects.
fn plan_pair(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    board: &TactileBoard,
    [one, other]: [&str; 2],
) -> Result<Option<GraspPair>> {
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let seconds: Vec<&Grasp> = repertoire.for_digits(other, &sets[1]).collect();
    let Some(any) = seconds.first() else { return Ok(None) };
    for first in repertoire.for_digits(one, &sets[0]) {
        let grasps = [first, *any];
        let rollout = FirstGraspRollout::ideal(world, &grasps);
        let Some((hold, _)) = roll_out_first(world, &rollout, board)? else { continue };
        let works = |second: &Grasp| {
            let (collided, outcome) = roll_out_last(&hold, second)?;
            Ok(outcome.held && !collided)
        };
        let second_grasps = ranked(&seconds, works)?;
        if !second_grasps.is_empty() {
            return Ok(Some(GraspPair::new([one, other], first.id, second_grasps)));
        }
    }
    Ok(None)
}

/// Returns the grasps that work, then those that do not, each group in its own order, as (number, score). Empty if none
/// works.
fn ranked(grasps: &[&Grasp], works: impl Fn(&Grasp) -> Result<bool>) -> Result<Vec<(u32, f64)>> {
    let (mut worked, mut failed) = (Vec::new(), Vec::new());
    for grasp in grasps {
        if works(grasp)? {
            worked.push((grasp.id, grasp.score));
        } else {
            failed.push((grasp.id, FAILED_SCORE_FACTOR * grasp.score));
        }
    }
    if !worked.is_empty() {
        worked.append(&mut failed);
    }
    Ok(worked)
}

#[cfg(test)]
mod tests;
