//! Look-ahead: rollouts of the best second grasps from the estimated state of the scene, before one is chosen.
//!
//! The rollouts of [`crate::outcome_model`] start from the planned hold of the first object, with both objects at their
//! nominal poses. A [`RolloutModel`] runs a try from the estimated state. Unknowns are sampled ([`draw_samples`]): the
//! in-hand pose of the held object from its covariance, the error of the aim from the [`AimPosterior`], and the yaw of
//! the target. All grasps are compared under the same samples. Samples of the hold come in antithetic pairs, so that
//! their mean is the estimate. The outcomes update the outcome probabilities ([`RolloutCounts::posterior`]).

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use world::objects::ObjectModel;

use crate::detection::DetectedObject;
use crate::executor::Executor;
use crate::outcome_model::{AimPosterior, OutcomeProbabilities, TryOutcome};

/// Number of antithetic pairs of samples: each sample comes with its reflection about the mean.
pub(crate) const ANTITHETIC_PAIRS: usize = 4;
/// Largest number of grasps that are rolled out besides the planned one.
const MAX_ALTERNATIVES: usize = 10;
/// Weight of the prior outcome probabilities, as a number of rollouts. Set by hand on seed 1.
const PRIOR_ROLLOUTS: f64 = 4.0;
/// Standard deviation of the target's yaw, rad.
const YAW_SIGMA: f64 = 0.08;
/// Seed of the standard normal numbers behind the samples, which are the same for every decision.
const SEED: u64 = 0x7477_696e;

/// One sample of the unknown state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateSample {
    /// `palm_from_object` of the held object.
    pub held: Isometry3<f64>,
    /// `world_from_object` of the target, in the world frame that the arm assumes.
    pub target: Isometry3<f64>,
}

/// The scene as estimated.
pub struct RolloutScene<'a> {
    /// An executor at a decision, with the first object in the hand.
    pub executor: &'a Executor,
    /// The held object and the target.
    pub objects: &'a [Arc<ObjectModel>],
    /// Finger joint angles as estimated by touch, rad.
    pub joints: &'a [f64],
    /// Samples of the unknowns.
    pub samples: &'a [StateSample],
}

/// Failure of the rollout model.
#[derive(Debug, thiserror::Error)]
#[error("the rollout model: {0}")]
pub struct RolloutError(#[from] pub Box<dyn std::error::Error + Send + Sync>);

/// A model of the robot and the objects in which tries can be rolled out.
pub trait RolloutModel: Sync {
    /// Prepares rollouts of tries in a scene.
    fn prepare(&self, scene: &RolloutScene) -> Result<Box<dyn SampledScene>, RolloutError>;
}

/// A scene of the rollout model, under each of its samples.
pub trait SampledScene {
    /// Rolls out `going`, which is about to approach the second object, under the samples `draws` and returns the
    /// outcomes. `None` if the sampled hold of the first object is not a hold in the model.
    fn roll_out(&self, going: &Executor, draws: Range<usize>) -> Result<Vec<Option<TryOutcome>>, RolloutError>;
}

/// Settings for rollouts of second grasps before one is chosen.
#[derive(Clone, Copy)]
pub struct LookAheadSettings<'a> {
    pub model: &'a dyn RolloutModel,
    /// Largest number of grasps that are rolled out besides the planned one.
    pub max_alternatives: usize,
}

impl<'a> LookAheadSettings<'a> {
    /// Rolls out the planned grasp and the best other grasps.
    pub fn with_alternatives(twin: &'a dyn RolloutModel) -> Self {
        Self { model: twin, max_alternatives: MAX_ALTERNATIVES }
    }

    /// Rolls out the planned grasp alone.
    pub fn plan_only(twin: &'a dyn RolloutModel) -> Self {
        Self { model: twin, max_alternatives: 0 }
    }
}

/// Unknowns at the time when the second object is to be taken.
pub(crate) struct UnknownState<'a> {
    /// Estimated `palm_from_object` of the held object and its covariance (m and rad, palm axes).
    pub held: (Isometry3<f64>, &'a Matrix6<f64>),
    /// The target as detected, or as located by touch.
    pub target: DetectedObject,
    /// Posterior of the error of the aim.
    pub aim_posterior: &'a AimPosterior,
    /// Number of detections over which the target's position is averaged.
    pub detections: u32,
}

