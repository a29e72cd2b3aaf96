//! Search for the grasps of the benchmark's repertoire.
//!
//! Random proposals are closed and held in physics. Those that hold are varied and tried again under errors, and the
//! repertoire keeps the grasps that held in the largest share of tries. First grasps meet errors as wide as a
//! controller of the benchmark's robot expects, because only the detector locates the object. Second grasps meet fewer
//! draws, because [`crate::grasp_pair::outcomes`] tries them again in each grasp pair.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use anyhow::{Context, Result};
use dexterous_grasping::repertoire::{Repertoire, VERSION};
use dexterous_grasping::sampler::{HandForm, ObjectExtent, propose, vary};
use dexterous_grasping::synthesis::tabletop::CarriedObject;
use dexterous_grasping::{Grasp, digit_sets};
use hand_model::Digit;
use indicatif::ProgressBar;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use scenarios::noise::TrialNoise;
use sim::tactile::TactileBoard;
use world::objects::{ObjectModel, Symmetry};

use crate::cache::SearchSteps;
use crate::proposals::{GraspProposals, carried_object};
use crate::rollout::{
    FirstGraspRollout, HoldOutcome, RolloutSnapshot, StartPosture, misaimed, roll_out_first, roll_out_last,
    verification_errors, wide_errors,
};
use crate::simulated_world::SimulatedWorld;

/// Number of wide draws under which a first grasp's robustness is measured, after a try without errors.
const WIDE_DRAWS: usize = 12;
/// Number of draws of the expected noise for a second grasp.
const EXPECTED_DRAWS: usize = 9;
/// Largest slip of a hold while it is watched, m. A hold that slips more counts as none.
const SLIP_LIMIT: f64 = 0.004;

/// Search effort for each object in each place.
///
/// An object that is taken with an empty hand comes in place 0, an object that is taken beside it in place 1.
#[derive(Debug, Clone, Copy)]
pub struct RepertoireEffort {
    /// Maximum number of random proposals. Fewer are tried if enough of them hold.
    pub proposals: u32,
    /// Maximum number of variations of proposals that held.
    pub variations: u32,
    /// Number of first grasps kept.
    pub keep_first: usize,
    /// Number of second grasps kept.
    pub keep_second: usize,
}

impl RepertoireEffort {
    /// Returns the maximum number of rollouts for an object in a place. Each grasp that is closed counts, and so does
    /// each try of it under an error.
    pub fn max_rollouts(&self, place: usize) -> u64 {
        let tries = 1 + error_count(place) as u64;
        let verified = self.max_tested(place) as u64 + MAX_CLIMBS as u64 * u64::from(BATCH_SIZE);
        u64::from(self.proposals + self.variations) + verified * tries
    }

    /// Returns the number of grasps kept of an object in a place.
    fn max_kept(&self, place: usize) -> usize {
        if place == 0 { self.keep_first } else { self.keep_second }
    }

    /// Returns the maximum number of grasps that are tried under errors before any climb.
    fn max_tested(&self, place: usize) -> usize {
        let keep = self.max_kept(place);
        (keep + keep / 2).max(MIN_HOLDING_GRASPS)
    }
}

/// Returns the number of error draws under which a grasp for a place is tried.
fn error_count(place: usize) -> usize {
    if place == 0 { WIDE_DRAWS } else { EXPECTED_DRAWS }
}

/// Objects, places and effort of a search.
#[derive(Debug, Clone, Copy)]
pub struct RepertoireRequest<'a> {
    /// Names of the objects.
    pub names: &'a [String],
    /// Places in which they come.
    pub places: &'a [usize],
    /// Effort for each object and place.
    pub effort: RepertoireEffort,
}

/// Returns the extent of an object, as the sampler needs it.
pub fn object_extent(object: &ObjectModel) -> ObjectExtent {
    let reach = |axis: Vector3<f64>| {
        let local = object.rest.inverse() * axis;
        object.shape.support(&local).coords.dot(&local)
    };
    ObjectExtent {
        name: object.name.clone(),
        half: Vector3::new(reach(Vector3::x()), reach(Vector3::y()), object.rest_height()),
        yaw_matters: !matches!(object.symmetry, Symmetry::Full),
    }
}

fn grasp_rng(seed: u64, object: &str, place: usize, id: u32) -> ChaCha8Rng {
    let mut hash = seed ^ 0x9e37_79b9_7f4a_7c15;
    for byte in object.bytes().chain([place as u8]).chain(id.to_le_bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    ChaCha8Rng::seed_from_u64(hash)
}

/// Search for grasps in a world.
struct RepertoireSearch<'a> {
    world: &'a SimulatedWorld,
    effort: RepertoireEffort,
    /// Digits that take the object in each place.
    sets: &'a [Vec<Digit>],
    /// Seed of all proposals.
    seed: u64,
    /// Blank, because grasps are verified without touch.
    board: TactileBoard,
    progress: &'a SearchProgress<'a>,
}

