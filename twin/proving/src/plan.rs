//! Plans: for each combination a first grasp and the second grasps that may follow it, rehearsed without noise; for a single object the grasp that
//! holds it to the end of the trial.
//!
//! All combinations of the scenario's objects are shuffled by the seed and rehearsed in that order. A pair becomes a combination
//! if some first grasp can be followed by some second grasp without a collision; otherwise it is listed as rejected and the next
//! pair takes its place. What blind and touch achieve has no part in it.
//!
//! The plan is made as in the paper, without any disturbance: the first grasp of the repertoire's order that holds its object, and
//! after it the first second grasp of the repertoire's order that works. The other second grasps are alternatives. [`outcomes`] tries
//! the plan and the first of the alternatives under errors, for the odds that a policy goes by; where all of them are poor, also
//! second grasps after other first grasps, and [`other_order`] plans the two objects the other way round.

pub mod holds;
mod odds;
pub mod other_order;
pub mod outcomes;
pub mod proof;
pub mod stepwise;
pub mod triple;
pub mod variations;
pub mod without;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, bail};
use control::worth::{Candidate, Sequence};
use grasping::{Grasp, Repertoire, digit_sets};
use hand_model::{Digit, Hand};
use indicatif::ProgressBar;
use rayon::prelude::*;
use scenarios::Scenario;
use scenarios::combination::{Combination, draw_combinations};
use serde::{Deserialize, Serialize};
use sim::tactile::TactileBoard;

use crate::rehearsal::{FirstRehearsal, rehearse_carry, rehearse_first, rehearse_last};
use crate::simulated_world::World;

pub use self::outcomes::Outcomes;
use self::proof::Proof;

/// Format version of plan files.
const VERSION: u32 = 1;
/// What a grasp that failed in this pair's rehearsal is still worth, as a share of its general score.
const FAILED_WORTH: f64 = 0.3;

/// One combination's plan.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plan {
    /// First object.
    pub first: String,
    /// Second object; empty where there is none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub second: String,
    /// Number of the first grasp in its repertoire.
    pub first_grasp: u32,
    /// (number of the second grasp, worth in this combination), the plan first.
    pub second_grasps: Vec<(u32, f64)>,
    /// How the first of them went under errors of their aim.
    #[serde(default)]
    pub outcomes: Vec<Outcomes>,
    /// The same of grasps of the second object where it fell over, by the name of the way in which it lies.
    #[serde(default)]
    pub fallen: BTreeMap<String, Vec<Outcomes>>,
    /// The same after other first grasps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Other>,
    /// Grasps of this combination alone, which the repertoire lacks; outcomes and proofs name them like its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub variations: Vec<Grasp>,
    /// Second grasps after the plan's first one that were found and tried in drawn circumstances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<Proof>,
    /// Level of the effort with which proofs were looked for; 0 where they were not, or not to the end.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub proven: u32,
    /// Third object, and (number of the grasp, worth in this combination), the plan first; none where there are fewer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub third: Option<(String, Vec<(u32, f64)>)>,
    /// The plan of the same two objects in the same places, taken in the other order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reversed: Option<Box<Plan>>,
}

fn is_zero(level: &u32) -> bool {
    *level == 0
}

/// Another way to take the first object than the plan's, and how second grasps went after it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Other {
    /// Number of the first grasp in its repertoire.
    pub first_grasp: u32,
    /// How second grasps went under errors of their aim.
    pub outcomes: Vec<Outcomes>,
    /// Those after it that were found and tried in drawn circumstances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<Proof>,
}

/// The grasps that a plan names.
#[derive(Debug, Clone)]
pub struct PlannedGrasps {
    pub first: Grasp,
    /// The plan, then its alternatives; none for a single object.
    pub second: Vec<Candidate>,
    /// The same of the third object; none where there are fewer.
    pub third: Vec<Candidate>,
    /// Rehearsed grasps of the second object in the ways in which it can fall over: each names its way as its object.
    pub fallen: Vec<Candidate>,
    /// Other first grasps, with the second grasps rehearsed after each.
    pub others: Vec<Sequence>,
}

impl PlannedGrasps {
    /// The planned grasp of each object, in the order in which they are taken.
    pub fn planned(&self) -> Vec<&Grasp> {
        let others = [&self.second, &self.third].into_iter().filter_map(|candidates| candidates.first());
        std::iter::once(&self.first).chain(others.map(|candidate| &candidate.grasp)).collect()
    }
}

/// All plans of a scenario.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plans {
    /// Format version.
    pub version: u32,
    /// Seed of the draw.
    pub seed: u64,
    /// Combinations for which nothing worked without noise, in the order in which they were drawn.
    pub rejected: Vec<Vec<String>>,
    /// The combinations.
    pub plans: Vec<Plan>,
}

