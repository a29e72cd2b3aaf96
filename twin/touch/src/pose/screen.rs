//! A wide first look: many orientations about the plan's, each moved to where its felt points fit, the best ones kept.
//!
//! Joints stay as the servos have them, so that a try costs a few distances; what is kept is a start for the real search.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use super::evidence::FeltPoint;
use super::inputs::PosePrior;
use super::problem::{Problem, State};
use super::shape::KnownShape;

/// Angles by which the plan is turned, rad, and the number of axes for each.
const ANGLES: [f64; 5] = [0.2, 0.45, 0.75, 1.1, 1.5];
const AXES: usize = 16;
/// Felt points and normals of a patch that are looked at.
const POINTS: usize = 4;
/// How far a felt point (m) and normal (rad) may be off before joints are moved.
const SIGMA: (f64, f64) = (2e-3, 0.3);
/// Residuals beyond so many standard deviations count no more.
const CUT: f64 = 3.0;
/// Kept starts differ by at least this angle, rad.
const APART: f64 = 0.15;
/// Of starts whose middles are as close as this (m) and whose costs differ by this share or less, one is kept: a symmetric object
/// looks the same.
const ALIKE: (f64, f64) = (1e-3, 0.02);

/// The best `keep` starts of all tried, best first, about `state`.
pub(super) fn screen(problem: &Problem, prior: &PosePrior, state: &State, keep: usize) -> Vec<State> {
    let felt = problem.felt(state, POINTS);
    if felt.is_empty() {
        return Vec::new();
    }
    let (shape, center) = (problem.shape(), problem.shape().center());
    let mut ranked: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(1 + ANGLES.len() * AXES);
    for k in 0..=ANGLES.len() * AXES {
        let turn = match k.checked_sub(1) {
            None => UnitQuaternion::identity(),
            Some(k) => UnitQuaternion::new(direction(k) * ANGLES[k % ANGLES.len()]),
        };
        let rotation = turn * state.pose.rotation;
        let start = state.pose * center - rotation * center;
        let pose = settled(shape, prior, &felt, Isometry3::from_parts(Translation3::from(start), rotation));
        ranked.push((cost(shape, prior, &felt, &pose), pose));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept: Vec<(f64, Isometry3<f64>)> = Vec::with_capacity(keep);
    for (cost, pose) in ranked {
        let other = |(other_cost, other): &(f64, Isometry3<f64>)| {
            let far = (other * center - pose * center).norm() > ALIKE.0 || cost - other_cost > ALIKE.1 * cost;
            far && other.rotation.angle_to(&pose.rotation) > APART
        };
        if kept.len() < keep && kept.iter().all(other) {
            kept.push((cost, pose));
        }
    }
    kept.into_iter().map(|(_, pose)| State { pose, ..*state }).collect()
}

/// Unit vectors that fill the sphere evenly (a golden spiral of 36).
fn direction(k: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * ((k * 11) % 36) + 1) as f64 / 36.0;
    let angle = k as f64 * 2.399963;
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

/// The pose moved, not turned, to where the points fit: three Gauss-Newton steps.
fn settled(shape: &dyn KnownShape, prior: &PosePrior, felt: &[FeltPoint], mut pose: Isometry3<f64>) -> Isometry3<f64> {
    let (near, held) = (SIGMA.0.powi(-2), prior.sigma_translation.powi(-2));
    for _ in 0..3 {
        let mut hessian = Matrix3::identity() * held;
        let mut gradient = (pose.translation.vector - prior.palm_from_object.translation.vector) * held;
        for (point, _, weight) in felt {
            let (distance, normal) = shape.signed_distance(&pose.inverse_transform_point(point));
            let normal = pose * normal;
            let huber = (CUT * SIGMA.0 / distance.abs().max(1e-12)).min(1.0) * weight * near;
            hessian += normal * normal.transpose() * huber;
            gradient -= normal * distance * huber;
        }
        let Some(factor) = hessian.cholesky() else { break };
        pose.translation.vector -= factor.solve(&gradient);
    }
    pose
}

fn cost(shape: &dyn KnownShape, prior: &PosePrior, felt: &[FeltPoint], pose: &Isometry3<f64>) -> f64 {
    let deviation = prior.palm_from_object.inverse() * pose;
    let mut sum = (deviation.translation.vector.norm() / prior.sigma_translation).powi(2)
        + (deviation.rotation.angle() / prior.sigma_rotation).powi(2);
    for (point, normal, weight) in felt {
        let (distance, gradient) = shape.signed_distance(&pose.inverse_transform_point(point));
        let off = (pose.inverse_transform_vector(normal) - gradient).norm();
        sum += weight * ((distance / SIGMA.0).powi(2).min(CUT * CUT) + (off / SIGMA.1).powi(2).min(CUT * CUT));
    }
    sum
}