/// Progress of a running search: what is reported and kept of it.
pub struct SearchProgress<'a> {
    /// Runs to [`RepertoireEffort::max_rollouts`] for each object and place, or to less as soon as that is known.
    pub bar: &'a ProgressBar,
    /// Grasps that were tried before the search was interrupted, and those tried now.
    pub steps: &'a SearchSteps<Option<Grasp>>,
    /// Called once with the time of a rollout on this machine with all its threads, s.
    pub report_pace: &'a (dyn Fn(f64) + Sync),
}

impl SearchProgress<'_> {
    /// Returns the kept result of a grasp's trial, or runs the trial and keeps its result.
    fn try_or_recall(&self, name: &str, try_it: impl FnOnce() -> Result<Option<Grasp>>) -> Result<Option<Grasp>> {
        match self.steps.known(name) {
            Some(known) => Ok(known.clone()),
            None => {
                let tried = try_it()?;
                self.steps.keep(name, &tried)?;
                Ok(tried)
            }
        }
    }
}

/// Returns the name of the step that tries a grasp under this number of errors.
fn step_name(object: &str, place: usize, grasp: u32, errors: usize) -> String {
    format!("{object} {} {grasp} {errors}", ["First", "Second"][place.min(1)])
}

/// Returns the number of rollouts in the kept steps of a search.
pub fn kept_rollouts(steps: &SearchSteps<Option<Grasp>>) -> u64 {
    let errors = |name: &str| name.rsplit(' ').next().and_then(|errors| errors.parse::<u64>().ok()).unwrap_or(0);
    steps.names().map(|name| 1 + errors(name)).sum()
}

/// Fills `repertoire` with the `wanted` grasps, drawn by its seed. `found` is called with each object and place that is
/// done and with its digits.
pub fn fill_repertoire(
    world: &SimulatedWorld,
    wanted: &RepertoireRequest<'_>,
    repertoire: &mut Repertoire,
    progress: &SearchProgress<'_>,
    mut found: impl FnMut(&str, usize, &[Digit], &Repertoire) -> Result<()>,
) -> Result<()> {
    let RepertoireRequest { names, places, effort } = *wanted;
    repertoire.version = VERSION;
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let search =
        RepertoireSearch { world, effort, sets: &sets, seed: repertoire.seed, board: TactileBoard::blank(), progress };
    for (place, digits) in sets.iter().enumerate().filter(|(place, _)| places.contains(place)) {
        let reference = if place > 0 { reference_hold(world, names, repertoire)? } else { Vec::new() };
        for name in names {
            if progress.steps.names().next().is_none() {
                progress.bar.reset();
            }
            progress.bar.set_length(effort.max_rollouts(place));
            let grasps = if place == 0 { search.find_first(name)? } else { search.find_second(name, &reference)? };
            if let Some(list) = repertoire.grasps.get_mut(name) {
                list.retain(|grasp| grasp.digits != *digits);
            }
            for grasp in grasps {
                repertoire.insert(grasp);
            }
            found(name, place, digits, repertoire)?;
        }
    }
    Ok(())
}