/// Samples the unknowns.
pub(crate) fn draw_samples(unknown: &UnknownState) -> Vec<StateSample> {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let root = unknown.held.1.symmetric_eigen();
    let scales = root.eigenvalues.map(|value| value.max(0.0).sqrt());
    let mut draws = Vec::with_capacity(2 * ANTITHETIC_PAIRS);
    for pair in 0..ANTITHETIC_PAIRS {
        let mut normal = || StandardNormal.sample(&mut rng);
        let held = Vector6::from_fn(|_, _| normal());
        let (fresh, turned): (Vector3<f64>, f64) = (Vector3::new(normal(), normal(), 0.0), normal());
        for (n, sign) in [1.0, -1.0].into_iter().enumerate() {
            let off = root.eigenvectors * scales.component_mul(&(sign * held));
            let aim = unknown.aim_posterior.sample(2 * pair + n, 2 * ANTITHETIC_PAIRS)
                + unknown.aim_posterior.mean_detection_sigma(unknown.detections) * sign * fresh;
            draws.push(StateSample {
                held: displaced(&unknown.held.0, &off),
                target: displaced_target(&unknown.target, &-aim, sign * turned * YAW_SIGMA),
            });
        }
    }
    draws
}

/// Moves `pose` by a translation (m) and rotates it by a rotation vector (rad) about its own origin, both in the axes
/// of its parent frame.
fn displaced(pose: &Isometry3<f64>, off: &Vector6<f64>) -> Isometry3<f64> {
    let (shift, turn) = (off.fixed_rows::<3>(0).into_owned(), off.fixed_rows::<3>(3).into_owned());
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + shift),
        UnitQuaternion::from_scaled_axis(turn) * pose.rotation,
    )
}

/// `world_from_object` of the object detected at `detected`, displaced by `off` (m) and rotated about the vertical by
/// `turn` (rad).
fn displaced_target(detected: &DetectedObject, off: &Vector3<f64>, turn: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    Isometry3::from_parts(Translation3::from(detected.position.coords + off), turn * detected.rotation)
}

/// Outcomes of the rollouts of a grasp.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RolloutCounts {
    /// Number of rollouts.
    pub rollouts: u32,
    /// Number of rollouts in which it held the object without an unwanted contact.
    pub held: u32,
    /// Number of rollouts with an unwanted contact.
    pub contact: u32,
}

impl RolloutCounts {
    /// Adds `outcomes` to the counts.
    pub(crate) fn add_outcomes(&mut self, outcomes: &[Option<TryOutcome>]) {
        for outcome in outcomes.iter().flatten() {
            self.rollouts += 1;
            self.held += u32::from(*outcome == TryOutcome::Held);
            self.contact += u32::from(*outcome == TryOutcome::Contact);
        }
    }

    /// Counts as they would be if `more` further rollouts all held the object.
    pub(crate) fn if_all_held(self, more: u32) -> Self {
        Self { rollouts: self.rollouts + more, held: self.held + more, ..self }
    }

