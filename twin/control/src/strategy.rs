//! Strategy: chooses the grasp of the next object and its aim, given the felt pose of the held object.
//!
//! The outcome probabilities of a candidate (held, missed, contact) come from its rollouts under errors
//! ([`crate::outcome_model`]), at the offset of the aim with the highest score. Rollouts used the planned hold. The
//! felt hold is compared with it by geometry: the union of the held object (with the digits that hold it) and the
//! target is checked along the whole motion, which is the approach and the path of the target into the hand while the
//! digits close. The probability that this clearance is negative may be larger for the felt hold than for that of the
//! rollouts; the probability of a contact rises by the difference. The outcome probabilities of a candidate that was
//! verified after many holds give most weight to those similar to the felt one ([`crate::extent`]) and already include
//! obstacles at the object. A candidate without rollouts has its verified score and the whole of that probability. A
//! miss without contact scores part of a hold, because it can be tried again. The planned grasp is kept unless another
//! candidate is clearly better.

mod approach_paths;
mod rollout_choice;
mod solids;
mod swept_clearance;

use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::Hand;
use nalgebra::{Isometry3, Vector3};

use crate::collision::{CollisionError, Solid};
use crate::executor::Executor;
use crate::look_ahead::{RolloutCounts, RolloutError};
use crate::motion::MotionError;
use crate::outcome_model::{AimPosterior, AimedGrasp, OutcomeProbabilities, Rollout, aim_grid_offset};
use crate::score::{DEFAULT_CONTACT_PROBABILITY, GraspCandidate, MISS_SCORE, SWITCH_GAIN};

pub use self::approach_paths::{PALPATION_CLEARANCE, clear_via_poses, clearest_palpation};
pub use self::rollout_choice::LookAhead;
pub use self::solids::{HeldObject, object_solids, transformed};
pub use self::swept_clearance::HeldObjectPath;
use self::swept_clearance::{ClearanceScene, SweptClearance};

/// Assessment of one candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// Smallest distance along the whole motion, m; negative for a collision.
    pub clearance: f64,
    /// Distance between the held object alone and the next object at its place, with the palm at the grasp and the
    /// digits not yet closed, m. Negative where the two overlap, which is a collision in the sense of the paper.
    pub separation: f64,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held after this try.
    pub held: f64,
    /// Score of the try, 0 to 1.
    pub score: f64,
}

/// Record of one scored candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoredCandidate {
    /// Number of the grasp.
    pub grasp: u32,
    /// Offset of its aim from the detected position, m, world.
    pub aim: Vector3<f64>,
    /// Clearance, m; only for candidates that could still win.
    pub clearance: Option<f64>,
    /// Probability of an unwanted contact.
    pub risk: f64,
    /// Probability that the object is held.
    pub held: f64,
    /// Score of the try, 0 to 1.
    pub score: f64,
    /// True for the planned grasp.
    pub planned: bool,
}

/// A decision with its reasons.
#[derive(Debug, Clone)]
pub struct Decision {
    /// All candidates: the planned grasp, aimed at the detected position, first, then the others by their outcome
    /// probabilities.
    pub candidates: Vec<ScoredCandidate>,
    /// Index of the chosen candidate.
    pub choice: usize,
    /// Predicted course of the planned grasp, if another grasp or aim was chosen.
    pub rejected: Option<HeldObjectPath>,
    /// Predicted course of the chosen option.
    pub course: HeldObjectPath,
    /// Chosen grasp.
    pub grasp: Grasp,
    /// Offset of its aim from the detected position, m, world.
    pub aim: Vector3<f64>,
    /// Rollouts and aim of the chosen grasp, for learning from its outcome.
    pub aimed: AimedGrasp,
    /// Via poses on the way to its approach pose.
    pub via_poses: Vec<Isometry3<f64>>,
    /// True if it differs from the planned grasp.
    pub switched: bool,
    /// Assessment of the planned grasp, aimed at the detected position.
    pub planned: Assessment,
    /// Assessment of the chosen grasp.
    pub chosen: Assessment,
    /// Reason in words.
    pub reason: String,
}