impl RepertoireSearch<'_> {
    fn find_first(&self, name: &str) -> Result<Vec<Grasp>> {
        let object = self.world.object(name)?;
        let bystander = self.bystander(&object)?;
        let attempt = |grasp: &Grasp, noise: &TrialNoise| -> Result<Option<HoldOutcome>> {
            let outcome = self.roll_out_first(&[grasp, &bystander], noise)?;
            Ok(outcome.map(|(_, outcome)| outcome).filter(|outcome| outcome.slip < SLIP_LIMIT))
        };
        self.find(&object, 0, None, attempt)
    }

    fn find_second(&self, name: &str, reference: &[Grasp]) -> Result<Vec<Grasp>> {
        let object = self.world.object(name)?;
        let bystander = self.bystander(&object)?;
        // Hold of the reference object, with this object standing by.
        let mut hold: Option<RolloutSnapshot> = None;
        for first in reference {
            hold = self.roll_out_first(&[first, &bystander], &TrialNoise::none())?.map(|(snapshot, _)| snapshot);
            if hold.is_some() {
                break;
            }
        }
        let hold = &hold.context("no reference hold could be made")?;
        let held = self.world.object(&reference[0].object)?;
        let attempt = |grasp: &Grasp, noise: &TrialNoise| -> Result<Option<HoldOutcome>> {
            let (collided, outcome) = roll_out_last(hold, &misaimed(grasp, noise, 1))?;
            Ok((outcome.held && !collided && outcome.slip < 2.0 * SLIP_LIMIT).then_some(outcome))
        };
        self.find(&object, 1, Some(&carried_object(hold, &held)), attempt)
    }

    fn roll_out_first(&self, grasps: &[&Grasp], noise: &TrialNoise) -> Result<Option<(RolloutSnapshot, HoldOutcome)>> {
        let protocol = self.world.rollout_protocol();
        let rollout = FirstGraspRollout { protocol, start: StartPosture::Near, grasps, noise };
        roll_out_first(self.world, &rollout, &self.board)
    }

    /// Returns a grasp of the object that stands by. It is never closed.
    fn bystander(&self, object: &ObjectModel) -> Result<Grasp> {
        let form = HandForm::from_hand(&self.world.cell.robot.hand);
        let grasp =
            propose(&form, &object_extent(object), &self.sets[1], 0, &mut grasp_rng(self.seed, &object.name, 1, 0));
        grasp.with_context(|| self.missing_ranges_message(1))
    }

    fn missing_ranges_message(&self, place: usize) -> String {
        let (digits, hand) = (&self.sets[place], &self.world.cell.robot.hand.parameters.name);
        format!("{hand}: grasps.set: found no ranges like those of {digits:?}, expected a set of its own")
    }

    fn proposals<'o>(
        &'o self,
        object: &'o ObjectModel,
        place: usize,
        carried: Option<&CarriedObject>,
    ) -> Result<GraspProposals<'o>> {
        GraspProposals::new(&self.world.cell.robot.hand, object, &self.sets[place], carried, false)
    }

    /// Returns proposal number `id`. Even numbers are drawn from the hand's ranges, odd ones are synthesized.
    fn propose(&self, proposals: &GraspProposals, place: usize, id: u32) -> Result<Grasp> {
        let rng = &mut grasp_rng(self.seed, proposals.object(), place, id);
        let synthesized = if id % 2 == 1 { proposals.synthesized(id, rng) } else { None };
        synthesized.or_else(|| proposals.drawn(id, rng)).with_context(|| self.missing_ranges_message(place))
    }

    /// Tries proposals until enough hold, then variations of those if too few do. All that held are tried again under
    /// noise, and variations of the most robust grasps replace less robust ones.
    fn find(
        &self,
        object: &ObjectModel,
        place: usize,
        carried: Option<&CarriedObject>,
        attempt: impl Fn(&Grasp, &TrialNoise) -> Result<Option<HoldOutcome>> + Sync,
    ) -> Result<Vec<Grasp>> {
        let errors = &(if place == 0 { wide_errors } else { verification_errors })(error_count(place))[..];
        let RepertoireEffort { variations, .. } = self.effort;
        let keep = self.effort.max_kept(place);
        let SearchProgress { bar, report_pace: pace, .. } = self.progress;
        let measured = AtomicBool::new(false);
        let run = |grasps: Vec<Grasp>, errors: &[TrialNoise], failures: usize| -> Result<Vec<Grasp>> {
            let (begun, rollouts) = (Instant::now(), AtomicU64::new(0));
            let counted = |grasp: &Grasp, noise: &TrialNoise| {
                rollouts.fetch_add(1, Ordering::Relaxed);
                attempt(grasp, noise)
            };
            let one = |grasp: Grasp| {
                self.progress.try_or_recall(&step_name(&object.name, place, grasp.id, errors.len()), || {
                    let tried = verify_grasp(grasp, errors, failures, &counted);
                    bar.inc(1 + errors.len() as u64);
                    tried
                })
            };
            let verified: Vec<Result<Option<Grasp>>> = grasps.into_par_iter().map(one).collect();
            let rollouts = rollouts.into_inner();
            if rollouts >= u64::from(BATCH_SIZE) / 2 && !measured.swap(true, Ordering::Relaxed) {
                pace(begun.elapsed().as_secs_f64() / rollouts as f64);
            }
            verified.into_iter().filter_map(Result::transpose).collect()
        };
        let random = |id: u32| grasp_rng(self.seed, &object.name, place, id);
        let proposals = self.proposals(object, place, carried)?;
        let enough = self.effort.max_tested(place);
        let mut found: Vec<Grasp> = Vec::new();
        let mut id = 0;
        while id < self.effort.proposals && found.len() < enough {
            let ids: Vec<u32> = (id..id + BATCH_SIZE).collect();
            let batch = ids.into_par_iter().map(|id| self.propose(&proposals, place, id)).collect::<Result<_>>()?;
            found.extend(run(batch, &[], 0)?);
            id += BATCH_SIZE;
        }
        let parents = found.clone();
        let last = id + variations;
        while id < last && !parents.is_empty() && found.len() < enough {
            let vary_one = |id: u32| vary(&parents[id as usize % parents.len()], id, &mut random(id));
            found.extend(run((id..id + BATCH_SIZE).map(vary_one).collect(), &[], 0)?);
            id += BATCH_SIZE;
        }
        let chosen = keep_distinct(found, enough);
        // From here on, the maximum remaining work of the search is known.
        let tries = 1 + errors.len() as u64;
        bar.set_length(bar.position() + (chosen.len() as u64 + MAX_CLIMBS as u64 * u64::from(BATCH_SIZE)) * tries);
        let mut verified = run(chosen, errors, errors.len())?;
        sort_by_score(&mut verified);
        for _ in 0..MAX_CLIMBS {
            let parents: Vec<Grasp> = verified.iter().take(PARENT_COUNT).cloned().collect();
            if parents.is_empty() || parents.iter().all(|grasp| grasp.score >= ROBUST_SHARE) {
                break;
            }
            // A variation is useful if it is better than the worst of the parents.
            let worst = parents.iter().map(|grasp| grasp.score).fold(1.0, f64::min);
            let failures = ((1.0 - worst) * (1 + errors.len()) as f64).round() as usize;
            let vary_one = |id: u32| vary(&parents[id as usize % parents.len()], id, &mut random(id));
            verified.extend(run((id..id + BATCH_SIZE).map(vary_one).collect(), errors, failures.saturating_sub(1))?);
            sort_by_score(&mut verified);
            id += BATCH_SIZE;
        }
        Ok(keep_distinct(verified, keep))
    }
}

