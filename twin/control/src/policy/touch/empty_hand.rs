//! Takes an object with an empty hand, with the grasp that has the highest score together with the grasps of the next
//! object that can follow.

use dexterous_grasping::Grasp;
use nalgebra::Vector3;
use world::attempt::Attempt;

use super::exploration::{should_palpate, touch_posterior};
use super::{ExecutorActivity, TouchPolicy, exploration};
use crate::collision::{Solid, clearance_along, hand_solids};
use crate::detection::DetectedObject;
use crate::executor::{Executor, GraspTarget};
use crate::outcome_model::AimPosterior;
use crate::policy::reach::yaw_variants;
use crate::policy::{Knowledge, PolicyError, PolicyStep};
use crate::score::{self, GraspCandidate, SWITCH_GAIN};
use crate::sensing::TouchPerception;
use crate::strategy::{PALPATION_CLEARANCE, StrategyError, best_candidate_score, clear_via_poses, transformed};
use crate::trajectory::PosePath;

/// Grasps of the first object, the planned one first. The score of each is its expected success together with its best
/// second grasp.
pub(in crate::policy) fn candidates(
    knowledge: &Knowledge,
    senses: &TouchPerception,
    planned: &Grasp,
) -> Vec<GraspCandidate> {
    let uncertainty = knowledge.uncertainty.with_detector_sigma(knowledge.first_detection_sigmas[1]);
    let posterior = touch_posterior().filter(|_| should_palpate(knowledge, senses, uncertainty.aim_sigma(1)));
    let posterior = posterior.unwrap_or_else(|| AimPosterior::new(&uncertainty));
    // A trial of one object needs only that object, whatever digits its grasp leaves free.
    let alone = knowledge.objects.len() == 1;
    let as_planned = if alone { 1.0 } else { best_candidate_score(&knowledge.second_candidates, &posterior) };
    // Rollouts after a first grasp carry more information on it than the repertoire, which may lack it.
    let tried = knowledge.alternative_firsts.iter().map(|other| {
        let score = other.first.score * best_candidate_score(&other.second_candidates, &posterior) / SWITCH_GAIN;
        GraspCandidate::new(other.first.clone(), score)
    });
    let unknown = if alone { as_planned } else { score::NO_ROLLOUT_FACTOR * as_planned };
    let known = |id: u32| id == planned.id || knowledge.alternative_firsts.iter().any(|other| other.first.id == id);
    let untried = knowledge.repertoire.for_digits(&knowledge.objects[0].name, &planned.digits);
    let untried = untried.filter(|first| !known(first.id));
    let untried = untried.map(|first| GraspCandidate::new(first.clone(), first.score * unknown));
    std::iter::once(GraspCandidate::new(planned.clone(), planned.score * as_planned))
        .chain(tried)
        .chain(untried)
        .collect()
}

impl TouchPolicy<'_> {
    /// The first grasp in use, as it was rolled out, and the candidate second grasps after it.
    pub(super) fn second_candidates(&self, executor: &Executor) -> (&Grasp, &[GraspCandidate]) {
        let present = executor.target(0).grasp.id;
        match self.knowledge.alternative_firsts.iter().find(|other| other.first.id == present) {
            Some(other) => (&other.first, &other.second_candidates),
            None => (&self.first[0].grasp, &self.knowledge.second_candidates),
        }
    }

    /// Score of the best first grasp with rollouts of second grasps, except the `present` one.
    pub(super) fn best_alternative_score(&self, present: u32) -> Option<f64> {
        let planned = self.first[0].grasp.id;
        let rollouts =
            |id: u32| id == planned || self.knowledge.alternative_firsts.iter().any(|other| other.first.id == id);
        let others = self.first.iter().filter(|first| first.grasp.id != present && rollouts(first.grasp.id));
        let score = |first: &GraspCandidate| first.score * self.objects[0].failure_factor(first.grasp.id);
        others.map(score).max_by(f64::total_cmp)
    }

    /// Takes the first object at its detected or felt position.
    pub(super) fn take_with_empty_hand(&mut self, executor: &mut Executor) -> Result<PolicyStep, PolicyError> {
        let seen = executor.target(0).detected;
        let aim = if self.objects[0].touch_posterior.is_some() { Vector3::zeros() } else { self.aim };
        let seen = DetectedObject { position: seen.position + aim, ..seen };
        let candidates = self.reachable(0, executor, &seen);
        let Some((grasp, path)) = self.best_approach(executor, candidates, &seen)? else {
            return Ok(self.give_up(0, &seen));
        };
        let why = self.trace.reasons.last().cloned().unwrap_or_default();
        let attempt = Attempt { object: 0, grasp: grasp.id, why, ..Attempt::default() };
        if let Err(error) = executor.take(0, GraspTarget { grasp, detected: seen }) {
            self.trace.reasons.push(error.to_string());
            return Ok(PolicyStep::GiveUp);
        }
        executor.redirect(path);
        self.activity = ExecutorActivity::Takes { object: 0, aimed: None };
        self.trace.attempts.push(attempt);
        Ok(PolicyStep::Continue)
    }

    /// Best of `candidates` that the arm can reach from its present pose without coming close to another object, with
    /// its path. If each comes close, the one that stays farthest away.
    fn best_approach(
        &self,
        executor: &Executor,
        mut candidates: Vec<GraspCandidate>,
        seen: &DetectedObject,
    ) -> Result<Option<(Grasp, PosePath)>, PolicyError> {
        candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
        let hand = executor.motion().hand();
        let moving = hand_solids(hand, &exploration::empty_hand(hand).joints, hand.digits(), true);
        let standing = self.solids.iter().zip(executor.targets()).skip(1);
        let standing: Vec<Solid> =
            standing.flat_map(|(solids, target)| transformed(solids, &target.detected.pose())).collect();
        let all = [transformed(&self.solids[0], &seen.pose()), standing.clone()].concat();
        let mut best: Option<(f64, Grasp, PosePath)> = None;
        for candidate in &candidates {
            for grasp in yaw_variants(&self.knowledge, &candidate.grasp, seen, &self.knowledge.objects[0]) {
                let path = |stops: &[_]| executor.path_to(stops, &grasp, seen);
                let (there, stops) =
                    clear_via_poses(&moving, &all, executor.approach_paths(), |stops| Ok(path(stops)?[0].clone()))?;
                let onto = clearance_along(&path(&stops)?[1], &moving, &standing, 2000).map_err(StrategyError::from)?;
                let clearance = onto.map_or(there, |onto| there.min(onto.min_distance));
                if best.as_ref().is_some_and(|(most, ..)| clearance <= *most) {
                    continue;
                }
                let Some(path) = executor.feasible_approach(&stops, &grasp, seen) else { continue };
                best = Some((clearance, grasp, path));
                if clearance > PALPATION_CLEARANCE {
                    return Ok(best.map(|(_, grasp, path)| (grasp, path)));
                }
            }
        }
        Ok(best.map(|(_, grasp, path)| (grasp, path)))
    }
}
