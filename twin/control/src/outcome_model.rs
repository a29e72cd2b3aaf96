//! Outcome model of a try: success and contact probabilities from rollouts under sampled errors, for an aim with an
//! unknown error.
//!
//! A grasp was rolled out in physics under errors of its aim, and each rollout held, missed or made an unwanted
//! contact. In a trial the error of the aim is b + n: b persists through the trial (the error of the arm and the
//! persistent part of the detector's error), n is new at each detection. An [`AimPosterior`] is a set of weighted
//! samples of b. The outcome probabilities at one b come from the rollouts near it, weighted by a Gaussian kernel as
//! wide as n (the Nadaraya-Watson estimator). The outcome probabilities of the try are their mean over the posterior. A
//! failed try makes those b more likely at which it had to fail.
//!
//! Two dozen rollouts alone are too few to distinguish grasps: the best of many such estimates is mostly the luckiest.
//! Rollouts of the other grasps of the same object therefore count too, each with a reduced weight.
//!
//! Rollouts after various holds of the first object are weighted by the similarity of their hold to the felt one
//! ([`Rollout::hold`]).

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Matrix3, Rotation2, Vector2, Vector3};

use crate::extent::HeldExtent;
use crate::uncertainty::Uncertainty;

/// Number of samples of the persistent error in a posterior.
const SAMPLE_COUNT: usize = 96;
/// Smallest kernel width, m: at about this width, left-out rollouts are predicted best by the others.
const MIN_KERNEL_WIDTH: f64 = 0.004;
/// Kernel weight of a default outcome that dominates where no rollout is near: no hold, and a contact in half of the
/// cases.
const DEFAULT_OUTCOME_WEIGHT: f64 = 0.2;
/// Weight of a rollout of any grasp of the same object; those of the grasp itself have the rest of 1 in addition.
const OTHER_GRASPS_WEIGHT: f64 = 0.2;
/// Smallest weight of a rollout after another hold: with few sampled holds, none is similar to the felt one in all
/// components.
const MIN_HOLD_WEIGHT: f64 = 0.1;
/// Number of aims along each axis of the grid of [`AimPosterior::probabilities_around`]; odd.
pub const AIM_GRID_SIZE: usize = 5;
/// Spacing of the aims, m.
const AIM_STEP: f64 = 0.004;
/// Largest logarithm of the factor between neighbours in that grid; no kernel reaches beyond it.
const MAX_LOG_RATIO: f64 = 300.0;

/// Outcome of a try at the second object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TryOutcome {
    /// The object is lifted, and the first one is still held.
    Held,
    /// The object is not lifted, and there was no unwanted contact.
    Missed,
    /// The first object, the digits that hold it, or the palm touched the second object.
    Contact,
}

/// One rollout of a grasp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rollout {
    /// Error of the aim, m, in axes that turn with the grasp's heading.
    pub error: Vector3<f64>,
    /// Extent of the first object as it was held; `None` if all rollouts have the planned hold.
    pub hold: Option<HeldExtent>,
    pub outcome: TryOutcome,
    /// Weight for the felt hold; 1 for its own hold.
    pub weight: f64,
}

impl Rollout {
    /// A rollout after the planned hold.
    pub fn new(error: Vector3<f64>, outcome: TryOutcome) -> Self {
        Self { error, hold: None, outcome, weight: 1.0 }
    }

    /// Weights the rollout by the similarity of its hold to the felt one.
    #[must_use]
    pub fn reweighted_for_hold(&self, felt: &HeldExtent) -> Self {
        let weight = |hold: HeldExtent| MIN_HOLD_WEIGHT + (1.0 - MIN_HOLD_WEIGHT) * hold.similarity(felt);
        Self { weight: self.hold.map_or(1.0, weight), ..*self }
    }
}

/// Probabilities of a try's outcomes; the rest is the probability of a miss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutcomeProbabilities {
    pub held: f64,
    pub contact: f64,
}

