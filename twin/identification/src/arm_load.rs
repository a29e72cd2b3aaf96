//! What pushes on the hand, from the torques of the arm's joints.

use hand_model::robot::ArmState;
use hand_model::{ARM_JOINTS, Arm, GRAVITY, HAND_JOINTS, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, SVector, Vector3};

type Torques = SVector<f64, ARM_JOINTS>;

/// Something is in the hand where at least this share of its weight is felt.
const FELT: f64 = 0.5;

/// Torques that hold the arm and an open hand against their weight, N m.
pub fn weight(hand: &Hand, arm: &Arm, angles: &[f64; ARM_JOINTS]) -> Torques {
    let poses = arm.tree.forward(angles);
    let palm = poses[ARM_JOINTS - 1] * arm.last_from_tool * hand.palm_from_flange.inverse();
    let links = hand.tree.forward(&[0.0; HAND_JOINTS]);
    let of_arm =
        arm.masses.iter().zip(&poses).enumerate().map(|(link, (mass, pose))| (link, mass.mass, pose * mass.com));
    let on_palm = |pose: Isometry3<f64>, mass: &hand_model::hand::MassProperties| {
        (ARM_JOINTS - 1, mass.mass, palm * pose * mass.com)
    };
    let of_hand = links.iter().zip(&hand.masses).map(|(pose, mass)| on_palm(*pose, mass));
    let palm_itself = std::iter::once(on_palm(Isometry3::identity(), &hand.palm_mass));
    let mut torques = Torques::zeros();
    for (link, mass, middle) in of_arm.chain(of_hand).chain(palm_itself) {
        torques += held(arm, &poses, link, &middle, &Vector3::new(0.0, 0.0, -GRAVITY * mass));
    }
    torques
}

/// The palm of a robot whose encoders show `angles`, in the frame of the arm's base.
pub(crate) fn palm((hand, arm): (&Hand, &Arm), angles: &[f64; ARM_JOINTS]) -> Isometry3<f64> {
    arm.tool_pose(angles) * hand.palm_from_flange.inverse()
}

/// The force at the palm ([`force`]).
pub(crate) fn force_on_palm(own: (&Hand, &Arm), states: [&ArmState; 2]) -> Option<Vector3<f64>> {
    force(own, states, &palm(own, &states[1].position).translation.vector.into())
}

/// Whether the hand bears at least half of a `mass` (kg) more than it did.
pub(crate) fn bears(own: (&Hand, &Arm), states: [&ArmState; 2], mass: f64) -> bool {
    force_on_palm(own, states).is_some_and(|force| -force.z > FELT * mass * GRAVITY)
}

/// Torques that hold the last link of an arm whose links are at `poses` against a `force` (N) at a point of it, N m.
pub(crate) fn held_by_last(arm: &Arm, poses: &[Isometry3<f64>], point: &Point3<f64>, force: &Vector3<f64>) -> Torques {
    held(arm, poses, ARM_JOINTS - 1, point, force)
}

/// Torques that hold a link against a `force` (N) at a point of it, N m.
fn held(arm: &Arm, poses: &[Isometry3<f64>], link: usize, point: &Point3<f64>, force: &Vector3<f64>) -> Torques {
    let jacobian = arm.tree.jacobian(poses, link, &poses[link].inverse_transform_point(point));
    Torques::from_fn(|joint, _| -jacobian.fixed_view::<3, 1>(0, joint).dot(force))
}

/// The force (N, axes of the arm's base) at `point` of the hand that explains best by how much the arm's torques `now` differ from those `before`,
/// when nothing touched the hand; a force alone, no torque. None where the arm's posture does not tell.
pub fn force((hand, arm): (&Hand, &Arm), [before, now]: [&ArmState; 2], point: &Point3<f64>) -> Option<Vector3<f64>> {
    let heavier = weight(hand, arm, &now.position) - weight(hand, arm, &before.position);
    let more = Torques::from(arm.borne(&now.torque)) - Torques::from(arm.borne(&before.torque)) - heavier;
    let poses = arm.tree.forward(&now.position);
    let slopes = [0, 1, 2].map(|axis| held(arm, &poses, ARM_JOINTS - 1, point, &Vector3::ith(axis, 1.0)));
    let square = Matrix3::from_fn(|i, j| slopes[i].dot(&slopes[j]));
    let sums = Vector3::from_fn(|i, _| slopes[i].dot(&more));
    square.cholesky().map(|root| root.solve(&sums))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The torques of weight are the slope of its energy.
    #[test]
    fn weight_is_the_slope_of_energy() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let energy = |angles: &[f64; ARM_JOINTS]| {
            let poses = arm.tree.forward(angles);
            let palm = arm.tool_pose(angles) * hand.palm_from_flange.inverse();
            let links = hand.tree.forward(&[0.0; HAND_JOINTS]);
            let of_arm: f64 = arm.masses.iter().zip(&poses).map(|(mass, pose)| mass.mass * (pose * mass.com).z).sum();
            let of_hand: f64 =
                hand.masses.iter().zip(&links).map(|(mass, pose)| mass.mass * (palm * pose * mass.com).z).sum();
            GRAVITY * (of_arm + of_hand + hand.palm_mass.mass * (palm * hand.palm_mass.com).z)
        };
        let at = [0.3, -0.5, 0.2, 1.7, -0.4, 0.9, 0.1];
        let torques = weight(&hand, &arm, &at);
        for joint in 0..ARM_JOINTS {
            let moved = |by: f64| std::array::from_fn(|n| at[n] + if n == joint { by } else { 0.0 });
            let slope = (energy(&moved(1e-5)) - energy(&moved(-1e-5))) / 2e-5;
            assert!((torques[joint] - slope).abs() < 1e-6, "{joint}: {} {slope}", torques[joint]);
        }
    }

    /// A force is found again from the torques that hold it, wherever the arm has gone meanwhile.
    #[test]
    fn a_force_is_found_again() {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let (from, to) = (Arm::home(), Arm::home().map(|angle| angle + 0.07));
        let push = Vector3::new(0.4, -1.1, 2.3);
        let point = arm.tool_pose(&to) * Point3::new(0.01, -0.03, 0.1);
        let of = |angles: [f64; ARM_JOINTS], force: Vector3<f64>| {
            let torque =
                weight(&hand, &arm, &angles) + held(&arm, &arm.tree.forward(&angles), ARM_JOINTS - 1, &point, &force);
            ArmState { position: angles, velocity: [0.0; ARM_JOINTS], torque: torque.into() }
        };
        let found = force((&hand, &arm), [&of(from, Vector3::zeros()), &of(to, push)], &point).expect("a force");
        assert!((found - push).norm() < 1e-9, "{found}");
    }
}
