//! External force on the hand, from the torques of the arm's joints.

pub use hand_model::gravity::{ArmTorques, gravity_torques, pack_torques, point_force_torques};
use hand_model::robot::ArmState;
use hand_model::{Arm, GRAVITY, RobotModel};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// Minimum share of an object's weight on the hand for it to count as held.
const MIN_WEIGHT_SHARE: f64 = 0.5;

/// Returns the pose of the palm in the frame of the arm's base for a robot with encoder angles `angles`.
pub(crate) fn palm_pose(robot: &RobotModel, angles: &[f64]) -> Isometry3<f64> {
    let RobotModel { hand, arm, .. } = robot;
    arm.tool_pose(angles) * hand.palm_from_flange.inverse()
}

/// Returns the force on the hand, assumed to act at the palm's origin ([`estimate_force`]).
pub(crate) fn force_on_palm(own: &RobotModel, states: [&ArmState; 2]) -> Option<Vector3<f64>> {
    estimate_force(own, states, &palm_pose(own, &states[1].position).translation.vector.into())
}

/// True if the additional load on the hand is more than half of the weight of `mass` (kg).
pub(crate) fn bears_load(own: &RobotModel, states: [&ArmState; 2], mass: f64) -> bool {
    force_on_palm(own, states).is_some_and(|force| -force.z > MIN_WEIGHT_SHARE * mass * GRAVITY)
}

/// Returns the joint torques that hold a `force` (N) at a `point` of the last link of an arm whose links are at
/// `poses`, N m.
pub(crate) fn holding_torques(
    arm: &Arm,
    poses: &[Isometry3<f64>],
    point: &Point3<f64>,
    force: &Vector3<f64>,
) -> ArmTorques {
    point_force_torques(arm, poses, arm.last_link(), point, force)
}

/// Estimates the external force (N, axes of the arm's base) at `point` of the hand that best explains the change of the
/// arm's torques from `before` contact to `now`. It is a pure force without a torque. Returns none if the posture of
/// the arm does not determine it.
pub fn estimate_force(robot: &RobotModel, [before, now]: [&ArmState; 2], point: &Point3<f64>) -> Option<Vector3<f64>> {
    let arm = &robot.arm;
    let heavier = gravity_torques(robot, &now.position) - gravity_torques(robot, &before.position);
    let more = pack_torques(&arm.true_torques(&now.torque)) - pack_torques(&arm.true_torques(&before.torque)) - heavier;
    let poses = arm.tree.forward(&now.position);
    let slopes =
        [0, 1, 2].map(|axis| point_force_torques(arm, &poses, arm.last_link(), point, &Vector3::ith(axis, 1.0)));
    let square = Matrix3::from_fn(|i, j| slopes[i].dot(&slopes[j]));
    let sums = Vector3::from_fn(|i, _| slopes[i].dot(&more));
    square.cholesky().map(|root| root.solve(&sums))
}

#[cfg(test)]
mod tests {
    use hand_model::ArmVector;

    use super::*;

    /// A force is recovered from the torques that hold it, wherever the arm has moved meanwhile.
    #[test]
    fn a_force_is_found_again() {
        let robot = RobotModel::ftac_gen3();
        let arm = &robot.arm;
        let from = arm.home;
        let to: ArmVector = from.iter().map(|angle| angle + 0.07).collect();
        let push = Vector3::new(0.4, -1.1, 2.3);
        let point = arm.tool_pose(&to) * Point3::new(0.01, -0.03, 0.1);
        let of = |angles: ArmVector, force: Vector3<f64>| {
            let torque = gravity_torques(&robot, &angles)
                + point_force_torques(arm, &arm.tree.forward(&angles), arm.last_link(), &point, &force);
            ArmState { position: angles, velocity: arm.each(|_| 0.0), torque: torque.iter().copied().collect() }
        };
        let found = estimate_force(&robot, [&of(from, Vector3::zeros()), &of(to, push)], &point).expect("a force");
        assert!((found - push).norm() < 1e-9, "{found}");
    }
}
