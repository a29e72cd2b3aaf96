//! Choice by look-ahead: the options that are best by outcome probabilities and geometry are rolled out, one after
//! another, until one is good.

use std::sync::Arc;

use nalgebra::{Matrix6, Vector3};
use world::objects::ObjectModel;

use super::swept_clearance::ClearanceScene;
use super::{
    AimedCandidate, Assessment, CheckedCandidate, DecisionContext, ScoredCandidate, StrategyError, outcome_score,
};
use crate::detection::DetectedObject;
use crate::executor::{Executor, GraspTarget};
use crate::look_ahead::{self, ANTITHETIC_PAIRS, LookAheadSettings, RolloutCounts, SampledScene, UnknownState};
use crate::outcome_model::OutcomeProbabilities;
use crate::score::SWITCH_GAIN;

/// Score from which on no further option is rolled out. Set by hand on seed 1.
const GOOD_SCORE: f64 = 0.9;

/// Number of rounds in which the aim of the best option is shifted if none is good, and the size of the shift (m).
const AIM_SEARCH_ROUNDS: usize = 2;
const AIM_SHIFT: f64 = 0.005;

/// Inputs for rollouts of candidates.
#[derive(Clone, Copy)]
pub struct LookAhead<'a> {
    pub settings: LookAheadSettings<'a>,
    /// The held object and the target.
    pub objects: &'a [Arc<ObjectModel>],
    /// Covariance of the held object's pose, m and rad, palm axes.
    pub covariance: &'a Matrix6<f64>,
}

impl LookAhead<'_> {
    /// Best of `options`, ranked by their outcome probabilities, if it is clearly better than the `plan`. They are
    /// rolled out in turn until one is good.
    pub(super) fn best<'a>(
        &self,
        situation: &DecisionContext,
        scene: &ClearanceScene,
        plan: &mut CheckedCandidate<'a>,
        options: Vec<AimedCandidate<'a>>,
        scored: &mut Vec<ScoredCandidate>,
    ) -> Result<Option<CheckedCandidate<'a>>, StrategyError> {
        let executor = situation.executor;
        let draws = look_ahead::draw_samples(&UnknownState {
            held: (situation.held.pose, self.covariance),
            target: executor.target(1).detected,
            aim_posterior: situation.aim_posterior,
            detections: situation.detections,
        });
        let (objects, joints) = (self.objects, &situation.held.joints[..]);
        let imagined =
            self.settings.model.prepare(&look_ahead::RolloutScene { executor, objects, joints, samples: &draws })?;
        let imagined = imagined.as_ref();
        let others = options.into_iter().enumerate().filter(|(_, aiming)| !aiming.is_same_as(&plan.aimed));
        let others: Vec<_> = others.take(self.settings.max_alternatives).collect();
        let mut best: Option<CheckedCandidate> = None;
        for (n, aiming) in others {
            if plan.rollout_counts.is_none()
                && outcome_score(&aiming.probabilities) <= SWITCH_GAIN * plan.assessment.score
            {
                roll_out(executor, imagined, plan, score_of(best.as_ref()))?;
            }
            let from_rollouts = plan.rollout_counts.map_or(f64::NEG_INFINITY, |_| plan.assessment.score);
            let utmost = score_of(best.as_ref()).max(from_rollouts);
            if utmost >= GOOD_SCORE {
                break;
            }
            let (assessment, clearance) = aiming.assess(executor, scene)?;
            let mut one = CheckedCandidate {
                index: n + 1,
                aimed: aiming,
                assessment,
                swept_clearance: clearance,
                rollout_counts: None,
            };
            roll_out(executor, imagined, &mut one, utmost)?;
            scored[n + 1] = one.aimed.record(Some(&one.assessment), false);
            if one.assessment.score > score_of(best.as_ref()) {
                best = Some(one);
            }
        }
        if plan.rollout_counts.is_none() && score_of(best.as_ref()) < GOOD_SCORE {
            roll_out(executor, imagined, plan, score_of(best.as_ref()))?;
        }
        scored[0] = plan.aimed.record(Some(&plan.assessment), true);
        if self.settings.max_alternatives > 0 {
            self.search_aims(situation, scene, imagined, plan, &mut best, scored)?;
        }
        Ok(best.filter(|best| best.assessment.score > SWITCH_GAIN * plan.assessment.score))
    }

    /// Shifts the aim of the best option to every side, as long as no option is good.
    fn search_aims<'a>(
        &self,
        situation: &DecisionContext,
        scene: &ClearanceScene,
        twin: &dyn SampledScene,
        plan: &CheckedCandidate<'a>,
        best: &mut Option<CheckedCandidate<'a>>,
        scored: &mut Vec<ScoredCandidate>,
    ) -> Result<(), StrategyError> {
        for _ in 0..AIM_SEARCH_ROUNDS {
            let center = best.as_ref().filter(|best| best.assessment.score > plan.assessment.score).unwrap_or(plan);
            let (candidate, aim, utmost) = (center.aimed.candidate, center.aimed.aimed.aim, center.assessment.score);
            if utmost >= GOOD_SCORE {
                break;
            }
            for step in [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
                let aiming = AimedCandidate::with_aim(situation, candidate, aim + AIM_SHIFT * step);
                let (assessment, clearance) = aiming.assess(situation.executor, scene)?;
                let place = scored.len();
                let mut one = CheckedCandidate {
                    index: place,
                    aimed: aiming,
                    assessment,
                    swept_clearance: clearance,
                    rollout_counts: None,
                };
                let least = score_of(best.as_ref()).max(utmost);
                roll_out(situation.executor, twin, &mut one, least)?;
                scored.push(one.aimed.record(Some(&one.assessment), false));
                if one.rollout_counts.is_some() && one.assessment.score > least {
                    *best = Some(one);
                }
            }
        }
        Ok(())
    }
}

