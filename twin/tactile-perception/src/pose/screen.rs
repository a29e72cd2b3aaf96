//! Screening of initial orientations: many are tried around the planned one, each translated to fit the contact points,
//! and the best are kept.
//!
//! The joints stay as given by the servos, so that a candidate costs only a few distance evaluations.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use super::evidence::ContactPoint;
use super::inputs::PosePrior;
use super::problem::{PoseProblem, PoseState};
use super::shape::KnownShape;

// Angles by which the planned orientation is rotated, rad, and the number of axes for each.
const SCREENING_ANGLES: [f64; 5] = [0.2, 0.45, 0.75, 1.1, 1.5];
const AXIS_COUNT: usize = 16;
/// Points and normals per patch.
const PATCH_POINTS: usize = 4;
/// Standard deviations of a point (m) and a normal (rad) before the joints are adjusted.
const SCREENING_SIGMA: (f64, f64) = (2e-3, 0.3);
/// Residuals are clipped at this many standard deviations.
const RESIDUAL_CLIP: f64 = 3.0;
/// Kept starts differ by at least this angle, rad.
const MIN_START_ANGLE: f64 = 0.15;
/// Of candidates with centres closer than this (m) and costs that differ by less than this share, one is kept: they are
/// equivalent by a symmetry of the object.
const DUPLICATE_TOLERANCE: (f64, f64) = (1e-3, 0.02);

/// The best `keep` initial states around `state`, best first.
pub(super) fn screen(problem: &PoseProblem, prior: &PosePrior, state: &PoseState, keep: usize) -> Vec<PoseState> {
    let felt = problem.contact_points(state, PATCH_POINTS);
    if felt.is_empty() {
        return Vec::new();
    }
    let (shape, center) = (problem.shape(), problem.shape().center());
    let mut ranked: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(1 + SCREENING_ANGLES.len() * AXIS_COUNT);
    for k in 0..=SCREENING_ANGLES.len() * AXIS_COUNT {
        let turn = match k.checked_sub(1) {
            None => UnitQuaternion::identity(),
            Some(k) => UnitQuaternion::new(direction(k) * SCREENING_ANGLES[k % SCREENING_ANGLES.len()]),
        };
        let rotation = turn * state.pose.rotation;
        let start = state.pose * center - rotation * center;
        let pose = translated_to_fit(shape, prior, &felt, Isometry3::from_parts(Translation3::from(start), rotation));
        ranked.push((cost(shape, prior, &felt, &pose), pose));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(keep);
    for (cost, pose) in ranked {
        let other = |(other_cost, other): &(f64, Isometry3<f64>)| {
            let far = (other * center - pose * center).norm() > DUPLICATE_TOLERANCE.0
                || cost - other_cost > DUPLICATE_TOLERANCE.1 * cost;
            far && other.rotation.angle_to(&pose.rotation) > MIN_START_ANGLE
        };
        if kept.len() < keep && kept.iter().all(other) {
            kept.push((cost, pose));
        }
    }
    kept.into_iter().map(|(_, pose)| PoseState { pose, ..state.clone() }).collect()
}

/// Unit vectors spread evenly over the sphere (a golden spiral of 36).
fn direction(k: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * ((k * 11) % 36) + 1) as f64 / 36.0;
    let angle = k as f64 * 2.399963;
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Translates the pose to fit the points, by three Gauss-Newton steps.
fn translated_to_fit(
    shape: &dyn KnownShape,
    prior: &PosePrior,
    felt: &[ContactPoint],
    mut pose: Isometry3<f64>,
) -> Isometry3<f64> {
    let (near, held) = (SCREENING_SIGMA.0.powi(-2), prior.sigma_translation.powi(-2));
    for _ in 0..3 {
        let mut hessian = Matrix3::identity() * held;
        let mut gradient = (pose.translation.vector - prior.palm_from_object.translation.vector) * held;
        for (point, _, weight) in felt {
            let (distance, normal) = shape.signed_distance(&pose.inverse_transform_point(point));
            let normal = pose * normal;
            let huber = (RESIDUAL_CLIP * SCREENING_SIGMA.0 / distance.abs().max(1e-12)).min(1.0) * weight * near;
            hessian += normal * normal.transpose() * huber;
            gradient -= normal * distance * huber;
        }
        let Some(factor) = hessian.cholesky() else { break };
        pose.translation.vector -= factor.solve(&gradient);
    }
    pose
}

fn cost(shape: &dyn KnownShape, prior: &PosePrior, felt: &[ContactPoint], pose: &Isometry3<f64>) -> f64 {
    let deviation = prior.palm_from_object.inverse() * pose;
    let mut sum = (deviation.translation.vector.norm() / prior.sigma_translation).powi(2)
        + (deviation.rotation.angle() / prior.sigma_rotation).powi(2);
    for (point, normal, weight) in felt {
        let (distance, gradient) = shape.signed_distance(&pose.inverse_transform_point(point));
        let off = (pose.inverse_transform_vector(normal) - gradient).norm();
        sum += weight
            * ((distance / SCREENING_SIGMA.0).powi(2).min(RESIDUAL_CLIP * RESIDUAL_CLIP)
                + (off / SCREENING_SIGMA.1).powi(2).min(RESIDUAL_CLIP * RESIDUAL_CLIP));
    }
    sum
}