impl Plans {
    /// Reads a plan file.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&platform::data::read_text(path)?, path)
    }

    /// Parses a plan file's text.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let plans: Self = serde_json::from_str(text).with_context(|| path.display().to_string())?;
        if plans.version != VERSION {
            bail!("{}: version: found {}, expected {VERSION}", path.display(), plans.version);
        }
        Ok(plans)
    }

    /// What these plans say of a combination: its plan, or that it cannot be done; none where they say nothing of it.
    pub fn of(&self, combination: &Combination) -> Option<Option<&Plan>> {
        let planned = self.plans.iter().find(|plan| plan.objects() == combination.objects).map(Some);
        planned.or_else(|| self.rejected.contains(&combination.objects).then_some(None))
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        let lines: Vec<String> = self.plans.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
        let rejected = serde_json::to_string(&self.rejected)?;
        let text = format!(
            "{{\"version\":{VERSION},\"seed\":{},\"rejected\":{rejected},\n\"plans\":[\n{}\n]}}\n",
            self.seed,
            lines.join(",\n")
        );
        platform::file::write_whole(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Does `work` on every plan, in parallel; shows a progress bar called `what` unless `quiet`.
    fn try_each(&mut self, what: &str, quiet: bool, work: impl Fn(&mut Plan) -> Result<()> + Sync) -> Result<()> {
        let progress = progress::bar(self.plans.len() as u64, what, quiet);
        self.plans.par_iter_mut().try_for_each(|plan| {
            work(plan)?;
            progress.inc(1);
            Ok::<(), anyhow::Error>(())
        })?;
        progress.finish_and_clear();
        Ok(())
    }
}

impl Plan {
    /// Of these objects with these grasps, nothing of which has been tried under errors.
    pub(crate) fn new([first, second]: [&str; 2], first_grasp: u32, second_grasps: Vec<(u32, f64)>) -> Self {
        Self {
            first: first.to_owned(),
            second: second.to_owned(),
            first_grasp,
            second_grasps,
            outcomes: Vec::new(),
            fallen: BTreeMap::new(),
            others: Vec::new(),
            variations: Vec::new(),
            proof: None,
            proven: 0,
            third: None,
            reversed: None,
        }
    }

    /// Names of the objects, in the order in which they are taken.
    pub fn objects(&self) -> Vec<&str> {
        let third = self.third.iter().map(|(name, _)| name);
        let all = [&self.first, &self.second].into_iter().chain(third);
        all.map(String::as_str).filter(|name| !name.is_empty()).collect()
    }

    /// Grasps of this combination alone that take an object with these digits, or with some of them.
    fn varied<'a>(&'a self, object: &'a str, digits: &'a [Digit]) -> impl Iterator<Item = &'a Grasp> {
        self.variations
            .iter()
            .filter(move |grasp| grasp.object == object && grasp.digits.iter().all(|digit| digits.contains(digit)))
    }

    /// Leaves out the variations with their outcomes, and the proof.
    fn forget_variations(&mut self) {
        (self.proof, self.proven) = (None, 0);
        let gone: Vec<u32> = self.variations.drain(..).map(|grasp| grasp.id).collect();
        let known = |outcomes: &Outcomes| !gone.contains(&outcomes.grasp);
        self.outcomes.retain(known);
        for other in &mut self.others {
            other.outcomes.retain(known);
            other.proof = None;
        }
    }

    /// The grasps of `hand` behind the numbers.
    pub fn grasps(&self, hand: &Hand, repertoire: &Repertoire) -> Result<PlannedGrasps> {
        let sets = digit_sets(hand, self.objects().len());
        let find = |object: &str, place: usize, id: u32| {
            repertoire
                .of(object, &sets[place])
                .chain(self.varied(object, &sets[place]))
                .find(|grasp| grasp.id == id)
                .cloned()
                .with_context(|| format!("the plan names grasp {id} of {object}, which the repertoire lacks"))
        };
        // A grasp that holds the first object in fewer draws than errors of aim alone say is worth that share, and has it where those draws have it.
        let first = |id: u32, proof: &Option<Proof>| {
            let first = find(&self.first, 0, id)?;
            let score = proof.as_ref().map_or(first.score, Proof::first_holds);
            let hold = proof.as_ref().and_then(|proof| proof.hold);
            let (held, held_spread) = hold.map_or((first.held, None), |hold| (Some(hold.mean), Some(hold.spread)));
            Ok::<_, anyhow::Error>(Grasp { score, held, held_spread, ..first })
        };
        // A variation after another first grasp is none of the plan's.
        let own = self.variations.iter().filter(|grasp| tried(&self.outcomes, &self.proof, grasp.id));
        let named = self.second_grasps.iter().copied().chain(own.map(|grasp| (grasp.id, grasp.score)));
        let second = named.map(|(id, worth)| candidate(find(&self.second, 1, id)?, worth, &self.outcomes, &self.proof));
        let fallen = self.fallen.iter().flat_map(|(way, tried)| tried.iter().map(move |one| (way, tried, one.grasp)));
        let fallen = fallen.map(|(way, outcomes, id)| {
            let grasp = find(way, 1, id)?;
            let worth = grasp.score;
            candidate(grasp, worth, outcomes, &None)
        });
        // What was tried after one hold alone does not compare with what was proven after many.
        let others = self.others.iter().filter(|other| self.proof.is_none() || other.proof.is_some());
        let others = others.map(|other| {
            let proven = other.proof.iter().flat_map(|proof| proof.grasps.iter().map(|proven| proven.grasp));
            let numbers = match &other.proof {
                Some(_) => proven.collect(),
                None => other.outcomes.iter().map(|outcomes| outcomes.grasp).collect::<Vec<_>>(),
            };
            let second = numbers.into_iter().map(|id| {
                let grasp = find(&self.second, 1, id)?;
                let worth = grasp.score;
                candidate(grasp, worth, &other.outcomes, &other.proof)
            });
            Ok(Sequence { first: first(other.first_grasp, &other.proof)?, second: second.collect::<Result<_>>()? })
        });
        let third = self.third.iter().flat_map(|(name, grasps)| grasps.iter().map(move |grasp| (name, grasp)));
        let third = third.map(|(name, (id, worth))| Ok(Candidate::new(find(name, 2, *id)?, *worth)));
        Ok(PlannedGrasps {
            third: third.collect::<Result<_>>()?,
            others: others.collect::<Result<_>>()?,
            first: first(self.first_grasp, &self.proof)?,
            second: second.collect::<Result<_>>()?,
            fallen: fallen.collect::<Result<_>>()?,
        })
    }
}

