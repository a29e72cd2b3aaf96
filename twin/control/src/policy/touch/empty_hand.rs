//! Takes an object with an empty hand, with the grasp that is worth most together with the grasps of the next object
//! that can follow.

use dexterous_grasping::Grasp;
use nalgebra::Vector3;
use world::attempt::Attempt;

use super::exploration::{explores, touched};
use super::{State, Touch, exploration};
use crate::collision::{Solid, clearance_along, hand_solids};
use crate::executor::{Executor, Target};
use crate::odds::Belief;
use crate::percept::Percept;
use crate::policy::reach::turned;
use crate::policy::{Knowledge, PolicyError, Step};
use crate::sensing::Senses;
use crate::strategy::{CLEAR, StrategyError, clear_stops, placed, promise};
use crate::trajectory::PosePath;
use crate::worth::{self, Candidate, SWITCH_GAIN};

/// Grasps of the first object, the planned one first. The worth of each is its expected success together with its best
/// second grasp.
pub(in crate::policy) fn candidates(knowledge: &Knowledge, senses: &Senses, planned: &Grasp) -> Vec<Candidate> {
    let uncertainty = knowledge.uncertainty.stated(knowledge.sighted[1]);
    let belief = touched().filter(|_| explores(knowledge, senses, uncertainty.target(1)));
    let belief = belief.unwrap_or_else(|| Belief::new(&uncertainty));
    // A trial of one object asks only for that object, whatever its grasp leaves free.
    let alone = knowledge.objects.len() == 1;
    let as_planned = if alone { 1.0 } else { promise(&knowledge.second, &belief) };
    // Rehearsals after a first grasp say more about it than the repertoire, which may lack it.
    let tried = knowledge.others.iter().map(|other| {
        let worth = other.first.score * promise(&other.second, &belief) / SWITCH_GAIN;
        Candidate::new(other.first.clone(), worth)
    });
    let unknown = if alone { as_planned } else { worth::UNREHEARSED * as_planned };
    let known = |id: u32| id == planned.id || knowledge.others.iter().any(|other| other.first.id == id);
    let untried = knowledge.repertoire.of(&knowledge.objects[0].name, &planned.digits);
    let untried = untried.filter(|first| !known(first.id));
    let untried = untried.map(|first| Candidate::new(first.clone(), first.score * unknown));
    std::iter::once(Candidate::new(planned.clone(), planned.score * as_planned)).chain(tried).chain(untried).collect()
}

impl Touch<'_> {
    /// The first grasp in use, as it was rehearsed, and the candidate second grasps after it.
    pub(super) fn following(&self, executor: &Executor) -> (&Grasp, &[Candidate]) {
        let present = executor.target(0).grasp.id;
        match self.knowledge.others.iter().find(|other| other.first.id == present) {
            Some(other) => (&other.first, &other.second),
            None => (&self.first[0].grasp, &self.knowledge.second),
        }
    }

    /// Worth of the best first grasp with rehearsed second grasps, except the `present` one.
    pub(super) fn otherwise(&self, present: u32) -> Option<f64> {
        let planned = self.first[0].grasp.id;
        let rehearsed = |id: u32| id == planned || self.knowledge.others.iter().any(|other| other.first.id == id);
        let others = self.first.iter().filter(|first| first.grasp.id != present && rehearsed(first.grasp.id));
        let worth = |first: &Candidate| first.worth * self.objects[0].trust(first.grasp.id);
        others.map(worth).max_by(f64::total_cmp)
    }

    /// Takes the first object at its seen or felt position.
    pub(super) fn take_with_empty_hand(&mut self, executor: &mut Executor) -> Result<Step, PolicyError> {
        let seen = executor.target(0).percept;
        let aim = if self.objects[0].located.is_some() { Vector3::zeros() } else { self.aim };
        let seen = Percept { position: seen.position + aim, ..seen };
        let candidates = self.within_reach(0, executor, &seen);
        let Some((grasp, path)) = self.best_approach(executor, candidates, &seen)? else {
            return Ok(self.give_up(0, &seen));
        };
        let why = self.story.reasons.last().cloned().unwrap_or_default();
        let attempt = Attempt { object: 0, grasp: grasp.id, why, ..Attempt::default() };
        if let Err(error) = executor.take(0, Target { grasp, percept: seen }) {
            self.story.reasons.push(error.to_string());
            return Ok(Step::GiveUp);
        }
        executor.redirect(path);
        self.state = State::Takes { object: 0, aimed: None };
        self.story.attempts.push(attempt);
        Ok(Step::Play)
    }

    /// Best of `candidates` that the arm can reach from its present pose without coming close to another object, with
    /// its path. If each comes close, the one that stays farthest away.
    fn best_approach(
        &self,
        executor: &Executor,
        mut candidates: Vec<Candidate>,
        seen: &Percept,
    ) -> Result<Option<(Grasp, PosePath)>, PolicyError> {
        candidates.sort_by(|a, b| b.worth.total_cmp(&a.worth));
        let hand = executor.motion().hand();
        let moving = hand_solids(hand, &exploration::empty(hand).joints, hand.digits(), true);
        let standing = self.solids.iter().zip(executor.targets()).skip(1);
        let standing: Vec<Solid> =
            standing.flat_map(|(solids, target)| placed(solids, &target.percept.pose())).collect();
        let all = [placed(&self.solids[0], &seen.pose()), standing.clone()].concat();
        let mut best: Option<(f64, Grasp, PosePath)> = None;
        for candidate in &candidates {
            for grasp in turned(&self.knowledge, &candidate.grasp, seen, &self.knowledge.objects[0]) {
                let path = |stops: &[_]| executor.path_to(stops, &grasp, seen);
                let (there, stops) = clear_stops(&moving, &all, executor.ways(), |stops| Ok(path(stops)?[0].clone()))?;
                let onto = clearance_along(&path(&stops)?[1], &moving, &standing, 2000).map_err(StrategyError::from)?;
                let clearance = onto.map_or(there, |onto| there.min(onto.min_distance));
                if best.as_ref().is_some_and(|(most, ..)| clearance <= *most) {
                    continue;
                }
                let Some(path) = executor.rehearsed_approach(&stops, &grasp, seen) else { continue };
                best = Some((clearance, grasp, path));
                if clearance > CLEAR {
                    return Ok(best.map(|(_, grasp, path)| (grasp, path)));
                }
            }
        }
        Ok(best.map(|(_, grasp, path)| (grasp, path)))
    }
}