    /// Updates `probabilities` with these outcomes: the posterior mean under a Dirichlet prior whose mean is
    /// `probabilities` and whose weight is [`PRIOR_ROLLOUTS`] rollouts.
    pub(crate) fn posterior(&self, probabilities: &OutcomeProbabilities) -> OutcomeProbabilities {
        let share = |prior: f64, count: u32| {
            (PRIOR_ROLLOUTS * prior + f64::from(count)) / (PRIOR_ROLLOUTS + f64::from(self.rollouts))
        };
        OutcomeProbabilities {
            held: share(probabilities.held, self.held),
            contact: share(probabilities.contact, self.contact),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::outcome_model::{AimedGrasp, Rollout};

    fn detected() -> DetectedObject {
        DetectedObject { position: Point3::new(0.6, 0.1, 0.03), rotation: UnitQuaternion::identity(), yaw: 0.0 }
    }

    fn some_draws(held: &Matrix6<f64>, aim: &Matrix3<f64>) -> Vec<StateSample> {
        let posterior = AimPosterior::from_touch(aim).expect("positive definite");
        draw_samples(&UnknownState {
            held: (Isometry3::translation(0.01, 0.05, -0.03), held),
            target: detected(),
            aim_posterior: &posterior,
            detections: 1,
        })
    }

    /// Without uncertainty all samples are the estimate, except for the yaw of the target.
    #[test]
    fn without_doubt_all_draws_are_the_estimate() {
        for draw in some_draws(&Matrix6::zeros(), &(Matrix3::identity() * 1e-16)) {
            assert!((draw.held.translation.vector - Vector3::new(0.01, 0.05, -0.03)).norm() < 1e-12);
            assert!((draw.target.translation.vector - detected().position.coords).norm() < 1e-6);
        }
    }

    /// Samples of the hold come in antithetic pairs, vary only along uncertain directions, and are the same every time.
    #[test]
    fn draws_mirror_each_other_about_the_estimate() {
        let mut held = Matrix6::zeros();
        (held[(0, 0)], held[(5, 5)]) = (0.004_f64.powi(2), 0.2_f64.powi(2));
        let aim = Matrix3::identity() * 1e-16;
        let all = some_draws(&held, &aim);
        assert_eq!(all, some_draws(&held, &aim));
        let mut spread = 0.0;
        for pair in all.chunks(2) {
            let [off, mirrored] =
                [pair[0], pair[1]].map(|draw| draw.held.translation.vector - Vector3::new(0.01, 0.05, -0.03));
            assert!((off + mirrored).norm() < 1e-12 && off.y.abs() < 1e-12 && off.z.abs() < 1e-12, "{off}");
            let [turn, back] = [pair[0], pair[1]].map(|draw| draw.held.rotation.scaled_axis());
            assert!((turn + back).norm() < 1e-12 && turn.x.abs() < 1e-12 && turn.z.abs() > 0.0, "{turn}");
            spread += off.x.powi(2) / ANTITHETIC_PAIRS as f64;
        }
        assert!((0.3..3.0).contains(&(spread.sqrt() / 0.004)), "{spread}");
    }

    /// Offsets (m) of the target from its detected position in the samples.
    fn offs(posterior: &AimPosterior) -> Vec<Vector3<f64>> {
        let held = (Isometry3::identity(), &Matrix6::zeros());
        let all = draw_samples(&UnknownState { held, target: detected(), aim_posterior: posterior, detections: 1 });
        all.iter().map(|draw| draw.target.translation.vector - detected().position.coords).collect()
    }

    /// If the hand goes too far along x, the target appears too far back.
    #[test]
    fn an_error_of_the_aim_is_a_target_on_the_other_side() {
        let mut posterior =
            AimPosterior::from_touch(&(Matrix3::identity() * 0.003_f64.powi(2))).expect("positive definite");
        let mean =
            |posterior: &AimPosterior| offs(posterior).iter().sum::<Vector3<f64>>() / (2 * ANTITHETIC_PAIRS) as f64;
        assert!(mean(&posterior).norm() < 0.003, "{}", mean(&posterior));
        // Failures at every positive error make a positive error likely.
        let outcome = |x: f64| if x < 0.0 { TryOutcome::Held } else { TryOutcome::Missed };
        let rollouts: Arc<[Rollout]> = (-20..=20)
            .map(|n| 0.001 * f64::from(n))
            .map(|x| Rollout::new(Vector3::new(x, 0.0, 0.0), outcome(x)))
            .collect();
        let aimed =
            AimedGrasp { rollouts: rollouts.clone(), all_rollouts: rollouts, heading: 0.0, aim: Vector3::zeros() };
        (0..6).for_each(|_| posterior.update_after_failure(&aimed, 1));
        assert!(mean(&posterior).x < -0.001, "{}", mean(&posterior));
    }

    #[test]
    fn outcomes_count_beside_the_prediction() {
        let probabilities = OutcomeProbabilities { held: 0.8, contact: 0.1 };
        assert_eq!(RolloutCounts::default().posterior(&probabilities), probabilities);
        let mut foreseen = RolloutCounts::default();
        foreseen.add_outcomes(&[Some(TryOutcome::Held), None, Some(TryOutcome::Contact), Some(TryOutcome::Missed)]);
        assert_eq!(foreseen, RolloutCounts { rollouts: 3, held: 1, contact: 1 });
        let with = foreseen.posterior(&probabilities);
        assert!((with.held - (PRIOR_ROLLOUTS * 0.8 + 1.0) / (PRIOR_ROLLOUTS + 3.0)).abs() < 1e-12);
        assert!((with.contact - (PRIOR_ROLLOUTS * 0.1 + 1.0) / (PRIOR_ROLLOUTS + 3.0)).abs() < 1e-12);
        assert!(foreseen.if_all_held(5).posterior(&probabilities).held > with.held);
    }
}