/// Failure to make a decision.
#[derive(Debug, thiserror::Error)]
pub enum StrategyError {
    /// The geometric check failed.
    #[error(transparent)]
    Collision(#[from] CollisionError),
    /// A path could not be planned.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The rollout model failed.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
}

/// Inputs of a choice.
pub struct DecisionContext<'a> {
    /// Executor with the present palm pose and the target's detected pose.
    pub executor: &'a Executor,
    pub hand: &'a Hand,
    /// Contents of the hand.
    pub held: &'a HeldObject<'a>,
    /// Hold of the same object from which the rollouts of the candidates began: `palm_from_object` and finger joint
    /// angles, rad.
    pub rollout_hold: Option<(Isometry3<f64>, &'a [f64])>,
    /// Solids of the object to take next, in its own frame: [`object_solids`].
    pub target: &'a [Solid],
    /// Standard deviation of the target's position relative to the hand, from perceiving and reaching it, m.
    pub target_sigma: f64,
    /// Rollouts of all candidates.
    pub all_rollouts: Arc<[Rollout]>,
    /// Posterior of the error of the aim.
    pub aim_posterior: &'a AimPosterior,
    /// Number of detections over which the target's position is averaged.
    pub detections: u32,
    /// Offset of the aim for a grasp without rollouts, m, world.
    pub probe: Vector3<f64>,
    /// Inputs for rollouts of the best candidates before one is chosen.
    pub look_ahead: Option<LookAhead<'a>>,
}

/// A candidate with an aim.
struct AimedCandidate<'a> {
    candidate: &'a GraspCandidate,
    aimed: AimedGrasp,
    probabilities: OutcomeProbabilities,
}

impl<'a> AimedCandidate<'a> {
    /// `candidate` with its aim at the offset `aim` (m) from the detected position.
    fn with_aim(situation: &DecisionContext, candidate: &'a GraspCandidate, aim: Vector3<f64>) -> Self {
        let heading = candidate.grasp.yaw + situation.executor.target(1).detected.yaw;
        let (rollouts, all) = (candidate.rollouts.clone(), situation.all_rollouts.clone());
        let aimed = AimedGrasp { rollouts, all_rollouts: all, heading, aim };
        let odds = candidate_probabilities(candidate, &aimed, (situation.aim_posterior, situation.detections));
        Self { candidate, aimed, probabilities: odds }
    }

    /// `candidate` with the aim of the highest score.
    fn with_best_aim(situation: &DecisionContext, candidate: &'a GraspCandidate) -> Self {
        if candidate.rollouts.is_empty() {
            return Self::with_aim(situation, candidate, situation.probe);
        }
        let mut best = Self::with_aim(situation, candidate, Vector3::zeros());
        let around = situation.aim_posterior.probabilities_around(&best.aimed, situation.detections);
        for (x, line) in around.iter().enumerate() {
            for (y, odds) in line.iter().enumerate() {
                let odds = OutcomeProbabilities { held: odds.held * candidate.failure_factor, ..*odds };
                if outcome_score(&odds) > outcome_score(&best.probabilities) {
                    (best.probabilities, best.aimed.aim) =
                        (odds, Vector3::new(aim_grid_offset(x), aim_grid_offset(y), 0.0));
                }
            }
        }
        best
    }

    /// True if grasp and aim are the same.
    fn is_same_as(&self, other: &AimedCandidate) -> bool {
        self.candidate.grasp.id == other.candidate.grasp.id && self.aimed.aim == other.aimed.aim
    }

    /// Assesses the option with the geometry of its motion.
    fn assess(
        &self,
        executor: &Executor,
        scene: &ClearanceScene,
    ) -> Result<(Assessment, SweptClearance), StrategyError> {
        let passage = scene.swept_clearance(executor, self.candidate, &self.aimed.aim)?;
        let (clearance, separation, free) = (passage.clearance, passage.separation, 1.0 - passage.contact);
        let odds = OutcomeProbabilities {
            held: self.probabilities.held * free,
            contact: 1.0 - (1.0 - self.probabilities.contact) * free,
        };
        Ok((
            Assessment { clearance, separation, risk: odds.contact, held: odds.held, score: outcome_score(&odds) },
            passage,
        ))
    }