/// True of a grasp that was tried under errors.
fn tried(outcomes: &[Outcomes], proof: &Option<Proof>, id: u32) -> bool {
    let proven = proof.iter().flat_map(|proof| &proof.grasps).any(|proven| proven.grasp == id);
    proven || outcomes.iter().any(|outcomes| outcomes.grasp == id)
}

/// A grasp with its rehearsals. Where some were proven, those of the others say too much: they come from one hold alone, and are left out.
fn candidate(grasp: Grasp, worth: f64, outcomes: &[Outcomes], proof: &Option<Proof>) -> Result<Candidate> {
    let rehearsed = match proof {
        Some(proof) => proof.rehearsed(&grasp)?,
        None => {
            let outcomes = outcomes.iter().find(|outcomes| outcomes.grasp == grasp.id);
            outcomes.map(|outcomes| outcomes.rehearsed(&grasp)).transpose()?
        }
    };
    Ok(Candidate { rehearsed: rehearsed.unwrap_or_default().into(), ..Candidate::new(grasp, worth) })
}

/// Plans combinations of `scenario`, drawn by `seed`, until `count` stand, or all have been tried; `plan` gives none of one
/// that cannot be done without noise. Where the scenario has objects of a user's own, those with each of them come first, until one of them
/// can be done. Shows a progress bar unless `quiet`.
pub fn make_plans(
    scenario: &Scenario,
    count: usize,
    seed: u64,
    quiet: bool,
    plan: impl Fn(&Combination) -> Result<Option<Plan>> + Sync,
) -> Result<Plans> {
    let bar = progress::bar(count as u64, "combinations planned", quiet);
    let mut drawn = Drawn {
        pairs: draw_combinations(scenario, usize::MAX, seed).collect(),
        made: BTreeMap::new(),
        taken: BTreeSet::new(),
        plans: Plans { version: VERSION, seed, rejected: Vec::new(), plans: Vec::new() },
        count,
    };
    for object in &scenario.object {
        let name = &object.name;
        let has = |plan: &Plan| plan.objects().contains(&name.as_str());
        let with = drawn.places(|drawn| drawn.objects.contains(name));
        for batch in with.chunks(rayon::current_num_threads().max(1)) {
            if drawn.is_full() || drawn.plans.plans.iter().any(has) {
                break;
            }
            drawn.make(batch, &plan)?;
            for place in batch {
                if !drawn.plans.plans.iter().any(has) {
                    drawn.take(*place, &bar);
                }
            }
        }
    }
    let all = drawn.places(|_| true);
    for batch in all.chunks(8) {
        if drawn.is_full() {
            break;
        }
        drawn.make(batch, &plan)?;
        batch.iter().for_each(|place| drawn.take(*place, &bar));
    }
    bar.finish_and_clear();
    Ok(drawn.plans)
}

