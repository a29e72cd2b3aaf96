//! In-hand object pose by registering what is felt, and what is not, to a known shape.
//!
//! Unknown are the object's pose in the palm frame, the joint angles of every digit that touches, and how far the object stands out of
//! every pressed pad against what its heights say. The evidence: surface points of the patches lie on the object; their normals
//! are the object's; points that feel nothing lie outside it; the cable excursions are as measured; springs, cable tensions and
//! contact torques balance at each joint; joints keep their limits; and the plan said roughly where the object would be. Many
//! orientations are screened, Levenberg-Marquardt goes on from those that differ, softly first, later with a Huber loss and all
//! the exactness that heights have, and the best wins.

mod evidence;
mod problem;
mod residuals;
mod screen;
mod system;
mod uncertainty;

use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, HAND_JOINTS, Hand};
use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, Vector3};
use rayon::prelude::*;

use crate::error::TouchError;
use crate::pipeline::PadTouch;
use problem::{Evidence, Problem, State};
use screen::screen;
use uncertainty::{alternatives, mixed_covariance, unobservable};

/// A shape known in advance, in its own frame.
pub trait KnownShape: Sync {
    /// Signed distance (m, negative inside) of `point` (object frame) and its gradient, the outward unit normal.
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>);

    /// A point near the middle of the shape (object frame): starts are turned about it.
    fn center(&self) -> Point3<f64> {
        Point3::origin()
    }
}

/// Where the plan thinks the object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePrior {
    /// `palm_from_object`.
    pub palm_from_object: Isometry3<f64>,
    /// Standard deviation of the position along each axis, m.
    pub sigma_translation: f64,
    /// Standard deviation of the rotation about each axis, rad.
    pub sigma_rotation: f64,
}

impl PosePrior {
    /// A weak prior: 15 mm, 25 degrees.
    pub fn weak(palm_from_object: Isometry3<f64>) -> Self {
        Self { palm_from_object, sigma_translation: 0.015, sigma_rotation: 25f64.to_radians() }
    }
}

/// Standard deviations of the evidence, and how hard to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseOptions {
    /// Heights of a broad patch, all together, m; those of a narrow one are known less well.
    pub sigma_height: f64,
    /// How far the deepest point of a pressed pad may be from where `sinking` has it, m.
    pub sigma_lift: f64,
    /// Each component of a felt normal, rad.
    pub sigma_normal: f64,
    /// Cable excursion, m.
    pub sigma_excursion: f64,
    /// Torque balance of a joint, N m ...
    pub sigma_torque: f64,
    /// ... and this fraction of the contact torque felt there, root of the sum of squares.
    pub contact_torque_fraction: f64,
    /// Depth of a point that feels nothing inside the object, m.
    pub sigma_clear: f64,
    /// Angle beyond a joint limit, rad.
    pub sigma_limit: f64,
    /// Huber threshold, in standard deviations.
    pub huber: f64,
    /// Share of a felt indentation by which the object really comes closer to the link under the pad. On a gel that yields it
    /// is 1. A body whose covers are rigid, with images made from forces, has 0: the deepest point is then on the pad's
    /// untouched surface.
    pub sinking: f64,
    /// Whether the evidence of untouched surface is used.
    pub use_clear: bool,
    /// Orientations kept of the many that are tried about the plan's.
    pub starts: usize,
    /// Steps of every start, and of those kept.
    pub coarse_steps: usize,
    /// Starts that are kept after their first steps.
    pub kept: usize,
    /// Solutions that are finished ...
    pub finished: usize,
    /// ... in so many steps.
    pub fine_steps: usize,
    /// Cost per patch above which a solution does not explain what is felt, so that more are looked for around it.
    pub good_cost: f64,
}

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            sigma_height: 8e-5,
            sigma_lift: 1e-4,
            sigma_normal: 8f64.to_radians(),
            sigma_excursion: 1.5e-4,
            sigma_torque: 0.03,
            contact_torque_fraction: 0.25,
            sigma_clear: 2.5e-4,
            sigma_limit: 0.02,
            huber: 2.5,
            sinking: 1.0,
            use_clear: true,
            starts: 48,
            coarse_steps: 6,
            kept: 16,
            finished: 6,
            fine_steps: 30,
            good_cost: 2.0,
        }
    }
}

