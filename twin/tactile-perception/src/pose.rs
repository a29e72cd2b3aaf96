//! In-hand object pose by registration of contacts, and of their absence, to a known shape.
//!
//! Unknown are the object's pose in the palm frame, the joint angles of every digit in contact, and, for every pressed
//! pad, the offset of the object from the measured heights along the pad's normal. The evidence is as follows. Surface
//! points of the patches lie on the object, and their normals are the object's normals. Points without contact are
//! outside the object. The cable excursions are as measured. Springs, cable tensions and contact torques balance at
//! each joint, and joints are within their limits. The plan gives a prior of the pose. Many orientations are screened.
//! Levenberg-Marquardt descends from distinct ones, first with large standard deviations, later with a Huber loss and
//! the heights' full precision, and the lowest cost wins.

mod evidence;
mod inputs;
mod problem;
mod residuals;
mod screen;
mod shape;
mod system;
mod uncertainty;

use hand_model::{Hand, HandVector};
use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, Vector3};
use problem::{EvidenceStage, PoseProblem, PoseState};
use rayon::prelude::*;
use screen::screen;
use uncertainty::{alternatives, joint_covariance, misfit, mixed_covariance, unobservable};

use crate::error::TouchError;
use crate::pad_touch::PadTouch;
use crate::posture::{JointCovariance, Readings};

pub use inputs::{PoseInputs, PoseOptions, PosePrior};
pub use shape::KnownShape;

/// Factor from the covariance of a good fit to that of its 95 % region, calibrated on 218 simulated grasps of one seed.
const REGION_FACTOR: f64 = 4.0;

/// An estimated pose with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// `palm_from_object`.
    pub palm_from_object: Isometry3<f64>,
    /// Covariance of position (m; of the object's origin) and rotation (rad; rotation vector), both along the palm's axes.
    pub covariance: Matrix6<f64>,
    /// Ratio of the cost to the one that the standard deviations predict, at least 1.
    pub misfit: f64,
    /// Joint angles, rad: estimated for digits in contact, in free equilibrium for the others.
    pub q: HandVector,
    /// Covariance of the joint angles, rad2, pose integrated out.
    pub q_covariance: JointCovariance,
    /// Root mean square distance of the felt points to the object's surface, m.
    pub residual_rms: f64,
    /// Robust cost of the solution (half the sum of squared, scaled residuals).
    pub cost: f64,
    /// Number of registered patches.
    pub patches: usize,
    /// Number of blind pads.
    pub blind: usize,
    /// Other poses that fit nearly as well, each with its cost above the best: a symmetry, or too few contacts. The
    /// covariance includes them.
    pub alternatives: Vec<(Isometry3<f64>, f64)>,
    /// Rotation axes (palm frame, unit) about which the evidence hardly improves on the prior: a symmetric object, or too few
    /// contacts.
    pub unobservable: Vec<Vector3<f64>>,
    /// Levenberg-Marquardt steps over all starts.
    pub steps: usize,
}

impl PoseEstimate {
    /// Standard deviation of the position (m; root of the mean over the axes) and of the rotation (rad).
    pub fn sigma(&self) -> (f64, f64) {
        let trace = |first: usize| (0..3).map(|i| self.covariance[(first + i, first + i)]).sum::<f64>() / 3.0;
        (trace(0).sqrt(), trace(3).sqrt())
    }

    /// Covariance whose 95 % ellipsoid contains 95 % of true positions. It is wider than [`Self::covariance`], because
    /// errors have heavy tails: most estimates are better than it indicates, and some lie in another local minimum. A
    /// decision that takes it for the spread of a normal distribution avoids grasps that would mostly work.
    pub fn region(&self) -> Matrix6<f64> {
        self.covariance * (REGION_FACTOR * self.misfit)
    }
}

