//! Link poses, and the map from forces on links to forces on the hand's degrees of freedom, without allocation.
//!
//! The degrees of freedom are the palm's translation (3, object frame), its rotation (3, object frame, about [`PIVOT`])
//! and the joint angles. A force f at x on link l is a gradient dE/dx. Forces are summed by link as (f, x cross f); then,
//! from the tips to the palm, each joint takes the component along its axis. The cost does not depend on the number of
//! forces.

use hand_model::kinematics::{JointKind, Tree};
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Point of the palm frame about which the hand rotates, m: between the half-closed fingers, where objects are.
pub const PIVOT: Vector3<f64> = Vector3::new(0.0, 0.0, -0.035);

/// Pose of the hand on the object and its joint angles.
#[derive(Debug, Clone, PartialEq)]
pub struct HandState {
    /// `object_from_palm`.
    pub object_from_palm: Isometry3<f64>,
    /// Joint coordinates, rad or m.
    pub joints: Vec<f64>,
}

impl HandState {
    /// Returns the number of degrees of freedom.
    pub fn freedom(&self) -> usize {
        6 + self.joints.len()
    }

    /// Returns the state moved by a displacement: translation (m), rotation vector about the pivot (rad), joints (rad
    /// or m).
    pub fn moved(&self, by: &[f64]) -> Self {
        let mut moved = self.clone();
        moved.set_moved(self, by);
        moved
    }

    /// Moves a state as [`HandState::moved`] does, into an existing state of the same hand.
    pub fn set_moved(&mut self, from: &Self, by: &[f64]) {
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(by[3], by[4], by[5]));
        let pose = &from.object_from_palm;
        let pivot = pose.rotation * PIVOT + pose.translation.vector + Vector3::new(by[0], by[1], by[2]);
        let mut rotation = turn * pose.rotation;
        rotation.renormalize_fast();
        self.object_from_palm = Isometry3::from_parts((pivot - rotation * PIVOT).into(), rotation);
        for (joint, angle) in self.joints.iter_mut().enumerate() {
            *angle = from.joints[joint] + by[6 + joint];
        }
    }
}

/// A joint's fixed transform and axis.
#[derive(Debug, Clone, Copy)]
struct Joint {
    /// Link that carries it; 0 is the palm.
    parent: usize,
    kind: JointKind,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    axis: Vector3<f64>,
}

/// A force and its torque about the object's origin.
#[derive(Debug, Clone, Copy)]
pub struct Wrench {
    /// Sum of dE/dx.
    pub force: Vector3<f64>,
    /// Sum of x cross dE/dx.
    pub torque: Vector3<f64>,
}

/// Link poses in the object frame, and the wrenches on them. Reused for every state.
#[derive(Debug, Clone)]
pub struct LinkFrames {
    joints: Vec<Joint>,
    /// `object_from_link`, rotation; 0 is the palm.
    pub rotation: Vec<Matrix3<f64>>,
    /// `object_from_link`, translation, m.
    pub translation: Vec<Vector3<f64>>,
    /// Wrench on each link.
    pub wrench: Vec<Wrench>,
    /// Working space of the energy: the centre of each link's bounding ball, object frame, m.
    pub(crate) centers: Vec<Vector3<f64>>,
}

impl LinkFrames {
    /// Creates frames for the joints of `tree`.
    pub fn new(tree: &Tree) -> Self {
        let joints: Vec<Joint> = tree
            .joints
            .iter()
            .map(|joint| Joint {
                parent: joint.parent.map_or(0, |parent| parent + 1),
                kind: joint.kind,
                rotation: joint.origin.rotation.to_rotation_matrix().into_inner(),
                translation: joint.origin.translation.vector,
                axis: joint.axis.into_inner(),
            })
            .collect();
        let links = joints.len() + 1;
        let nothing = Wrench { force: Vector3::zeros(), torque: Vector3::zeros() };
        Self {
            joints,
            rotation: vec![Matrix3::identity(); links],
            translation: vec![Vector3::zeros(); links],
            wrench: vec![nothing; links],
            centers: vec![Vector3::zeros(); links],
        }
    }

    /// Computes the link poses of `state` and clears the wrenches.
    pub fn set_state(&mut self, state: &HandState) {
        self.rotation[0] = state.object_from_palm.rotation.to_rotation_matrix().into_inner();
        self.translation[0] = state.object_from_palm.translation.vector;
        for (n, joint) in self.joints.iter().enumerate() {
            if joint.kind == JointKind::Slide {
                let along = joint.translation + joint.rotation * joint.axis * state.joints[n];
                self.translation[n + 1] = self.rotation[joint.parent] * along + self.translation[joint.parent];
                self.rotation[n + 1] = self.rotation[joint.parent] * joint.rotation;
                continue;
            }
            let (sin, cos) = state.joints[n].sin_cos();
            let a = &joint.axis;
            // Rodrigues: cos I + (1 - cos) a a' + sin [a]x.
            let turn = Matrix3::identity() * cos + a * a.transpose() * (1.0 - cos) + a.cross_matrix() * sin;
            self.translation[n + 1] = self.rotation[joint.parent] * joint.translation + self.translation[joint.parent];
            self.rotation[n + 1] = self.rotation[joint.parent] * (joint.rotation * turn);
        }
        for wrench in &mut self.wrench {
            wrench.force = Vector3::zeros();
            wrench.torque = Vector3::zeros();
        }
    }

    /// Returns a link's point in the object frame.
    pub fn point(&self, link: usize, local: &Vector3<f64>) -> Vector3<f64> {
        self.rotation[link] * local + self.translation[link]
    }