/// An estimated pose and what stands behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// `palm_from_object`.
    pub palm_from_object: Isometry3<f64>,
    /// Covariance of position (m; of the object's origin) and rotation (rad; rotation vector), both along the palm's axes.
    pub covariance: Matrix6<f64>,
    /// Joint angles, rad: estimated for digits that touch, in free equilibrium for the others.
    pub q: [f64; HAND_JOINTS],
    /// Root mean square distance of the felt points to the object's surface, m.
    pub residual_rms: f64,
    /// Robust cost of the solution (half the sum of squared, scaled residuals).
    pub cost: f64,
    /// Number of patches that were registered.
    pub patches: usize,
    /// Number of pads that had no say.
    pub blind: usize,
    /// Other poses that explain what is felt about as well, with the cost of each above the best one's: a symmetry, or too
    /// little touch to tell. The covariance allows for them.
    pub alternatives: Vec<(Isometry3<f64>, f64)>,
    /// Rotation axes (palm frame, unit) about which the evidence adds nothing worth naming to the prior: a symmetric object,
    /// or too few contacts.
    pub unobservable: Vec<Vector3<f64>>,
    /// Levenberg-Marquardt steps taken, all starts together.
    pub steps: usize,
}

impl PoseEstimate {
    /// Standard deviation of the position (m; root of the mean over the axes) and of the rotation (rad).
    pub fn sigma(&self) -> (f64, f64) {
        let trace = |first: usize| (0..3).map(|i| self.covariance[(first + i, first + i)]).sum::<f64>() / 3.0;
        (trace(0).sqrt(), trace(3).sqrt())
    }
}

/// Estimates the in-hand pose of an object of known `shape` from `touches` (at most one element a pad; pads not listed say
/// nothing), `servos` and a `prior`. Without any contact the answer is the prior, pushed out of the pads that feel nothing.
pub fn estimate_pose(
    hand: &Hand,
    touches: &[PadTouch],
    servos: &[ServoState; ACTUATORS],
    prior: &PosePrior,
    shape: &dyn KnownShape,
    options: &PoseOptions,
) -> Result<PoseEstimate, TouchError> {
    let (problem, rest, mut steps) = prepared(hand, touches, servos, prior, shape, options)?;
    let mut shifted = State { pose: prior.palm_from_object, ..rest };
    steps += minimise(&problem, &mut shifted, Evidence::Translation, 6);
    let mut starts = vec![rest, shifted];
    starts.extend(screen(&problem, prior, &shifted, options.starts));
    let mut found = descend(&problem, starts, &mut steps);
    let bad = |cost: f64| cost > options.good_cost * problem.patch_count() as f64;
    if problem.has_contact() && found.first().is_some_and(|best| bad(best.0)) {
        // A solution that leaves its patches unexplained is a wrong one (a box's other face, say): look around it.
        let around = found[0].1;
        found.extend(descend(&problem, screen(&problem, prior, &around, options.starts), &mut steps));
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let (cost, state) = *found.first().ok_or(TouchError::Singular("the pose estimate"))?;

    let covariance = mixed_covariance(&problem, &found).ok_or(TouchError::Singular("the pose estimate"))?;
    Ok(PoseEstimate {
        palm_from_object: state.pose,
        unobservable: unobservable(&covariance, prior.sigma_rotation),
        covariance,
        q: state.q,
        residual_rms: problem.point_rms(&state),
        cost,
        patches: problem.patch_count(),
        blind: touches.iter().filter(|touch| touch.blind).count(),
        alternatives: alternatives(&found),
        steps,
    })
}

/// Cost of an object that is at `pose` (palm frame), as [`PoseEstimate::cost`] counts it, with the joints where that fits best, and
/// the least cost that is reached downhill from there: for those who know the true pose and ask whether an estimate that is off
/// explains what is felt better than the truth, or the search missed it.
pub fn costs_from_pose(
    hand: &Hand,
    touches: &[PadTouch],
    servos: &[ServoState; ACTUATORS],
    prior: &PosePrior,
    shape: &dyn KnownShape,
    options: &PoseOptions,
    pose: &Isometry3<f64>,
) -> Result<[f64; 2], TouchError> {
    let (problem, rest, _) = prepared(hand, touches, servos, prior, shape, options)?;
    let mut state = State { pose: *pose, ..rest };
    let mut after = |evidence| {
        minimise(&problem, &mut state, evidence, options.fine_steps);
        problem.cost(&state, Evidence::All)
    };
    Ok([after(Evidence::Posture), after(Evidence::All)])
}

/// The problem with its state of rest (joints as servos and contact forces have them without the object, the object as
/// planned), and the steps that took.
fn prepared<'a>(
    hand: &'a Hand,
    touches: &[PadTouch],
    servos: &[ServoState; ACTUATORS],
    prior: &'a PosePrior,
    shape: &'a dyn KnownShape,
    options: &'a PoseOptions,
) -> Result<(Problem<'a>, State, usize), TouchError> {
    if let Some(touch) = touches.iter().find(|touch| touch.pad >= hand.pads.len()) {
        return Err(TouchError::Size { what: "pad index of a touch", found: touch.pad, expected: hand.pads.len() });
    }
    if touches.len() > hand.pads.len() {
        return Err(TouchError::Size { what: "number of touches", found: touches.len(), expected: hand.pads.len() });
    }
    if !prior.palm_from_object.to_homogeneous().iter().all(|value| value.is_finite()) {
        return Err(TouchError::NotFinite("the prior pose"));
    }
    if !servos.iter().all(|servo| servo.position.is_finite() && servo.current.is_finite()) {
        return Err(TouchError::NotFinite("a servo reading"));
    }
    let mut problem = Problem::new(hand, touches, servos, prior, shape, options);
    let mut rest = problem.start(prior.palm_from_object);
    let steps = minimise(&problem, &mut rest, Evidence::Joints, 10);
    problem.settle_torque_sigmas(&rest.q);
    Ok((problem, rest, steps))
}

