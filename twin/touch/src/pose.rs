//! In-hand object pose by registering what is felt, and what is not, to a known shape.
//!
//! Unknown are the object's pose in the palm frame and the joint angles of every digit that touches. The evidence: surface
//! points of the patches lie on the object; their normals are the object's; points that feel nothing lie outside it; the cable
//! excursions are as measured; springs, cable tensions and contact torques balance at each joint; joints keep their limits;
//! and the plan said roughly where the object would be. Levenberg-Marquardt from several starts, Huber loss, best one wins.

mod problem;
mod system;

use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, HAND_JOINTS, Hand};
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};

use crate::error::TouchError;
use crate::pipeline::PadTouch;
use problem::{Evidence, Problem, State};

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
    /// Distance of a felt point to the object's surface, m.
    pub sigma_point: f64,
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
    /// Whether the evidence of untouched surface is used.
    pub use_clear: bool,
    /// Angle (rad) by which the extra starts are turned about the three palm axes, both ways.
    pub start_rotation: f64,
    /// Steps of every start.
    pub coarse_steps: usize,
    /// Steps of the best two.
    pub fine_steps: usize,
    /// Cost per patch below which a solution explains what is felt ...
    pub good_cost: f64,
    /// ... and how many times six more starts are tried while there is none.
    pub extra_rounds: usize,
}

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            sigma_point: 4e-4,
            sigma_normal: 8f64.to_radians(),
            sigma_excursion: 5e-4,
            sigma_torque: 0.03,
            contact_torque_fraction: 0.25,
            sigma_clear: 1e-3,
            sigma_limit: 0.02,
            huber: 2.5,
            use_clear: true,
            start_rotation: 0.45,
            coarse_steps: 8,
            fine_steps: 30,
            good_cost: 1.7,
            extra_rounds: 4,
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
    if let Some(touch) = touches.iter().find(|touch| touch.pad >= hand.pads.len()) {
        return Err(TouchError::Size { what: "pad index of a touch", found: touch.pad, expected: hand.pads.len() });
    }
    if !prior.palm_from_object.to_homogeneous().iter().all(|value| value.is_finite()) {
        return Err(TouchError::NotFinite("the prior pose"));
    }
    if !servos.iter().all(|servo| servo.position.is_finite() && servo.current.is_finite()) {
        return Err(TouchError::NotFinite("a servo reading"));
    }
    let mut problem = Problem::new(hand, touches, servos, prior, shape, options);
    let mut steps = 0;

    // Joints first: what servos and contact forces say without the object.
    let mut rest = State { pose: prior.palm_from_object, q: problem.posture.q };
    steps += minimise(&problem, &mut rest, Evidence::Joints, 10);
    problem.settle_torque_sigmas(&rest.q);

    let mut shifted = State { pose: prior.palm_from_object, ..rest };
    steps += minimise(&problem, &mut shifted, Evidence::Translation, 6);
    let mut starts = vec![rest, shifted];
    if problem.has_contact() {
        let center = shape.center();
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            for sign in [-1.0, 1.0] {
                let turn = UnitQuaternion::new(axis * sign * options.start_rotation);
                let rotation = turn * shifted.pose.rotation;
                let translation = shifted.pose * center - rotation * center;
                starts
                    .push(State { pose: Isometry3::from_parts(Translation3::from(translation), rotation), q: rest.q });
            }
        }
    }
    let mut best = descend(&problem, starts, &mut steps).ok_or(TouchError::Singular("the pose estimate"))?;
    // A solution that leaves its patches unexplained is a wrong one (a box's other face, say): look around the prior and the
    // best so far, a fixed pattern of shifts and turns.
    for round in 0..options.extra_rounds {
        if !problem.has_contact() || best.0 < options.good_cost * problem.patch_count() as f64 {
            break;
        }
        let around = if round % 2 == 0 { shifted } else { best.1 };
        let starts = (0..6).map(|k| {
            let turn = UnitQuaternion::new(
                direction(6 * round + k) * options.start_rotation * if k % 2 == 0 { 1.2 } else { 0.6 },
            );
            let shift = direction(6 * round + k + 17) * prior.sigma_translation * 0.6;
            let center = shape.center();
            let rotation = turn * around.pose.rotation;
            let translation = around.pose * center + shift - rotation * center;
            State { pose: Isometry3::from_parts(Translation3::from(translation), rotation), q: rest.q }
        });
        let found = descend(&problem, starts.collect(), &mut steps);
        best = found.filter(|found| found.0 < best.0).unwrap_or(best);
    }
    let (cost, state) = best;

    let covariance = palm_covariance(&problem, &state).ok_or(TouchError::Singular("the pose estimate"))?;
    Ok(PoseEstimate {
        palm_from_object: state.pose,
        unobservable: unobservable(&covariance, prior.sigma_rotation),
        covariance,
        q: state.q,
        residual_rms: problem.point_rms(&state),
        cost,
        patches: problem.patch_count(),
        steps,
    })
}

/// Unit vectors that fill the sphere evenly (a golden spiral of 36).
fn direction(k: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * ((k * 11) % 36) + 1) as f64 / 36.0;
    let angle = k as f64 * 2.399963;
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Descends from every start, softly first; finishes the best two and returns the better one with its cost.
fn descend(problem: &Problem, starts: Vec<State>, steps: &mut usize) -> Option<(f64, State)> {
    let mut ranked: Vec<(f64, State)> = Vec::with_capacity(starts.len());
    for mut start in starts {
        *steps += minimise(problem, &mut start, Evidence::Soft, problem.options().coarse_steps);
        *steps += minimise(problem, &mut start, Evidence::All, problem.options().coarse_steps);
        ranked.push((problem.cost(&start, Evidence::All), start));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    ranked.truncate(2);
    for (cost, state) in &mut ranked {
        *steps += minimise(problem, state, Evidence::All, problem.options().fine_steps);
        *cost = problem.cost(state, Evidence::All);
    }
    ranked.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))
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

/// Marginal covariance of the pose, joints integrated out, in palm axes.
fn palm_covariance(problem: &Problem, state: &State) -> Option<Matrix6<f64>> {
    let (mut hessian, _) = problem.linearise(state, Evidence::All);
    for k in 0..hessian.nrows() {
        hessian[(k, k)] += 1e-9;
    }
    let inverse = hessian.cholesky()?.inverse();
    let local: Matrix6<f64> = inverse.fixed_view::<6, 6>(0, 0).into_owned();
    let rotation = state.pose.rotation.to_rotation_matrix();
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    Some(turn * local * turn.transpose())
}

/// Axes about which the rotation is hardly better known than before.
fn unobservable(covariance: &Matrix6<f64>, sigma_rotation: f64) -> Vec<Vector3<f64>> {
    let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
    let eigen = block.symmetric_eigen();
    (0..3)
        .filter(|&i| eigen.eigenvalues[i] > (0.8 * sigma_rotation).powi(2))
        .map(|i| eigen.eigenvectors.column(i).into_owned())
        .collect()
}