    /// Adds dE/dx = `force` at `x` (object frame) on `link`.
    pub fn add_point_gradient(&mut self, link: usize, x: &Vector3<f64>, force: &Vector3<f64>) {
        let wrench = &mut self.wrench[link];
        wrench.force += force;
        wrench.torque += x.cross(force);
    }

    /// Adds dE/d(direction) = `force` for a direction fixed to `link`.
    pub fn add_direction_gradient(&mut self, link: usize, direction: &Vector3<f64>, force: &Vector3<f64>) {
        self.wrench[link].torque += direction.cross(force);
    }

    /// Adds the wrenches' gradient to `gradient`: translation, rotation about the pivot, joints. Consumes the wrenches.
    pub fn collect_gradient(&mut self, gradient: &mut [f64]) {
        for n in (0..self.joints.len()).rev() {
            let own = self.wrench[n + 1];
            let parent = self.joints[n].parent;
            let axis = self.rotation[n + 1] * self.joints[n].axis;
            gradient[6 + n] += match self.joints[n].kind {
                JointKind::Turn => axis.dot(&(own.torque - self.translation[n + 1].cross(&own.force))),
                JointKind::Slide => axis.dot(&own.force),
            };
            self.wrench[parent].force += own.force;
            self.wrench[parent].torque += own.torque;
        }
        let total = self.wrench[0];
        let pivot = self.point(0, &PIVOT);
        let torque = total.torque - pivot.cross(&total.force);
        for axis in 0..3 {
            gradient[axis] += total.force[axis];
            gradient[3 + axis] += torque[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::Hand;
    use nalgebra::{Point3, UnitQuaternion};

    /// Derivatives of `value` by the 21 coordinates of [`state`].
    fn central_differences(mut value: impl FnMut(&HandState) -> f64) -> Vec<f64> {
        let h = 1e-6;
        (0..21)
            .map(|n| {
                let mut by = [0.0; 21];
                by[n] = h;
                let forth = value(&state().moved(&by));
                by[n] = -h;
                (forth - value(&state().moved(&by))) / (2.0 * h)
            })
            .collect()
    }

    fn state() -> HandState {
        let rotation = UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0);
        let object_from_palm = Isometry3::from_parts(Vector3::new(0.01, -0.05, 0.08).into(), rotation);
        HandState { object_from_palm, joints: (0..15).map(|n| 0.1 + 0.07 * f64::from(n)).collect() }
    }

    #[test]
    fn same_poses_as_the_tree() {
        let hand = Hand::ftac();
        let mut frames = LinkFrames::new(&hand.tree);
        let state = state();
        frames.set_state(&state);
        let p = Vector3::new(0.02, 0.008, -0.003);
        for (link, pose) in hand.tree.forward(&state.joints).iter().enumerate() {
            let expected = state.object_from_palm * pose * Point3::from(p);
            assert!((frames.point(link + 1, &p) - expected.coords).norm() < 1e-12);
        }
    }

    /// With sliding joints among them, the poses are those of the tree, and the gradient is that of finite differences.
    #[test]
    fn slides_move_along_their_axes() {
        let mut tree = Hand::ftac().tree;
        for joint in [1, 3, 7] {
            tree.joints[joint].kind = JointKind::Slide;
        }
        let mut frames = LinkFrames::new(&tree);
        let (local, pull) = (Vector3::new(0.02, 0.008, -0.003), Vector3::new(0.3, 1.0, -0.7));
        let value = |state: &HandState| -> f64 {
            frames.set_state(state);
            (1..16).map(|link| pull.dot(&frames.point(link, &local))).sum()
        };
        let slopes = central_differences(value);
        frames.set_state(&state());
        for (link, pose) in tree.forward(&state().joints).iter().enumerate() {
            let expected = state().object_from_palm * pose * Point3::from(local);
            assert!((frames.point(link + 1, &local) - expected.coords).norm() < 1e-12);
        }
        for link in 1..16 {
            let x = frames.point(link, &local);
            frames.add_point_gradient(link, &x, &pull);
        }
        let mut gradient = [0.0; 21];
        frames.collect_gradient(&mut gradient);
        for n in 0..21 {
            assert!((gradient[n] - slopes[n]).abs() < 1e-7, "{n}: {} {}", gradient[n], slopes[n]);
        }
    }

    /// A sum of linear functions of points on three links: the collected gradient is that of finite differences.
    #[test]
    fn collected_gradient_is_the_derivative() {
        let hand = Hand::ftac();
        let mut frames = LinkFrames::new(&hand.tree);
        let pulls =
            [(0, Vector3::new(1.0, 2.0, -1.0)), (3, Vector3::new(-1.0, 0.5, 2.0)), (8, Vector3::new(0.3, 1.0, 1.0))];
        let local = Vector3::new(0.02, 0.008, -0.003);
        let value = |state: &HandState| -> f64 {
            frames.set_state(state);
            pulls.iter().map(|(link, pull)| pull.dot(&frames.point(*link, &local))).sum()
        };
        let slopes = central_differences(value);
        frames.set_state(&state());
        for (link, pull) in &pulls {
            let x = frames.point(*link, &local);
            frames.add_point_gradient(*link, &x, pull);
        }
        let mut gradient = [0.0; 21];
        frames.collect_gradient(&mut gradient);
        for n in 0..21 {
            assert!((gradient[n] - slopes[n]).abs() < 1e-7, "{n}: {} {}", gradient[n], slopes[n]);
        }
    }
}
