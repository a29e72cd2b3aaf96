//! Static loads on the arm's joints from the weight of arm and hand and from forces on its links.
//!
//! ```
//! use hand_model::RobotModel;
//! use hand_model::gravity::gravity_torques;
//!
//! let robot = RobotModel::ftac_gen3();
//! let torques = gravity_torques(&robot, &robot.arm.home);
//! // The vertical joint at the base bears no weight, the shoulder bears most of it.
//! assert!(torques[0].abs() < 1e-6 && torques[1].abs() > 10.0);
//! ```

use nalgebra::{Isometry3, Point3, SMatrix, SVector, Vector3};

use crate::arm::MAX_ARM_JOINTS;
use crate::hand::MassProperties;
use crate::{Arm, GRAVITY, RobotModel};

/// One torque per joint of the arm, N m; 0 beyond the last joint.
pub type ArmTorques = SVector<f64, MAX_ARM_JOINTS>;

/// Computes the joint torques that hold the arm and an open hand against gravity, N m.
pub fn gravity_torques(robot: &RobotModel, angles: &[f64]) -> ArmTorques {
    let RobotModel { hand, arm, .. } = robot;
    let poses = arm.tree.forward(angles);
    let last = arm.last_link();
    let palm = poses[last] * arm.last_from_tool * hand.palm_from_flange.inverse();
    let links = hand.tree.forward(&hand.open_angles());
    let of_arm =
        arm.masses.iter().zip(&poses).enumerate().map(|(link, (mass, pose))| (link, mass.mass, pose * mass.com));
    let on_palm = |pose: Isometry3<f64>, mass: &MassProperties| (last, mass.mass, palm * pose * mass.com);
    let of_hand = links.iter().zip(&hand.masses).map(|(pose, mass)| on_palm(*pose, mass));
    let palm_itself = std::iter::once(on_palm(Isometry3::identity(), &hand.palm_mass));
    let mut torques = ArmTorques::zeros();
    for (link, mass, middle) in of_arm.chain(of_hand).chain(palm_itself) {
        torques += point_force_torques(arm, &poses, link, &middle, &Vector3::new(0.0, 0.0, -GRAVITY * mass));
    }
    torques
}

/// Computes the joint torques that hold a link against a `force` (N, base frame) at a `point` of it (m, base frame), N
/// m.
pub fn point_force_torques(
    arm: &Arm,
    poses: &[Isometry3<f64>],
    link: usize,
    point: &Point3<f64>,
    force: &Vector3<f64>,
) -> ArmTorques {
    let jacobian = arm.tree.jacobian(poses, link, &poses[link].inverse_transform_point(point));
    per_joint(arm.tree.len(), |joint| -jacobian.fixed_view::<3, 1>(0, joint).dot(force))
}

/// Packs the values of an arm's joints into [`ArmTorques`]: N m, or accelerations in rad/s2.
pub fn pack_torques(joints: &[f64]) -> ArmTorques {
    per_joint(joints.len(), |joint| joints[joint])
}

/// Collects `torque(joint)` over the joints.
fn per_joint(joints: usize, torque: impl Fn(usize) -> f64) -> ArmTorques {
    ArmTorques::from_fn(|joint, _| if joint < joints { torque(joint) } else { 0.0 })
}

/// Arm and open hand as point masses, for loops that need the torques of gravity and acceleration in every cycle.
#[derive(Debug, Clone)]
pub struct GravityModel {
    arm: Arm,
    /// Link, mass (kg) and centre of mass in the link's frame (m).
    masses: Vec<(usize, f64, Point3<f64>)>,
    last_from_palm: Isometry3<f64>,
}

impl GravityModel {
    /// Builds the model of an arm with an open hand.
    pub fn new(robot: &RobotModel) -> Self {
        let RobotModel { hand, arm, .. } = robot;
        let last_from_palm = arm.last_from_tool * hand.palm_from_flange.inverse();
        let links = hand.tree.forward(&hand.open_angles());
        let of_links = hand.masses.iter().zip(&links).map(|(mass, pose)| (mass.mass, pose * mass.com));
        let of_hand: Vec<_> = of_links.chain([(hand.palm_mass.mass, hand.palm_mass.com)]).collect();
        let total: f64 = of_hand.iter().map(|(mass, _)| mass).sum();
        let middle = of_hand.iter().fold(Vector3::zeros(), |sum, (mass, at)| sum + at.coords * *mass) / total;
        let of_arm = arm.masses.iter().enumerate().map(|(link, mass)| (link, mass.mass, mass.com));
        let masses = of_arm.chain([(arm.last_link(), total, last_from_palm * Point3::from(middle))]).collect();
        Self { arm: (**arm).clone(), masses, last_from_palm }
    }