    /// Record of the option, with its outcome probabilities alone or with its assessment.
    fn record(&self, assessed: Option<&Assessment>, planned: bool) -> ScoredCandidate {
        let OutcomeProbabilities { held, contact } = self.probabilities;
        let (held, risk, worth) = match assessed {
            Some(assessed) => (assessed.held, assessed.risk, assessed.score),
            None => (held, contact, outcome_score(&self.probabilities)),
        };
        let clearance = assessed.map(|assessed| assessed.clearance);
        ScoredCandidate {
            grasp: self.candidate.grasp.id,
            aim: self.aimed.aim,
            clearance,
            risk,
            held,
            score: worth,
            planned,
        }
    }
}

/// Outcome probabilities of a candidate with the aim `aimed`, given a posterior and the number of detections of the
/// object.
fn candidate_probabilities(
    candidate: &GraspCandidate,
    aimed: &AimedGrasp,
    (posterior, detections): (&AimPosterior, u32),
) -> OutcomeProbabilities {
    if candidate.rollouts.is_empty() {
        return OutcomeProbabilities {
            held: candidate.score * (1.0 - DEFAULT_CONTACT_PROBABILITY),
            contact: DEFAULT_CONTACT_PROBABILITY,
        };
    }
    let odds = posterior.probabilities(aimed, detections);
    OutcomeProbabilities { held: odds.held * candidate.failure_factor, ..odds }
}

/// Rollouts of all `candidates`.
pub fn collect_rollouts(candidates: &[GraspCandidate]) -> Arc<[Rollout]> {
    candidates.iter().flat_map(|candidate| candidate.rollouts.iter().copied()).collect()
}

/// Score of the best of `candidates` at an object whose position has the error of `posterior`.
pub fn best_candidate_score(candidates: &[GraspCandidate], posterior: &AimPosterior) -> f64 {
    let all = collect_rollouts(candidates);
    let score = |candidate: &GraspCandidate| {
        let (rollouts, all) = (candidate.rollouts.clone(), all.clone());
        let aimed = AimedGrasp { rollouts, all_rollouts: all, heading: candidate.grasp.yaw, aim: Vector3::zeros() };
        outcome_score(&candidate_probabilities(candidate, &aimed, (posterior, 1)))
    };
    candidates.iter().map(score).fold(0.0, f64::max)
}

/// Score of a try with these outcome probabilities.
fn outcome_score(probabilities: &OutcomeProbabilities) -> f64 {
    probabilities.held + MISS_SCORE * (1.0 - probabilities.held - probabilities.contact)
}

/// A candidate whose motion was checked.
struct CheckedCandidate<'a> {
    /// Its index among the scored candidates.
    index: usize,
    aimed: AimedCandidate<'a>,
    assessment: Assessment,
    swept_clearance: SweptClearance,
    /// Outcomes of its rollouts, if there were any.
    rollout_counts: Option<RolloutCounts>,
}

