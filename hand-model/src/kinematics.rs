//! Forward kinematics and Jacobians of a tree of revolute and prismatic joints.
//!
//! A [`Tree`] is a flat list of joints in which every parent comes before its children. Link `i` is moved by joint `i`;
//! the root link has no index.

use nalgebra::{Isometry3, Matrix6xX, Point3, Translation3, Unit, UnitQuaternion, Vector3};

/// The motion that a joint allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Revolute: about the axis; coordinates in rad, efforts in N m.
    Turn,
    /// Prismatic: along the axis; coordinates in m, efforts in N.
    Slide,
}

impl JointKind {
    /// Returns the unit of the joint's coordinate.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Turn => "rad",
            Self::Slide => "m",
        }
    }

    /// Returns the unit of the joint's effort.
    pub fn effort_unit(self) -> &'static str {
        match self {
            Self::Turn => "N m",
            Self::Slide => "N",
        }
    }
}

/// One joint and the link it carries.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Name of the joint and of its link.
    pub name: String,
    /// Index of the parent joint; `None` for the root link.
    pub parent: Option<usize>,
    /// Motion of the joint.
    pub kind: JointKind,
    /// `parent_from_joint` at coordinate zero.
    pub origin: Isometry3<f64>,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lower limit, rad or m (-inf for a continuous joint).
    pub lower: f64,
    /// Upper limit, rad or m (+inf for a continuous joint).
    pub upper: f64,
}

impl Joint {
    /// Computes `parent_from_link` at coordinate `q` (rad or m).
    pub fn pose(&self, q: f64) -> Isometry3<f64> {
        match self.kind {
            JointKind::Turn => self.origin * UnitQuaternion::from_axis_angle(&self.axis, q),
            JointKind::Slide => self.origin * Translation3::from(self.axis.into_inner() * q),
        }
    }
}

/// A kinematic tree; see the module documentation.
///
/// ```
/// use hand_model::kinematics::{Joint, JointKind, Tree};
/// use hand_model::nalgebra::{Isometry3, Point3, Vector3};
///
/// // A finger with two joints about z, 40 mm apart.
/// let joint = |name: &str, parent, x| Joint {
///     name: name.to_owned(),
///     parent,
///     kind: JointKind::Turn,
///     origin: Isometry3::translation(x, 0.0, 0.0),
///     axis: Vector3::z_axis(),
///     lower: 0.0,
///     upper: 1.57,
/// };
/// let finger = Tree { joints: vec![joint("proximal", None, 0.0), joint("distal", Some(0), 0.04)] };
///
/// let (distal, tip) = (1, Point3::new(0.03, 0.0, 0.0));
/// let poses = finger.forward(&[0.0, 0.0]);
/// assert!(((poses[distal] * tip).x - 0.07).abs() < 1e-12);
/// // Rotation of the first joint moves the tip along y, by 70 mm per radian.
/// assert!((finger.jacobian(&poses, distal, &tip)[(1, 0)] - 0.07).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct Tree {
    /// Joints, parents first.
    pub joints: Vec<Joint>,
}

impl Tree {
    /// Returns the number of joints.
    pub fn len(&self) -> usize {
        self.joints.len()
    }

    /// True if the tree has no joint.
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Returns the index of the joint called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Computes `root_from_link` of every link at joint coordinates `q` (rad or m).
    ///
    /// # Panics
    /// If the length of `q` is not the number of joints.
    pub fn forward(&self, q: &[f64]) -> Vec<Isometry3<f64>> {
        assert_eq!(q.len(), self.joints.len(), "one angle per joint");
        let mut poses: Vec<Isometry3<f64>> = Vec::with_capacity(q.len());
        for (joint, &angle) in self.joints.iter().zip(q) {
            let own = joint.pose(angle);
            let pose = joint.parent.map_or(own, |parent| poses[parent] * own);
            poses.push(pose);
        }
        poses
    }

    /// Returns the joints from the root down to `link`, `link` included.
    pub fn chain(&self, link: usize) -> Vec<usize> {
        let mut chain = vec![link];
        while let Some(parent) = self.joints[chain[chain.len() - 1]].parent {
            chain.push(parent);
        }
        chain.reverse();
        chain
    }