/// Estimates the in-hand pose of an object of known shape. Without any contact the answer is the prior, pushed out of the
/// pads that feel nothing.
///
/// ```
/// use nalgebra::{Isometry3, Point3, Vector3};
/// use tactile_perception::hand_model::Hand;
/// use tactile_perception::hand_model::robot::ServoState;
/// use tactile_perception::{KnownShape, PoseInputs, PoseOptions, PosePrior, Readings, estimate_pose};
///
/// /// A ball of this radius, m.
/// struct Ball(f64);
/// impl KnownShape for Ball {
///     fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
///         (point.coords.norm() - self.0, point.coords.normalize())
///     }
/// }
///
/// // Nothing is felt, and no pad is known to feel nothing: the estimate is the prior.
/// let hand = Hand::ftac();
/// let servos = [ServoState::default(); 6];
/// let prior = PosePrior::weak(Isometry3::translation(0.0, 0.05, -0.08));
/// let estimate = estimate_pose(&PoseInputs {
///     hand: &hand,
///     touches: &[],
///     readings: Readings::without_gravity(&servos),
///     prior: &prior,
///     shape: &Ball(0.03),
///     options: &PoseOptions::default(),
/// })?;
/// let moved = estimate.palm_from_object.translation.vector - prior.palm_from_object.translation.vector;
/// assert!(moved.norm() < 1e-6);
/// # Ok::<(), tactile_perception::TouchError>(())
/// ```
pub fn estimate_pose(inputs: &PoseInputs) -> Result<PoseEstimate, TouchError> {
    let PoseInputs { touches, prior, options, .. } = *inputs;
    let (problem, rest, mut steps) = prepare_problem(inputs)?;
    let mut shifted = PoseState { pose: prior.palm_from_object, ..rest.clone() };
    steps += minimise(&problem, &mut shifted, EvidenceStage::Translation, 6).1;
    let screened = screen(&problem, prior, &shifted, options.starts);
    let starts = [rest, shifted].into_iter().chain(screened).collect();
    let mut found = descend(&problem, starts, &mut steps);
    let bad = |cost: f64| cost > options.good_cost * problem.patch_count() as f64;
    if problem.has_contact() && found.first().is_some_and(|best| bad(best.0)) {
        // A solution with a high cost is probably wrong (another face of a box, for example), so orientations around it
        // are screened too.
        let around = screen(&problem, prior, &found[0].1, options.starts);
        found.extend(descend(&problem, around, &mut steps));
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let (cost, ref state) = *found.first().ok_or(TouchError::Singular("the pose estimate"))?;

    let covariance = mixed_covariance(&problem, &found).ok_or(TouchError::Singular("the pose estimate"))?;
    Ok(PoseEstimate {
        palm_from_object: state.pose,
        unobservable: unobservable(&covariance, prior.sigma_rotation),
        covariance,
        misfit: misfit(&problem, cost),
        q: state.q,
        q_covariance: joint_covariance(&problem, state).ok_or(TouchError::Singular("the posture estimate"))?,
        residual_rms: problem.point_rms(state),
        cost,
        patches: problem.patch_count(),
        blind: touches.iter().filter(|touch| touch.blind).count(),
        alternatives: alternatives(&found),
        steps,
    })
}

/// Costs of an object at `pose` (palm frame), in the units of [`PoseEstimate::cost`]: first with the joints that fit
/// best, then at the minimum that the search reaches downhill from there. At the true pose this distinguishes the two
/// causes of a wrong estimate: the evidence favours the wrong pose, or the search missed the right one.
pub fn costs_from_pose(inputs: &PoseInputs, pose: &Isometry3<f64>) -> Result<[f64; 2], TouchError> {
    let (problem, rest, _) = prepare_problem(inputs)?;
    let mut state = PoseState { pose: *pose, ..rest };
    let mut after = |evidence| {
        minimise(&problem, &mut state, evidence, inputs.options.fine_steps);
        problem.cost(&state, EvidenceStage::All)
    };
    Ok([after(EvidenceStage::Posture), after(EvidenceStage::All)])
}

/// Joint angles (rad) from servos, springs and the forces on the pads, whatever presses there. For digits without
/// contact they are those of [`Posture`](crate::Posture).
pub fn loaded_posture(
    hand: &Hand,
    touches: &[PadTouch],
    readings: Readings,
    options: &PoseOptions,
) -> Result<HandVector, TouchError> {
    struct NoObject;
    impl KnownShape for NoObject {
        fn signed_distance(&self, _: &Point3<f64>) -> (f64, Vector3<f64>) {
            (f64::INFINITY, Vector3::z())
        }
    }
    let prior = PosePrior::weak(Isometry3::identity());
    Ok(prepare_problem(&PoseInputs { hand, touches, readings, prior: &prior, shape: &NoObject, options })?.1.q)
}

/// Checks the inputs. Returns the problem, its start (joints from servos and contact forces without the object, the
/// object as planned) and the number of steps for it.
fn prepare_problem<'a>(inputs: &PoseInputs<'a>) -> Result<(PoseProblem<'a>, PoseState, usize), TouchError> {
    let PoseInputs { hand, touches, readings, prior, .. } = *inputs;
    if let Some(touch) = touches.iter().find(|touch| touch.pad >= hand.pads.len()) {
        return Err(TouchError::Size { what: "pad index of a touch", found: touch.pad, expected: hand.pads.len() });
    }
    if touches.len() > hand.pads.len() {
        return Err(TouchError::Size { what: "number of touches", found: touches.len(), expected: hand.pads.len() });
    }
    if !prior.palm_from_object.to_homogeneous().iter().all(|value| value.is_finite()) {
        return Err(TouchError::NotFinite("the prior pose"));
    }
    if !readings.servos.iter().all(|servo| servo.position.is_finite() && servo.current.is_finite()) {
        return Err(TouchError::NotFinite("a servo reading"));
    }
    if !readings.gravity.iter().all(|value| value.is_finite()) {
        return Err(TouchError::NotFinite("gravity"));
    }
    let mut problem = PoseProblem::new(inputs);
    let mut rest = problem.start(prior.palm_from_object);
    let (_, steps) = minimise(&problem, &mut rest, EvidenceStage::Joints, 10);
    problem.update_torques(&rest.q);
    Ok((problem, rest, steps))
}