/// Chooses among `candidates`, the first of which is the planned grasp. `None` if there are none.
pub fn choose(situation: &DecisionContext, candidates: &[GraspCandidate]) -> Result<Option<Decision>, StrategyError> {
    let Some(planned) = candidates.first() else { return Ok(None) };
    let scene = ClearanceScene::new(situation);
    let aiming = AimedCandidate::with_aim(situation, planned, Vector3::zeros());
    let (assessment, clearance) = aiming.assess(situation.executor, &scene)?;
    let mut plan =
        CheckedCandidate { index: 0, aimed: aiming, assessment, swept_clearance: clearance, rollout_counts: None };
    let mut options: Vec<AimedCandidate> =
        candidates.iter().map(|candidate| AimedCandidate::with_best_aim(situation, candidate)).collect();
    options.sort_by(|a, b| outcome_score(&b.probabilities).total_cmp(&outcome_score(&a.probabilities)));
    let mut scored = vec![plan.aimed.record(Some(&plan.assessment), true)];
    scored.extend(options.iter().map(|option| option.record(None, false)));
    let other = match &situation.look_ahead {
        Some(foresight) => foresight.best(situation, &scene, &mut plan, options, &mut scored)?,
        None => best_by_probability(situation.executor, &scene, &plan, options, &mut scored)?,
    };
    let plan_assessment = plan.assessment;
    let (chosen, rejected) = match other {
        Some(other) => (other, Some(plan.swept_clearance)),
        None => (plan, None),
    };
    let CheckedCandidate { index: choice, aimed: aiming, assessment, swept_clearance: way, rollout_counts: foreseen } =
        chosen;
    let grasp = aiming.candidate.grasp.clone();
    let switched = grasp.id != planned.grasp.id;
    let mut reason = reason(situation.held.name, (&planned.grasp, &plan_assessment), (&aiming, &assessment));
    match foreseen {
        Some(RolloutCounts { rollouts, held, contact }) => {
            reason.push_str(&format!("; of {rollouts} rollouts {held} hold and {contact} make contact"));
        }
        None if situation.look_ahead.is_some() => reason.push_str("; no rollouts: the model has no such hold or path"),
        None => {}
    }
    let course = way.held_object_path(&situation.held.pose);
    Ok(Some(Decision {
        candidates: scored,
        choice,
        rejected: rejected.map(|way| way.held_object_path(&situation.held.pose)),
        course,
        grasp,
        aim: aiming.aimed.aim,
        aimed: aiming.aimed,
        via_poses: way.stops,
        switched,
        planned: plan_assessment,
        chosen: assessment,
        reason,
    }))
}

/// Best of `options`, ranked by their outcome probabilities, if it is clearly better than the `plan`. Obstacles can
/// only lower the score of an option, so those that cannot win are not checked.
fn best_by_probability<'a>(
    executor: &Executor,
    scene: &ClearanceScene,
    plan: &CheckedCandidate,
    options: Vec<AimedCandidate<'a>>,
    scored: &mut [ScoredCandidate],
) -> Result<Option<CheckedCandidate<'a>>, StrategyError> {
    let mut best: Option<CheckedCandidate> = None;
    for (n, aiming) in options.into_iter().enumerate() {
        let utmost = best.as_ref().map_or(plan.assessment.score, |best| best.assessment.score);
        let least = utmost.max(SWITCH_GAIN * plan.assessment.score);
        if outcome_score(&aiming.probabilities) <= least {
            break;
        }
        let (assessment, clearance) = aiming.assess(executor, scene)?;
        scored[n + 1] = aiming.record(Some(&assessment), false);
        if assessment.score > least {
            best = Some(CheckedCandidate {
                index: n + 1,
                aimed: aiming,
                assessment,
                swept_clearance: clearance,
                rollout_counts: None,
            });
        }
    }
    Ok(best)
}

/// Describes the choice in words.
fn reason(held: &str, plan: (&Grasp, &Assessment), chosen: (&AimedCandidate, &Assessment)) -> String {
    let odds = |assessed: &Assessment| format!("holds with {:.2}, contact {:.2}", assessed.held, assessed.risk);
    let (grasp, aim) = (&chosen.0.candidate.grasp, chosen.0.aimed.aim * 1e3);
    let passes = format!("passes the held {held} at {:.1} mm", chosen.1.clearance * 1e3);
    if grasp.id == plan.0.id && aim == Vector3::zeros() {
        return format!("grasp {} as planned {passes}: {}", grasp.id, odds(plan.1));
    }
    format!(
        "grasp {} as planned: {}; grasp {} aimed ({:.0}, {:.0}, {:.0}) mm from the detected position {passes}: {}",
        plan.0.id,
        odds(plan.1),
        grasp.id,
        aim.x,
        aim.y,
        aim.z,
        odds(chosen.1)
    )
}