/// Properties of a try that determine its outcome probabilities.
#[derive(Debug, Clone)]
pub struct AimedGrasp {
    /// Rollouts of the grasp.
    pub rollouts: Arc<[Rollout]>,
    /// Rollouts of all grasps of the object, including this one.
    pub all_rollouts: Arc<[Rollout]>,
    /// Yaw of the grasp in the world, rad.
    pub heading: f64,
    /// Offset of the aim from the detected position, m, world.
    pub aim: Vector3<f64>,
}

/// Posterior of the persistent error of the aim: weighted samples (a particle set).
#[derive(Debug, Clone)]
pub struct AimPosterior {
    /// Samples of the error, m, world.
    samples: Vec<Vector3<f64>>,
    /// Weights of the samples; they add up to 1.
    weights: Vec<f64>,
    /// Standard deviation of the part of the detector's error that is new at each detection, m.
    detection_sigma: f64,
}

impl AimPosterior {
    /// Prior, before any try.
    pub fn new(uncertainty: &Uncertainty) -> Self {
        let level = uncertainty.persistent_sigma();
        let sigmas = Vector3::new(level, level, uncertainty.arm);
        let values = (1..=SAMPLE_COUNT).map(|n| normal_triple(n).component_mul(&sigmas)).collect();
        Self {
            samples: values,
            weights: vec![1.0 / SAMPLE_COUNT as f64; SAMPLE_COUNT],
            detection_sigma: uncertainty.independent_detection_sigma(),
        }
    }

    /// Posterior for an object that was located by touch, so that its position relative to the hand is known with this
    /// covariance (m2, world). `None` if the covariance is not positive definite.
    pub fn from_touch(covariance: &Matrix3<f64>) -> Option<Self> {
        let root = covariance.cholesky()?.l();
        let values = (1..=SAMPLE_COUNT).map(|n| root * normal_triple(n)).collect();
        Some(Self { samples: values, weights: vec![1.0 / SAMPLE_COUNT as f64; SAMPLE_COUNT], detection_sigma: 0.0 })
    }

    /// Outcome probabilities of a try at an object whose position is the mean of `detections` detections.
    pub fn probabilities(&self, aimed: &AimedGrasp, detections: u32) -> OutcomeProbabilities {
        let mut odds = OutcomeProbabilities { held: 0.0, contact: 0.0 };
        for (value, weight) in self.samples.iter().zip(&self.weights) {
            let there = self.probabilities_at(aimed, value, detections);
            odds.held += weight * there.held;
            odds.contact += weight * there.contact;
        }
        odds
    }

