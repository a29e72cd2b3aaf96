//! Takes an object beside a held one, with the best grasp and aim given the felt pose of the first object in the hand.

use world::attempt::Attempt;

use super::{ExecutorActivity, MAX_POSE_SIGMA, TouchPolicy};
use crate::detection::DetectedObject;
use crate::executor::{Executor, GraspTarget};
use crate::extent::HeldExtent;
use crate::outcome_model::AimPosterior;
use crate::perception::ObjectEstimate;
use crate::policy::{DecisionRecord, FirstDecision, PolicyError, PolicyStep};
use crate::score::{GraspCandidate, SWITCH_GAIN};
use crate::strategy::{Assessment, Decision, DecisionContext, HeldObject, LookAhead, choose, collect_rollouts};

impl TouchPolicy<'_> {
    /// The held first object, as felt.
    pub(super) fn held<'h>(&'h self, executor: &'h Executor, felt: &ObjectEstimate) -> HeldObject<'h> {
        HeldObject {
            name: &self.knowledge.objects[0].name,
            solids: &self.solids[0],
            pose: felt.estimate.palm_from_object,
            joints: felt.estimate.q.to_vec(),
            digits: executor.target(0).grasp.digits.clone(),
            sigma: felt.estimate.sigma().0.min(MAX_POSE_SIGMA),
        }
    }

    /// Decides how to take an object beside the first one, and begins.
    pub(super) fn take_beside(&mut self, object: usize, executor: &mut Executor) -> Result<PolicyStep, PolicyError> {
        let seen = executor.target(object).detected;
        let mut within = self.reachable(object, executor, &seen);
        self.trace.decisions += 1;
        loop {
            let Some(felt) = self.felt.as_ref().filter(|_| !within.is_empty()) else {
                return Ok(self.give_up(object, &seen));
            };
            let decision = self.choose(object, executor, &within, felt)?;
            let declined = decision.chosen.held < decision.chosen.risk;
            self.trace.first_decision.get_or_insert_with(|| FirstDecision {
                planned: decision.planned,
                chosen: (!declined).then_some(decision.chosen),
            });
            self.trace.choice = Some(DecisionRecord::from_decision(&decision, declined));
            if declined {
                return self.handle_likely_contact(executor, &decision);
            }
            let attempt = attempt_record(object, &decision, felt);
            let beside = DetectedObject { position: seen.position + decision.aim, ..seen };
            self.trace.aimed |= self.first_detections.as_ref().is_none_or(|first_look| beside != first_look[object]);
            let Some(path) = executor.feasible_approach(&decision.via_poses, &decision.grasp, &beside) else {
                within.retain(|candidate| candidate.grasp.id != decision.grasp.id);
                continue;
            };
            self.trace.switched |= decision.switched;
            // A failure at an object that was located by touch gives no information on the error of the detector.
            let aimed = self.objects[object].touch_posterior.is_none().then_some(decision.aimed);
            executor.take(object, GraspTarget { grasp: decision.grasp, detected: beside })?;
            executor.redirect(path);
            self.activity = ExecutorActivity::Takes { object, aimed };
            self.trace.attempts.push(attempt);
            self.trace.record(decision.reason);
            return Ok(PolicyStep::Continue);
        }
    }

    /// Weights the rollouts of `candidates` by the likeness of their holds to the felt one.
    pub(super) fn reweighted_for_hold(
        &self,
        candidates: &[GraspCandidate],
        felt: &ObjectEstimate,
    ) -> Vec<GraspCandidate> {
        let extent = HeldExtent::from_shape(&self.knowledge.objects[0].shape, &felt.estimate.palm_from_object);
        candidates.iter().map(|candidate| candidate.reweighted_for_hold(&extent)).collect()
    }

    /// Chooses the grasp of an object, given the felt pose of the first.
    fn choose(
        &self,
        object: usize,
        executor: &Executor,
        candidates: &[GraspCandidate],
        felt: &ObjectEstimate,
    ) -> Result<Decision, PolicyError> {
        let tracked = &self.objects[object];
        let held = self.held(executor, felt);
        let (first, _) = self.second_candidates(executor);
        let candidates = self.reweighted_for_hold(candidates, felt);
        let uncertainty = tracked.uncertainty(&self.knowledge);
        let situation = DecisionContext {
            executor,
            hand: &self.knowledge.cell.robot.hand,
            held: &held,
            rollout_hold: first.held.zip(first.held_joints.as_deref()),
            target: &self.solids[object],
            target_sigma: tracked
                .touch_posterior
                .as_ref()
                .map_or(uncertainty.arm.hypot(uncertainty.detector), AimPosterior::sigma),
            all_rollouts: collect_rollouts(&candidates),
            aim_posterior: tracked.touch_posterior.as_ref().unwrap_or(&self.aim_posterior),
            detections: tracked.detections,
            probe: self.aim,
            look_ahead: self.knowledge.look_ahead.map(|foresees| LookAhead {
                settings: foresees,
                objects: &self.knowledge.objects,
                covariance: &felt.estimate.covariance,
            }),
        };
        choose(&situation, &candidates)?
            .ok_or_else(|| PolicyError::NoSecondGrasp(self.knowledge.objects[object].name.clone()))
    }

    /// Handles the case in which a contact is likelier than a hold. The first object is put down and taken with another
    /// grasp if that scores higher; otherwise the second object is left alone.
    fn handle_likely_contact(
        &mut self,
        executor: &mut Executor,
        decision: &Decision,
    ) -> Result<PolicyStep, PolicyError> {
        let Assessment { held, risk, score: utility, .. } = decision.chosen;
        let probabilities = format!("the best grasp holds with {held:.2}, contact {risk:.2}");
        let present = executor.target(0).grasp.id;
        let otherwise = self.best_alternative_score(present).filter(|worth| *worth > SWITCH_GAIN * utility);
        if otherwise.is_none() || self.is_late() || !self.knowledge.recovery.retry {
            self.trace.record(format!("declined: {probabilities}"));
            return Ok(PolicyStep::Decline);
        }
        self.trace.record(format!("{probabilities}: the first object is put down and taken otherwise"));
        self.trace.retries += 1;
        self.objects[0].count_failure(present);
        self.lay_down(executor)
    }
}

/// Record of a try at an object, as decided.
fn attempt_record(object: usize, decision: &Decision, felt: &ObjectEstimate) -> Attempt {
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