/// The combinations of a scenario in the order in which they are drawn, and what has come of them.
struct Drawn {
    pairs: Vec<Combination>,
    /// What came of those that were planned, by their place; several are planned at once, and some in vain.
    made: BTreeMap<usize, Option<Plan>>,
    /// Places whose plan or rejection stands.
    taken: BTreeSet<usize>,
    plans: Plans,
    count: usize,
}

impl Drawn {
    fn is_full(&self) -> bool {
        self.plans.plans.len() >= self.count
    }

    fn places(&self, wanted: impl Fn(&Combination) -> bool) -> Vec<usize> {
        (0..self.pairs.len()).filter(|place| wanted(&self.pairs[*place])).collect()
    }

    /// Plans those that have not been.
    fn make(&mut self, batch: &[usize], plan: &(impl Fn(&Combination) -> Result<Option<Plan>> + Sync)) -> Result<()> {
        let open: Vec<usize> = batch.iter().copied().filter(|place| !self.made.contains_key(place)).collect();
        let made: Vec<Result<Option<Plan>>> = open.par_iter().map(|place| plan(&self.pairs[*place])).collect();
        for (place, made) in open.into_iter().zip(made) {
            self.made.insert(place, made?);
        }
        Ok(())
    }

    /// Lets a plan or a rejection stand, as long as plans are wanted.
    fn take(&mut self, place: usize, bar: &ProgressBar) {
        if self.is_full() || !self.taken.insert(place) {
            return;
        }
        let pair = &self.pairs[place];
        match self.made.get(&place).cloned().flatten() {
            Some(plan) => {
                self.plans.plans.push(plan);
                bar.inc(1);
            }
            None => self.plans.rejected.push(pair.objects.clone()),
        }
    }
}

/// The plan of a combination, without odds; none if nothing works without errors. `board` has cameras, as in a trial: a look ends when its
/// images have come.
pub fn plan_one(
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    combination: &Combination,
) -> Result<Option<Plan>> {
    match &combination.objects[..] {
        [only] => plan_single(world, repertoire, board, only),
        [first, second] => plan_pair(world, repertoire, board, [first, second]),
        [first, second, third] => triple::plan(world, repertoire, board, [first, second, third]),
        objects => bail!("{}: found {} objects, expected one to three", objects.join(", "), objects.len()),
    }
}

/// The plan of an object alone: the first grasp of the repertoire's order that holds it to the end of the trial.
fn plan_single(world: &World, repertoire: &Repertoire, board: &TactileBoard, name: &str) -> Result<Option<Plan>> {
    for grasp in repertoire.of(name, &digit_sets(&world.cell.robot.hand, 1)[0]) {
        let grasps = [grasp];
        let Some((hold, _)) = rehearse_first(world, &FirstRehearsal::ideal(world, &grasps), board)? else { continue };
        if rehearse_carry(&hold)?.held {
            return Ok(Some(Plan::new([name, ""], grasp.id, Vec::new())));
        }
    }
    Ok(None)
}

/// The plan of two objects.
fn plan_pair(
    world: &World,
    repertoire: &Repertoire,
    board: &TactileBoard,
    [one, other]: [&str; 2],
) -> Result<Option<Plan>> {
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let seconds: Vec<&Grasp> = repertoire.of(other, &sets[1]).collect();
    let Some(any) = seconds.first() else { return Ok(None) };
    for first in repertoire.of(one, &sets[0]) {
        let grasps = [first, *any];
        let rehearsal = FirstRehearsal::ideal(world, &grasps);
        let Some((hold, _)) = rehearse_first(world, &rehearsal, board)? else { continue };
        let works = |second: &Grasp| {
            let (collided, outcome) = rehearse_last(&hold, second)?;
            Ok(outcome.held && !collided)
        };
        let second_grasps = ranked(&seconds, works)?;
        if !second_grasps.is_empty() {
            return Ok(Some(Plan::new([one, other], first.id, second_grasps)));
        }
    }
    Ok(None)
}

/// The grasps that work, then those that do not, each in their own order: (number, worth). Empty if none works.
fn ranked(grasps: &[&Grasp], works: impl Fn(&Grasp) -> Result<bool>) -> Result<Vec<(u32, f64)>> {
    let (mut worked, mut failed) = (Vec::new(), Vec::new());
    for grasp in grasps {
        if works(grasp)? {
            worked.push((grasp.id, grasp.score));
        } else {
            failed.push((grasp.id, FAILED_WORTH * grasp.score));
        }
    }
    if !worked.is_empty() {
        worked.append(&mut failed);
    }
    Ok(worked)
}

#[cfg(test)]
mod tests;