    /// [`Self::probabilities`] for a square grid of aims, centred on that of `aimed`; [`aim_grid_offset`] gives the
    /// offsets of the others.
    ///
    /// A kernel is a product over the world's axes. Along an axis, its values at evenly spaced aims form a power
    /// series: `exp(-(d - n s)^2 / 2 w^2) = exp(-d^2 / 2 w^2) exp(d s / w^2)^n exp(-s^2 / 2 w^2)^(n^2)`.
    pub fn probabilities_around(
        &self,
        aimed: &AimedGrasp,
        detections: u32,
    ) -> [[OutcomeProbabilities; AIM_GRID_SIZE]; AIM_GRID_SIZE] {
        let width = self.mean_detection_sigma(detections).max(MIN_KERNEL_WIDTH);
        let inverse = 1.0 / (width * width);
        let fall = (-0.5 * AIM_STEP * AIM_STEP * inverse).exp();
        let turn = Rotation2::new(aimed.heading);
        let counted = |rollout: &Rollout, share| {
            let level = turn * rollout.error.xy();
            (Vector3::new(level.x, level.y, rollout.error.z) - aimed.aim, share * rollout.weight, rollout.outcome)
        };
        let own = aimed.rollouts.iter().map(|rollout| counted(rollout, 1.0 - OTHER_GRASPS_WEIGHT));
        let all = aimed.all_rollouts.iter().map(|rollout| counted(rollout, OTHER_GRASPS_WEIGHT));
        let rollouts: Vec<_> = own.chain(all).collect();
        let mut probabilities = [[OutcomeProbabilities { held: 0.0, contact: 0.0 }; AIM_GRID_SIZE]; AIM_GRID_SIZE];
        for (value, weight) in self.samples.iter().zip(&self.weights) {
            // Sums over rollouts that held, made a contact and missed.
            let mut sums = [[[0.0; AIM_GRID_SIZE]; AIM_GRID_SIZE]; 3];
            for (error, share, outcome) in &rollouts {
                let off = error - value;
                let middle = share * (-0.5 * off.norm_squared() * inverse).exp();
                let [x, y] = [off.x, off.y].map(|off| kernel_on_grid(off * AIM_STEP * inverse, fall));
                let sum = &mut sums[match outcome {
                    TryOutcome::Held => 0,
                    TryOutcome::Contact => 1,
                    TryOutcome::Missed => 2,
                }];
                for (line, x) in sum.iter_mut().zip(x) {
                    line.iter_mut().zip(y).for_each(|(sum, y)| *sum += middle * x * y);
                }
            }
            for (x, line) in probabilities.iter_mut().enumerate() {
                for (y, probabilities) in line.iter_mut().enumerate() {
                    let [held, contact, missed] = sums.map(|sum| sum[x][y]);
                    let share = weight / (DEFAULT_OUTCOME_WEIGHT + held + contact + missed);
                    probabilities.held += share * held;
                    probabilities.contact += share * (0.5 * DEFAULT_OUTCOME_WEIGHT + contact);
                }
            }
        }
        probabilities
    }

    /// Updates the posterior after a try that did not hold the object.
    pub fn update_after_failure(&mut self, aimed: &AimedGrasp, detections: u32) {
        let likely: Vec<f64> =
            self.samples.iter().map(|value| 1.0 - self.probabilities_at(aimed, value, detections).held).collect();
        let sum: f64 = self.weights.iter().zip(&likely).map(|(weight, likely)| weight * likely).sum();
        if sum > 0.0 {
            self.weights.iter_mut().zip(&likely).for_each(|(weight, likely)| *weight *= likely / sum);
        }
    }

    /// Mean of the persistent error, m, world.
    pub fn mean(&self) -> Vector3<f64> {
        self.samples.iter().zip(&self.weights).map(|(value, weight)| value * *weight).sum()
    }

    /// The `n`-th of `of` equal-weight samples of the persistent error, m, world.
    pub(crate) fn sample(&self, n: usize, of: usize) -> Vector3<f64> {
        let mut left = (n as f64 + 0.5) / of as f64;
        let reached = |weight: &f64| {
            left -= weight;
            left <= 0.0
        };
        let place = self.weights.iter().position(reached).unwrap_or(self.samples.len() - 1);
        self.samples[place]
    }

    /// Standard deviation of the non-persistent error in the mean of `detections` detections, for each of x and y, m.
    pub(crate) fn mean_detection_sigma(&self, detections: u32) -> f64 {
        self.detection_sigma / f64::from(detections.max(1)).sqrt()
    }

    /// Standard deviation of the persistent error, m: root of the mean variance over the axes.
    pub fn sigma(&self) -> f64 {
        let mean = self.mean();
        let squares =
            self.samples.iter().zip(&self.weights).map(|(value, weight)| weight * (value - mean).norm_squared());
        (squares.sum::<f64>() / 3.0).sqrt()
    }

