//! Takes an object beside a held one, with the best grasp and aim given the felt pose of the first object in the hand.

use world::attempt::Attempt;

use super::{MOST_SIGMA, State, Touch};
use crate::executor::{Executor, Target};
use crate::extent::Extent;
use crate::odds::Belief;
use crate::percept::Percept;
use crate::perception::Felt;
use crate::policy::{Choice, FirstDecision, PolicyError, Step};
use crate::strategy::{Assessment, Decision, Foresight, Held, Situation, choose, rehearsals};
use crate::worth::{Candidate, SWITCH_GAIN};

impl Touch<'_> {
    /// The held first object, as felt.
    pub(super) fn held<'h>(&'h self, executor: &'h Executor, felt: &Felt) -> Held<'h> {
        Held {
            name: &self.knowledge.objects[0].name,
            solids: &self.solids[0],
            pose: felt.estimate.palm_from_object,
            joints: felt.estimate.q.to_vec(),
            digits: executor.target(0).grasp.digits.clone(),
            sigma: felt.estimate.sigma().0.min(MOST_SIGMA),
        }
    }

    /// Decides how to take an object beside the first one, and begins.
    pub(super) fn take_beside(&mut self, object: usize, executor: &mut Executor) -> Result<Step, PolicyError> {
        let seen = executor.target(object).percept;
        let mut within = self.within_reach(object, executor, &seen);
        self.story.decisions += 1;
        loop {
            let Some(felt) = self.felt.as_ref().filter(|_| !within.is_empty()) else {
                return Ok(self.give_up(object, &seen));
            };
            let decision = self.choose(object, executor, &within, felt)?;
            let declined = decision.chosen.held < decision.chosen.risk;
            self.story.first_decision.get_or_insert_with(|| FirstDecision {
                plan: decision.plan,
                chosen: (!declined).then_some(decision.chosen),
            });
            self.story.choice = Some(Choice::of(&decision, declined));
            if declined {
                return self.way_out(executor, &decision);
            }
            let attempt = attempt(object, &decision, felt);
            let beside = Percept { position: seen.position + decision.aim, ..seen };
            self.story.aimed |= self.seen.as_ref().is_none_or(|first_look| beside != first_look[object]);
            let Some(path) = executor.rehearsed_approach(&decision.way, &decision.grasp, &beside) else {
                within.retain(|candidate| candidate.grasp.id != decision.grasp.id);
                continue;
            };
            self.story.switched |= decision.switched;
            // A failure at an object that was located by touch teaches nothing about the error of the eyes.
            let aimed = self.objects[object].located.is_none().then_some(decision.aimed);
            executor.take(object, Target { grasp: decision.grasp, percept: beside })?;
            executor.redirect(path);
            self.state = State::Takes { object, aimed };
            self.story.attempts.push(attempt);
            self.story.tell(decision.reason);
            return Ok(Step::Play);
        }
    }

    /// Weights the rehearsals of `candidates` by the likeness of their holds to the felt one.
    pub(super) fn beside_felt(&self, candidates: &[Candidate], felt: &Felt) -> Vec<Candidate> {
        let extent = Extent::of(&self.knowledge.objects[0].shape, &felt.estimate.palm_from_object);
        candidates.iter().map(|candidate| candidate.beside(&extent)).collect()
    }

    /// Chooses the grasp of an object, given the felt pose of the first.
    fn choose(
        &self,
        object: usize,
        executor: &Executor,
        candidates: &[Candidate],
        felt: &Felt,
    ) -> Result<Decision, PolicyError> {
        let tracked = &self.objects[object];
        let held = self.held(executor, felt);
        let (first, _) = self.following(executor);
        let candidates = self.beside_felt(candidates, felt);
        let uncertainty = tracked.uncertainty(&self.knowledge);
        let situation = Situation {
            executor,
            hand: &self.knowledge.cell.robot.hand,
            held: &held,
            rehearsed: first.held.zip(first.held_joints.as_deref()),
            target: &self.solids[object],
            target_sigma: tracked.located.as_ref().map_or(uncertainty.arm.hypot(uncertainty.eyes), Belief::sigma),
            all: rehearsals(&candidates),
            belief: tracked.located.as_ref().unwrap_or(&self.belief),
            looks: tracked.looks,
            probe: self.aim,
            foresight: self.knowledge.foresees.map(|foresees| Foresight {
                foresees,
                objects: &self.knowledge.objects,
                covariance: &felt.estimate.covariance,
            }),
        };
        choose(&situation, &candidates)?.ok_or_else(|| PolicyError::NoPlan(self.knowledge.objects[object].name.clone()))
    }

    /// Handles the case in which a contact is likelier than a hold. The first object is put down and taken with another
    /// grasp if that promises more; otherwise the second object is left alone.
    fn way_out(&mut self, executor: &mut Executor, decision: &Decision) -> Result<Step, PolicyError> {
        let Assessment { held, risk, utility, .. } = decision.chosen;
        let odds = format!("the best grasp holds with {held:.2} and touches with {risk:.2}");
        let present = executor.target(0).grasp.id;
        let otherwise = self.otherwise(present).filter(|worth| *worth > SWITCH_GAIN * utility);
        if otherwise.is_none() || self.is_late() || !self.knowledge.recovery.retry {
            self.story.tell(format!("declined: {odds}"));
            return Ok(Step::Decline);
        }
        self.story.tell(format!("{odds}: the first object is put down and taken otherwise"));
        self.story.retries += 1;
        self.objects[0].failed(present);
        self.lay_down(executor)
    }
}

/// Record of a try at an object, as decided.
fn attempt(object: usize, decision: &Decision, felt: &Felt) -> Attempt {
    let (pose, covariance) = (felt.estimate.palm_from_object, &felt.estimate.covariance);
    let (at, turn) = (pose.translation.vector, pose.rotation.scaled_axis());
    Attempt {
        object,
        grasp: decision.grasp.id,
        why: decision.reason.clone(),
        clearance: Some(decision.chosen.clearance),
        risk: Some(decision.chosen.risk),
        felt: Some([at.x, at.y, at.z, turn.x, turn.y, turn.z]),
        covariance: Some(std::array::from_fn(|n| covariance[(n / 6, n % 6)])),
    }
}