    /// Computes the joint torques that accelerate arm and hand by `acceleration` (rad/s2) and hold their weight, N m.
    /// Velocity terms and the links' own moments of inertia are neglected.
    pub fn torques_at_acceleration(&self, poses: &[Isometry3<f64>], acceleration: &[f64]) -> ArmTorques {
        let joints = self.arm.tree.len();
        let acceleration = pack_torques(acceleration);
        let mut torques = acceleration * self.arm.armature;
        let mut linear = SMatrix::<f64, 3, MAX_ARM_JOINTS>::zeros();
        for (link, mass, at) in &self.masses {
            let jacobian = self.arm.tree.jacobian(poses, *link, at);
            linear.columns_mut(0, joints).copy_from(&jacobian.fixed_rows::<3>(0));
            let upwards = linear * acceleration + Vector3::new(0.0, 0.0, GRAVITY);
            torques += linear.transpose() * (upwards * *mass);
        }
        torques
    }

    /// Computes the joint torques that hold a mass of 1 kg in the palm, N m.
    pub fn torques_per_payload(&self, poses: &[Isometry3<f64>]) -> ArmTorques {
        let last = self.arm.last_link();
        let at = poses[last] * self.last_from_palm * Point3::origin();
        point_force_torques(&self.arm, poses, last, &at, &Vector3::new(0.0, 0.0, -GRAVITY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At rest the point masses weigh as much as arm and hand. A joint accelerated alone needs the torque of its own
    /// inertia: 1 kg at 1 m is 1 kg m2.
    #[test]
    fn point_masses_weigh_and_resist() {
        let robot = RobotModel::ftac_gen3();
        let (arm, model) = (&robot.arm, GravityModel::new(&robot));
        let at = [0.3, -0.5, 0.2, 1.7, -0.4, 0.9, 0.1];
        let poses = arm.tree.forward(&at);
        let rest = model.torques_at_acceleration(&poses, &[0.0; 7]);
        assert!((rest - gravity_torques(&robot, &at)).norm() < 1e-9, "{rest}");
        // Rotation about the vertical: the inertia is the sum of masses times squared distances from the axis, plus the
        // drive's.
        let turned = model.torques_at_acceleration(&poses, &[-2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])[0] - rest[0];
        let inertia: f64 =
            model.masses.iter().map(|(link, mass, at)| mass * (poses[*link] * at).coords.xy().norm_squared()).sum();
        assert!((turned + 2.0 * (inertia + arm.armature)).abs() < 1e-9, "{turned} {inertia}");
    }

    /// The gravity torques are the gradient of the potential energy.
    #[test]
    fn weight_is_the_slope_of_energy() {
        let robot = RobotModel::ftac_gen3();
        let RobotModel { hand, arm, .. } = &robot;
        let energy = |angles: &[f64]| {
            let poses = arm.tree.forward(angles);
            let palm = arm.tool_pose(angles) * hand.palm_from_flange.inverse();
            let links = hand.tree.forward(&hand.open_angles());
            let of_arm: f64 = arm.masses.iter().zip(&poses).map(|(mass, pose)| mass.mass * (pose * mass.com).z).sum();
            let of_hand: f64 =
                hand.masses.iter().zip(&links).map(|(mass, pose)| mass.mass * (palm * pose * mass.com).z).sum();
            GRAVITY * (of_arm + of_hand + hand.palm_mass.mass * (palm * hand.palm_mass.com).z)
        };
        let at = [0.3, -0.5, 0.2, 1.7, -0.4, 0.9, 0.1];
        let torques = gravity_torques(&robot, &at);
        for joint in 0..7 {
            let moved = |by: f64| -> [f64; 7] { std::array::from_fn(|n| at[n] + if n == joint { by } else { 0.0 }) };
            let slope = (energy(&moved(1e-5)) - energy(&moved(-1e-5))) / 2e-5;
            assert!((torques[joint] - slope).abs() < 1e-6, "{joint}: {} {slope}", torques[joint]);
        }
    }
}