    /// Outcome probabilities under the assumption that the persistent error is `value`.
    fn probabilities_at(&self, aimed: &AimedGrasp, value: &Vector3<f64>, detections: u32) -> OutcomeProbabilities {
        let width = self.mean_detection_sigma(detections).max(MIN_KERNEL_WIDTH);
        let off = value + aimed.aim;
        let level = Rotation2::new(-aimed.heading) * Vector2::new(off.x, off.y);
        let off = Vector3::new(level.x, level.y, off.z);
        let (mut held, mut contact, mut sum) = (0.0, 0.5 * DEFAULT_OUTCOME_WEIGHT, DEFAULT_OUTCOME_WEIGHT);
        for (rollouts, share) in
            [(&aimed.rollouts, 1.0 - OTHER_GRASPS_WEIGHT), (&aimed.all_rollouts, OTHER_GRASPS_WEIGHT)]
        {
            for Rollout { error, outcome, weight, .. } in rollouts.iter() {
                let near = share * weight * (-0.5 * (error - off).norm_squared() / (width * width)).exp();
                sum += near;
                match outcome {
                    TryOutcome::Held => held += near,
                    TryOutcome::Contact => contact += near,
                    TryOutcome::Missed => {}
                }
            }
        }
        OutcomeProbabilities { held: held / sum, contact: contact / sum }
    }
}

/// Offset of the `n`-th aim of [`AimPosterior::probabilities_around`] from the middle one along an axis, m.
pub fn aim_grid_offset(n: usize) -> f64 {
    (n as f64 - (AIM_GRID_SIZE / 2) as f64) * AIM_STEP
}

/// Kernel along an axis at the aims of [`aim_grid_offset`], relative to its value at the middle one: `slope` is d s /
/// w^2 and `fall` is exp(-s^2 / 2 w^2), in the notation of [`AimPosterior::probabilities_around`].
fn kernel_on_grid(slope: f64, fall: f64) -> [f64; AIM_GRID_SIZE] {
    let step = slope.clamp(-MAX_LOG_RATIO, MAX_LOG_RATIO).exp();
    let (mut values, back) = ([1.0; AIM_GRID_SIZE], step.recip());
    // From n to n + 1 the last factor falls by its power 2 n + 1.
    let (mut up, mut down) = (step * fall, back * fall);
    for n in 1..=AIM_GRID_SIZE / 2 {
        values[AIM_GRID_SIZE / 2 + n] = values[AIM_GRID_SIZE / 2 + n - 1] * up;
        values[AIM_GRID_SIZE / 2 - n] = values[AIM_GRID_SIZE / 2 + 1 - n] * down;
        (up, down) = (up * fall * fall, down * fall * fall);
    }
    values
}

/// Point number `n` (from 1) of a low-discrepancy sequence of three standard normals: Halton's sequence through the
/// Box-Muller transform.
fn normal_triple(n: usize) -> Vector3<f64> {
    let [a, b, c, d] = [2, 3, 5, 7].map(|base| halton(n, base));
    let [one, two] = [a, c].map(|uniform| (-2.0 * uniform.ln()).sqrt());
    Vector3::new(one * (TAU * b).cos(), one * (TAU * b).sin(), two * (TAU * d).cos())
}