/// Descends from every start in three stages, each with the best solutions of the stage before. Returns the final
/// solutions with their costs, best first. Starts are processed in parallel; the result does not depend on the number
/// of threads.
fn descend(problem: &PoseProblem, starts: Vec<PoseState>, steps: &mut usize) -> Vec<(f64, PoseState)> {
    let options = problem.options();
    let mut ranked: Vec<(f64, PoseState)> = starts.into_iter().map(|start| (0.0, start)).collect();
    for (evidence, most, kept) in [
        (EvidenceStage::Soft, options.coarse_steps, options.kept_solutions),
        (EvidenceStage::Middle, options.coarse_steps, options.final_solutions),
        (EvidenceStage::All, options.fine_steps, options.final_solutions),
    ] {
        let descended: Vec<(usize, f64, PoseState)> = ranked
            .into_par_iter()
            .with_max_len(1)
            .map(|(_, mut state)| {
                let (cost, steps) = minimise(problem, &mut state, evidence, most);
                (steps, cost, state)
            })
            .collect();
        *steps += descended.iter().map(|(steps, _, _)| steps).sum::<usize>();
        ranked = descended.into_iter().map(|(_, cost, state)| (cost, state)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked = distinct_solutions(ranked, problem.shape(), kept);
    }
    ranked
}

/// The first `most` solutions without duplicates: descents from several starts may end at the same pose, or at one that a
/// symmetry of the object makes equivalent.
fn distinct_solutions(ranked: Vec<(f64, PoseState)>, shape: &dyn KnownShape, most: usize) -> Vec<(f64, PoseState)> {
    const SAME_POSE_TOLERANCE: (f64, f64) = (3e-4, 0.03);
    const EQUIVALENT_POSE_TOLERANCE: (f64, f64) = (2e-4, 0.01);
    let center = shape.center();
    let mut kept: Vec<(f64, PoseState)> = Vec::with_capacity(most);
    for (cost, state) in ranked {
        let new = |(other_cost, other): &(f64, PoseState)| {
            let away = (other.pose * center - state.pose * center).norm();
            let turned = other.pose.rotation.angle_to(&state.pose.rotation);
            let near = away < SAME_POSE_TOLERANCE.0 && turned < SAME_POSE_TOLERANCE.1;
            !near && (away > EQUIVALENT_POSE_TOLERANCE.0 || cost - other_cost > EQUIVALENT_POSE_TOLERANCE.1 * cost)
        };
        if kept.len() < most && kept.iter().all(new) {
            kept.push((cost, state));
        }
    }
    kept
}

/// Levenberg-Marquardt in place; returns the cost and the number of steps, rejected ones included. Every candidate is
/// linearised at once, because most are accepted and the distances to the shape take most of the time.
fn minimise(problem: &PoseProblem, state: &mut PoseState, evidence: EvidenceStage, most: usize) -> (f64, usize) {
    let mut damping = 1e-3;
    let mut here = problem.linearise(state, evidence);
    let mut steps = 0;
    while steps < most {
        let mut damped: DMatrix<f64> = here.hessian.clone();
        for k in 0..damped.nrows() {
            damped[(k, k)] += damping * damped[(k, k)] + 1e-9;
        }
        steps += 1;
        let Some(step) = damped.cholesky().map(|factor| factor.solve(&-&here.gradient)) else {
            damping *= 10.0;
            continue;
        };
        let candidate = problem.moved(state, &step);
        let there = problem.linearise(&candidate, evidence);
        if there.cost < here.cost {
            let gain = here.cost - there.cost;
            *state = candidate;
            here = there;
            damping = f64::max(damping * 0.2, 1e-7);
            if gain < 1e-5 * (1.0 + here.cost) {
                break;
            }
        } else {
            if step.norm() < 1e-7 {
                break;
            }
            damping *= 6.0;
        }
    }
    (here.cost, steps)
}