    /// Computes the geometric Jacobian (6 x joints; rows: linear velocity, angular velocity, in the root frame) of a
    /// point given in the frame of `link`. `poses` is the result of [`Tree::forward`].
    pub fn jacobian(&self, poses: &[Isometry3<f64>], link: usize, point: &Point3<f64>) -> Matrix6xX<f64> {
        let mut jacobian = Matrix6xX::zeros(self.joints.len());
        let target = poses[link] * point;
        for joint in self.chain(link) {
            let axis = poses[joint] * self.joints[joint].axis.into_inner();
            if self.joints[joint].kind == JointKind::Slide {
                jacobian.fixed_view_mut::<3, 1>(0, joint).copy_from(&axis);
                continue;
            }
            let linear = axis.cross(&(target.coords - poses[joint].translation.vector));
            jacobian.fixed_view_mut::<3, 1>(0, joint).copy_from(&linear);
            jacobian.fixed_view_mut::<3, 1>(3, joint).copy_from(&axis);
        }
        jacobian
    }
}

/// Builds a pose from a URDF origin: translation (m) and fixed-axis roll, pitch, yaw (rad).
pub fn pose_from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(xyz[0], xyz[1], xyz[2]),
        UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, Hand};
    use proptest::prelude::*;

    /// Known answers of the Gen3 chain, from the published URDF.
    #[test]
    fn gen3_known_poses() {
        let arm = Arm::gen3();
        let tool = arm.tool_pose(&[0.0; 7]);
        assert!((tool.translation.vector - Vector3::new(0.0, -0.02485, 1.18739)).norm() < 1e-4);
        assert!(tool.rotation.angle() < 1e-4);
        use std::f64::consts::PI;
        let home = [0.0, 0.26179939, PI, -2.26892803, 0.0, 0.95993109, PI / 2.0];
        let tool = arm.tool_pose(&home);
        assert!((tool.translation.vector - Vector3::new(0.45667, 0.00135, 0.43372)).norm() < 1e-4, "{tool}");
        assert!((tool * Vector3::z() - Vector3::x()).norm() < 1e-3);
    }

    /// 194 mm from wrist to middle fingertip (the paper's figure of the hand).
    #[test]
    fn hand_length() {
        let hand = Hand::ftac();
        let poses = hand.tree.forward(&[0.0; 15]);
        let link = hand.tree.find("middle_3").expect("middle_3");
        let tip = poses[link] * Point3::new(0.0325, 0.0, 0.0);
        let length = tip.y - hand.palm_from_flange.translation.y;
        assert!((length - 0.194).abs() < 0.0005, "{length}");
    }

    /// A positive angle flexes: every distal pad moves to the palmar side (-z) or across the palm.
    #[test]
    fn positive_flexes() {
        let hand = Hand::ftac();
        for digit in ["index_1", "middle_1", "ring_1", "little_1"] {
            let joint = hand.tree.find(digit).expect(digit);
            let mut q = [0.0; 15];
            let link = joint + 2;
            let before = hand.tree.forward(&q)[link].translation.z;
            q[joint] = 0.3;
            assert!(hand.tree.forward(&q)[link].translation.z < before - 0.01);
        }
    }

    proptest! {
        /// The Jacobian is the derivative of the forward kinematics.
        #[test]
        fn jacobian_is_finite_difference(seed in proptest::collection::vec(0.0f64..1.5, 15), link in 0usize..15) {
            let hand = Hand::ftac();
            let point = Point3::new(0.02, 0.008, 0.003);
            let poses = hand.tree.forward(&seed);
            let jacobian = hand.tree.jacobian(&poses, link, &point);
            for joint in 0..15 {
                let h = 1e-6;
                let mut forth = seed.clone();
                let mut back = seed.clone();
                forth[joint] += h;
                back[joint] -= h;
                let difference = (hand.tree.forward(&forth)[link] * point - hand.tree.forward(&back)[link] * point) / (2.0 * h);
                let column = jacobian.fixed_view::<3, 1>(0, joint);
                prop_assert!((difference - column).norm() < 1e-8);
            }
        }
    }
}