/// Unit vectors that fill the sphere evenly (a golden spiral of 36).
fn direction(k: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * ((k * 11) % 36) + 1) as f64 / 36.0;
    let angle = k as f64 * 2.399963;
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Descends from every start, softly first, and goes on with the best ones only. All that were finished with their costs, best
/// first. Starts are worked on in parallel; the result does not depend on how.
fn descend(problem: &Problem, starts: Vec<State>, steps: &mut usize) -> Vec<(f64, State)> {
    let options = problem.options();
    let mut ranked: Vec<(f64, State)> = starts.into_iter().map(|start| (0.0, start)).collect();
    for (evidence, most, kept) in [
        (Evidence::Soft, options.coarse_steps, options.kept),
        (Evidence::Middle, options.coarse_steps, options.finished),
        (Evidence::All, options.fine_steps, options.finished),
    ] {
        let gone_on: Vec<(usize, f64, State)> = ranked
            .into_par_iter()
            .with_max_len(1)
            .map(|(_, mut state)| {
                let steps = minimise(problem, &mut state, evidence, most);
                (steps, problem.cost(&state, evidence), state)
            })
            .collect();
        *steps += gone_on.iter().map(|(steps, _, _)| steps).sum::<usize>();
        ranked = gone_on.into_iter().map(|(_, cost, state)| (cost, state)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked = different(ranked, problem.shape(), kept);
    }
    ranked
}

/// The first `most` solutions that are not where a better one is, or its mirror: ways from many starts run together, and a symmetric
/// object looks the same from several sides.
fn different(ranked: Vec<(f64, State)>, shape: &dyn KnownShape, most: usize) -> Vec<(f64, State)> {
    const NEAR: (f64, f64) = (3e-4, 0.03);
    const ALIKE: (f64, f64) = (2e-4, 0.01);
    let center = shape.center();
    let mut kept: Vec<(f64, State)> = Vec::with_capacity(most);
    for (cost, state) in ranked {
        let new = |(other_cost, other): &(f64, State)| {
            let away = (other.pose * center - state.pose * center).norm();
            let turned = other.pose.rotation.angle_to(&state.pose.rotation);
            let near = away < NEAR.0 && turned < NEAR.1;
            !near && (away > ALIKE.0 || cost - other_cost > ALIKE.1 * cost)
        };
        if kept.len() < most && kept.iter().all(new) {
            kept.push((cost, state));
        }
    }
    kept
}

/// Levenberg-Marquardt in place; returns the number of steps tried.
fn minimise(problem: &Problem, state: &mut State, evidence: Evidence, most: usize) -> usize {
    let mut damping = 1e-3;
    let mut cost = problem.cost(state, evidence);
    let mut steps = 0;
    let mut system = None;
    while steps < most {
        let (hessian, gradient) = system.get_or_insert_with(|| problem.linearise(state, evidence));
        let mut damped: DMatrix<f64> = hessian.clone();
        for k in 0..damped.nrows() {
            damped[(k, k)] += damping * damped[(k, k)] + 1e-9;
        }
        steps += 1;
        let Some(step) = damped.cholesky().map(|factor| factor.solve(&-&*gradient)) else {
            damping *= 10.0;
            continue;
        };
        let candidate = problem.moved(state, &step);
        let new = problem.cost(&candidate, evidence);
        if new < cost {
            let gain = cost - new;
            *state = candidate;
            cost = new;
            system = None;
            damping = f64::max(damping * 0.2, 1e-7);
            if gain < 1e-5 * (1.0 + cost) {
                break;
            }
        } else {
            if step.norm() < 1e-7 {
                break;
            }
            damping *= 6.0;
        }
    }
    steps
}