/// Minimum number of grasps that hold without errors and are tried under errors, if that many are found.
const MIN_HOLDING_GRASPS: usize = 16;
/// Maximum number of rounds of variation around the most robust grasps. They end once these hold in the share
/// [`ROBUST_SHARE`] of the tries.
const MAX_CLIMBS: usize = 4;
const ROBUST_SHARE: f64 = 0.9;
/// Batch size: grasps tried at once. The search stops between batches, so its result does not depend on the number of
/// threads.
const BATCH_SIZE: u32 = 16;
/// Number of grasps that a climb starts from.
const PARENT_COUNT: usize = 4;

/// Tries `grasp` without errors and, if that holds, under `errors`. Its score is the share of tries that held. Returns
/// `None` as soon as more than `failures` of them did not hold.
fn verify_grasp(
    grasp: Grasp,
    errors: &[TrialNoise],
    failures: usize,
    attempt: &impl Fn(&Grasp, &TrialNoise) -> Result<Option<HoldOutcome>>,
) -> Result<Option<Grasp>> {
    let Some(outcome) = attempt(&grasp, &TrialNoise::none())? else { return Ok(None) };
    let mut failed = 0;
    for noise in errors {
        failed += usize::from(attempt(&grasp, noise)?.is_none());
        if failed > failures {
            return Ok(None);
        }
    }
    let score = 1.0 - failed as f64 / (1 + errors.len()) as f64;
    let (held, held_joints) = (Some(outcome.palm_from_object), Some(outcome.joints));
    Ok(Some(Grasp { held, held_joints, score, ..grasp }))
}

fn sort_by_score(grasps: &mut [Grasp]) {
    grasps.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
}

/// Keeps the best grasp of each neighbourhood. Two grasps are the same if their object positions differ by less than 4
/// mm and their hand orientations by less than 0.1 rad.
fn keep_distinct(grasps: Vec<Grasp>, keep: usize) -> Vec<Grasp> {
    let mut kept: Vec<Grasp> = Vec::new();
    for grasp in grasps {
        let same = |other: &Grasp| {
            let apart = (Vector3::from(grasp.center) - Vector3::from(other.center)).norm();
            apart < 0.004 && grasp.palm_rotation(0.0).angle_to(&other.palm_rotation(0.0)) < 0.1
        };
        if kept.len() < keep && !kept.iter().any(same) {
            kept.push(grasp);
        }
    }
    kept
}

/// Returns the first grasps that hold the smallest graspable object. It occupies the first digits while second grasps
/// are verified.
pub fn reference_hold(world: &SimulatedWorld, names: &[String], repertoire: &Repertoire) -> Result<Vec<Grasp>> {
    let mut candidates: Vec<(f64, Vec<Grasp>)> = Vec::new();
    let first = &digit_sets(&world.cell.robot.hand, 2)[0];
    for name in names.iter().chain(repertoire.grasps.keys()) {
        let grasps: Vec<Grasp> = repertoire.for_digits(name, first).cloned().collect();
        if !grasps.is_empty() {
            candidates.push((world.object(name)?.shape.bounding_radius(), grasps));
        }
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(candidates.into_iter().next().context("no first grasp was found for any object")?.1)
}

#[cfg(test)]
mod tests;