/// Score of an option; negative infinity if there is none.
fn score_of(one: Option<&CheckedCandidate>) -> f64 {
    one.map_or(f64::NEG_INFINITY, |one| one.assessment.score)
}

/// Rolls out `one` under half of the samples, and under the others if its score can still exceed `least`. If the arm
/// finds no path, the outcome probabilities stay.
fn roll_out(
    executor: &Executor,
    twin: &dyn SampledScene,
    one: &mut CheckedCandidate,
    least: f64,
) -> Result<(), StrategyError> {
    let Some(going) = approaching_executor(executor, one)? else { return Ok(()) };
    let probabilities = OutcomeProbabilities { held: one.assessment.held, contact: one.assessment.risk };
    let mut foreseen = RolloutCounts::default();
    for (draws, left) in
        [(0..ANTITHETIC_PAIRS, 2 * ANTITHETIC_PAIRS), (ANTITHETIC_PAIRS..2 * ANTITHETIC_PAIRS, ANTITHETIC_PAIRS)]
    {
        if outcome_score(&foreseen.if_all_held(left as u32).posterior(&probabilities)) <= least {
            break;
        }
        foreseen.add_outcomes(&twin.roll_out(&going, draws)?);
    }
    let probabilities = foreseen.posterior(&probabilities);
    one.assessment = Assessment {
        held: probabilities.held,
        risk: probabilities.contact,
        score: outcome_score(&probabilities),
        ..one.assessment
    };
    one.rollout_counts = (foreseen.rollouts > 0).then_some(foreseen);
    Ok(())
}

/// The executor on its way to try `one`; `None` if the arm cannot get there.
fn approaching_executor(executor: &Executor, one: &CheckedCandidate) -> Result<Option<Executor>, StrategyError> {
    let (seen, grasp) = (executor.target(1).detected, &one.aimed.candidate.grasp);
    let beside = DetectedObject { position: seen.position + one.aimed.aimed.aim, ..seen };
    let Some(path) = executor.feasible_approach(&one.swept_clearance.stops, grasp, &beside) else { return Ok(None) };
    let mut going = executor.clone();
    going.take(1, GraspTarget { grasp: grasp.clone(), detected: beside })?;
    going.redirect(path);
    Ok(Some(going))
}