/// Van der Corput sequence: the digits of `n` in `base`, reversed after the point.
fn halton(mut n: usize, base: usize) -> f64 {
    let (mut value, mut place) = (0.0, 1.0);
    while n > 0 {
        place /= base as f64;
        value += place * (n % base) as f64;
        n /= base;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNCERTAINTY: Uncertainty = Uncertainty { arm: 0.005, detector: 0.006, detector_persistent_share: 0.5 };

    /// Rollouts on a grid of 3 mm: contact if the error is below -4 mm along x, a miss above 8 mm, a hold in between.
    fn wall() -> Arc<[Rollout]> {
        let steps = || (-6..=6).map(|n| 0.003 * f64::from(n));
        let outcome = |x: f64| match x {
            x if x < -0.004 => TryOutcome::Contact,
            x if x > 0.008 => TryOutcome::Missed,
            _ => TryOutcome::Held,
        };
        steps()
            .flat_map(|x| steps().map(move |y| (x, y)))
            .flat_map(|(x, y)| [-0.005, 0.0, 0.005].map(|z| Vector3::new(x, y, z)))
            .map(|error| Rollout::new(error, outcome(error.x)))
            .collect()
    }

    fn aimed(x: f64) -> AimedGrasp {
        AimedGrasp { rollouts: wall(), all_rollouts: wall(), heading: 0.0, aim: Vector3::new(x, 0.0, 0.0) }
    }

    #[test]
    fn values_spread_as_expected() {
        let posterior = AimPosterior::new(&UNCERTAINTY);
        let level = UNCERTAINTY.persistent_sigma();
        for (axis, sigma) in [level, level, UNCERTAINTY.arm].into_iter().enumerate() {
            let variance = posterior.samples.iter().map(|value| value[axis].powi(2)).sum::<f64>() / SAMPLE_COUNT as f64;
            assert!((variance.sqrt() / sigma - 1.0).abs() < 0.1, "axis {axis}: {}", variance.sqrt() / sigma);
        }
        assert!(posterior.mean().norm() < 0.001);
    }

    /// The outcome probabilities are integrals of the normal distribution: contact left of the wall, hold right of it.
    #[test]
    fn probabilities_are_integrals() {
        let posterior = AimPosterior::new(&UNCERTAINTY);
        let sigma = UNCERTAINTY.arm.hypot(UNCERTAINTY.detector);
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * 2.0_f64.sqrt()));
        for x in [-0.003, 0.0, 0.004] {
            // Halfway between the points of the grid.
            let outcome = posterior.probabilities(&aimed(x), 1);
            assert!((outcome.contact - below(-0.0045 - x)).abs() < 0.06, "{x}: {outcome:?} {}", below(-0.0045 - x));
            assert!((outcome.held - (below(0.0075 - x) - below(-0.0045 - x))).abs() < 0.08, "{x}: {outcome:?}");
        }
        assert!(posterior.probabilities(&aimed(0.006), 1).contact < posterior.probabilities(&aimed(0.0), 1).contact);
    }

    /// The grid of aims has the same outcome probabilities as each aim alone, near rollouts and far from all of them.
    #[test]
    fn probabilities_around_are_those_of_each_aim() {
        let mut posterior = AimPosterior::new(&UNCERTAINTY);
        posterior.update_after_failure(&aimed(0.002), 1);
        for (at, heading, detections) in
            [(0.0, 0.0, 1), (0.004, 0.7, 2), (-0.03, -2.0, 3), (0.5, 0.3, 1), (30.0, 0.0, 1)]
        {
            let middle = AimedGrasp { heading, aim: Vector3::new(at, -0.001, 0.002), ..aimed(0.0) };
            let around = posterior.probabilities_around(&middle, detections);
            for (x, line) in around.iter().enumerate() {
                for (y, found) in line.iter().enumerate() {
                    let beside = Vector3::new(aim_grid_offset(x), aim_grid_offset(y), 0.0);
                    let exact =
                        posterior.probabilities(&AimedGrasp { aim: middle.aim + beside, ..middle.clone() }, detections);
                    let off = (found.held - exact.held).abs().max((found.contact - exact.contact).abs());
                    assert!(off < 1e-12, "({x}, {y}) at {at}: {found:?} {exact:?}");
                }
            }
        }
    }

    /// Far from all rollouts, the probability of a hold is low.
    #[test]
    fn far_from_all_rollouts_nothing_is_promised() {
        let odds = AimPosterior::new(&UNCERTAINTY).probabilities(&aimed(0.1), 1);
        assert!(odds.held < 1e-6 && (odds.contact - 0.5).abs() < 1e-6, "{odds:?}");
    }

    /// After a failure, errors at which the try fails are more likely, and aiming elsewhere pays.
    #[test]
    fn failures_teach() {
        let mut posterior = AimPosterior::new(&UNCERTAINTY);
        let before = posterior.probabilities(&aimed(0.0), 1);
        for _ in 0..3 {
            posterior.update_after_failure(&aimed(0.0), 1);
        }
        assert!((posterior.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(posterior.probabilities(&aimed(0.0), 1).held < before.held - 0.1);
        // A try that aims far to the right and fails indicates that the error is not far to the left.
        let mut right = AimPosterior::new(&UNCERTAINTY);
        right.update_after_failure(&aimed(0.010), 1);
        assert!(right.mean().x > 0.0);
    }

    /// An object that was located by touch is predicted by the rollouts close to its position.
    #[test]
    fn what_was_located_leaves_little_doubt() {
        let covariance = Matrix3::identity() * 0.001_f64.powi(2);
        let located = AimPosterior::from_touch(&covariance).expect("positive definite");
        let (here, seen) =
            (located.probabilities(&aimed(0.002), 1), AimPosterior::new(&UNCERTAINTY).probabilities(&aimed(0.002), 1));
        assert!(here.contact < 0.6 * seen.contact && here.held > seen.held + 0.1, "{here:?} {seen:?}");
        assert!(AimPosterior::from_touch(&Matrix3::zeros()).is_none());
    }

    /// A contact is likely if the felt hold is similar to the holds after which the grasp made contact, and unlikely
    /// otherwise.
    #[test]
    fn probabilities_depend_on_the_felt_hold() {
        let (low, high) = (HeldExtent([0.0; 6]), HeldExtent([0.0, 0.0, 0.0, 0.0, 0.0, 0.02]));
        let after = |hold, outcome| [Rollout { hold: Some(hold), ..Rollout::new(Vector3::zeros(), outcome) }; 10];
        let tried = [after(low, TryOutcome::Contact), after(high, TryOutcome::Held)].concat();
        let odds = |felt: &HeldExtent| {
            let rollout: Arc<[Rollout]> = tried.iter().map(|one| one.reweighted_for_hold(felt)).collect();
            let aimed =
                AimedGrasp { all_rollouts: rollout.clone(), rollouts: rollout, heading: 0.0, aim: Vector3::zeros() };
            AimPosterior::from_touch(&Matrix3::from_diagonal_element(1e-6)).expect("positive").probabilities(&aimed, 1)
        };
        assert!(odds(&low).contact > 0.7 && odds(&high).held > 0.7, "{:?} {:?}", odds(&low), odds(&high));
    }

    /// A grasp that was lucky in its few rollouts does not count as much better than the others of its object.
    #[test]
    fn luck_counts_for_less() {
        let with = |outcome| [Rollout::new(Vector3::zeros(), outcome); 40];
        let (lucky, others) = (with(TryOutcome::Held), [with(TryOutcome::Missed); 5].concat());
        let all: Arc<[Rollout]> = [&lucky[..], &others].concat().into();
        let alone =
            AimedGrasp { rollouts: lucky.into(), all_rollouts: lucky.into(), heading: 0.0, aim: Vector3::zeros() };
        let among = AimedGrasp { all_rollouts: all, ..alone.clone() };
        let posterior = AimPosterior::new(&UNCERTAINTY);
        let (alone, among) = (posterior.probabilities(&alone, 1).held, posterior.probabilities(&among, 1).held);
        assert!(alone > 0.75 && (0.4 * alone..0.6 * alone).contains(&among), "{alone} {among}");
    }

    /// The axes turn with the grasp: an error along the world's y is an error along x for a grasp turned by 90 degrees.
    #[test]
    fn errors_turn_with_the_grasp() {
        let posterior = AimPosterior::new(&UNCERTAINTY);
        let turned =
            AimedGrasp { heading: std::f64::consts::FRAC_PI_2, aim: Vector3::new(0.0, 0.006, 0.0), ..aimed(0.0) };
        let (straight, turned) = (posterior.probabilities(&aimed(0.006), 1), posterior.probabilities(&turned, 1));
        assert!((straight.contact - turned.contact).abs() < 0.06, "{straight:?} {turned:?}");
    }
}
