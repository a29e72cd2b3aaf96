//! Uncertainty of an estimate: its covariance, alternative poses, and axes that the evidence does not constrain.

use hand_model::transmission::Crossing;
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, Vector3, Vector6};

use super::problem::{EvidenceStage, PoseProblem, PoseState};
use crate::posture::{JointCovariance, free_covariance};

/// Cost difference at which a solution is less likely by the factor e.
const E_FOLD_COST: f64 = 2.0;
/// Factor on a solution's covariance for unmodelled errors, calibrated so that errors of simulated grasps lie within it
/// as often as it predicts.
const COVARIANCE_INFLATION: f64 = 1.5;

/// Distinct solutions, away from the best one, with little additional cost.
pub(super) fn alternatives(found: &[(f64, PoseState)]) -> Vec<(Isometry3<f64>, f64)> {
    const MAX_EXTRA_COST: f64 = 2.0;
    const MIN_POSE_DIFFERENCE: (f64, f64) = (3e-3, 0.17);
    let mut kept: Vec<(Isometry3<f64>, f64)> = Vec::new();
    for (cost, state) in found {
        let apart = |pose: &Isometry3<f64>| {
            let between = pose.inverse() * state.pose;
            between.translation.vector.norm() > MIN_POSE_DIFFERENCE.0
                || between.rotation.angle() > MIN_POSE_DIFFERENCE.1
        };
        if cost - found[0].0 < MAX_EXTRA_COST && kept.iter().all(|(pose, _)| apart(pose)) {
            kept.push((state.pose, cost - found[0].0));
        }
    }
    kept.into_iter().skip(1).collect()
}

/// Covariance of the best solution's error, given that one of the others may be right: the second moment about the best
/// solution of the mixture of all, each with its own [`palm_covariance`] and weighted by its likelihood. A direction that
/// no contact constrains keeps the prior's variance.
pub(super) fn mixed_covariance(problem: &PoseProblem, found: &[(f64, PoseState)]) -> Option<Matrix6<f64>> {
    let (least, best) = found.first()?;
    let (mut sum, mut whole) = (Matrix6::zeros(), 0.0);
    for (cost, state) in found {
        let weight = ((least - cost) / E_FOLD_COST).exp();
        if weight < 1e-4 {
            break;
        }
        let Some(own) = palm_covariance(problem, state) else { continue };
        let shift = state.pose.translation.vector - best.pose.translation.vector;
        let turn = (state.pose.rotation * best.pose.rotation.inverse()).scaled_axis();
        let away = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        sum += (own * COVARIANCE_INFLATION + away * away.transpose()) * weight;
        whole += weight;
    }
    (whole > 0.0).then(|| sum / whole)
}

/// Ratio of the best solution's cost to the one that the standard deviations predict, at least 1: the Birge ratio of
/// metrology, by which the covariance of such a fit is to be multiplied.
pub(super) fn misfit(problem: &PoseProblem, cost: f64) -> f64 {
    let promised = problem.options().good_cost * problem.patch_count().max(1) as f64;
    (cost / promised).max(1.0)
}

/// Marginal covariance of the pose, joints integrated out, in palm axes.
fn palm_covariance(problem: &PoseProblem, state: &PoseState) -> Option<Matrix6<f64>> {
    let inverse = inverse_hessian(problem, state)?;
    let local: Matrix6<f64> = inverse.fixed_view::<6, 6>(0, 0).into_owned();
    let rotation = state.pose.rotation.to_rotation_matrix();
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    Some(turn * local * turn.transpose())
}

/// Covariance of all estimated parameters.
fn inverse_hessian(problem: &PoseProblem, state: &PoseState) -> Option<DMatrix<f64>> {
    let mut hessian = problem.linearise(state, EvidenceStage::All).hessian;
    for k in 0..hessian.nrows() {
        hessian[(k, k)] += 1e-9;
    }
    Some(hessian.cholesky()?.inverse())
}

/// Covariance of the joint angles. For digits in contact, pose and lifts are integrated out; for the others, it is that
/// of free digits.
pub(super) fn joint_covariance(problem: &PoseProblem, state: &PoseState) -> Option<JointCovariance> {
    let inverse = inverse_hessian(problem, state)?;
    let options = problem.options();
    let mut covariance = JointCovariance::zeros(problem.posture.q.len(), problem.posture.q.len());
    for (cable, path) in problem.hand.transmission.cables.iter().enumerate() {
        if problem.cables.contains(&cable) {
            continue;
        }
        let posture = (&problem.posture.q[..], problem.posture.excursions[cable]);
        let own = free_covariance(problem.hand, cable, posture, options.sigma_excursion, &options.cables);
        for (a, Crossing { joint: joint_a, .. }) in path.joints.iter().enumerate() {
            for (b, Crossing { joint: joint_b, .. }) in path.joints.iter().enumerate() {
                covariance[(*joint_a, *joint_b)] = own[(a, b)];
            }
        }
    }
    for (a, column_a) in problem.column.iter().enumerate() {
        for (b, column_b) in problem.column.iter().enumerate() {
            if let (Some(column_a), Some(column_b)) = (column_a, column_b) {
                covariance[(a, b)] = inverse[(*column_a, *column_b)] * COVARIANCE_INFLATION;
            }
        }
    }
    Some(covariance)
}

/// Axes about which the rotation is hardly better known than from the prior.
pub(super) fn unobservable(covariance: &Matrix6<f64>, sigma_rotation: f64) -> Vec<Vector3<f64>> {
    let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(3, 3).into_owned();
    let eigen = block.symmetric_eigen();
    (0..3)
        .filter(|&i| eigen.eigenvalues[i] > (0.8 * sigma_rotation).powi(2))
        .map(|i| eigen.eigenvectors.column(i).into_owned())
        .collect()
}
