//! Inverse kinematics of the arm: a velocity-level program solved every tick, and a pose solver for planning.
//!
//! [`ArmServo`] owns a reference posture and moves it towards a palm pose. Every tick it solves
//!
//! ```text
//! min |W (J qd - s v)|^2 + k |W v|^2 (1 - s)^2 + d |qd - qd_comfort|^2    over qd, s
//! s.t. qd in [lo, hi], 0 <= s <= 1
//! ```
//! where v is the desired twist (feed-forward plus feedback on the pose error). The scale s slows the motion down along
//! its own direction before the direction is changed, d grows near singularities, and [lo, hi] combines speed limits,
//! acceleration limits and the speed from which a joint can still brake before its position limit. The comfort term
//! acts in the null space only, so it never shifts the palm. Set-points are the integral of qd: they cannot jump,
//! whatever the target does.

use std::sync::Arc;

use hand_model::Arm;
use hand_model::arm::{ArmVector, MAX_ARM_JOINTS};
use nalgebra::{Isometry3, SMatrix, SVector};
use thiserror::Error;

mod bounds;
mod pose_solver;
mod program;
mod servo;

pub use program::QpMethod;
pub use servo::{ArmServo, IkStep, PathRollout};

/// Angles (rad) or speeds (rad/s) of the arm's joints.
pub type Joints = ArmVector;
/// Jacobian with one column per joint an arm can have; 0 beyond the last joint.
pub(crate) type Jacobian = SMatrix<f64, 6, MAX_ARM_JOINTS>;
/// Vector over the joints; 0 beyond the last joint.
pub(crate) type JointVector = SVector<f64, MAX_ARM_JOINTS>;

/// Invalid input to the inverse kinematics.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum IkError {
    /// The time step is not a positive number.
    #[error("time step {0} s is not positive")]
    TimeStep(f64),
    /// The target or the feed-forward twist is not finite.
    #[error("the target pose or its twist is not finite")]
    Target,
    /// A given joint angle is not finite or beyond the limits of its joint.
    #[error("joint {joint}: {angle} rad is not within its limits")]
    Posture {
        /// Number of the joint, from 1.
        joint: usize,
        /// Angle of the joint, rad.
        angle: f64,
    },
}

/// Mounting of the arm: the pose of its base, and the frame it controls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmMount {
    /// Pose of the arm's base.
    pub world_from_base: Isometry3<f64>,
    /// Pose of the controlled frame in the arm's tool frame.
    pub tool_from_palm: Isometry3<f64>,
}

impl Default for ArmMount {
    /// The base at the world's origin, with the tool frame as the controlled frame.
    fn default() -> Self {
        Self { world_from_base: Isometry3::identity(), tool_from_palm: Isometry3::identity() }
    }
}

impl ArmMount {
    /// Mounting with the palm of `hand` as the controlled frame and the base above the world's origin, on a pedestal of
    /// `height` (m).
    pub fn for_hand(hand: &hand_model::Hand, height: f64) -> Self {
        Self {
            world_from_base: Isometry3::translation(0.0, 0.0, height),
            tool_from_palm: hand.palm_from_flange.inverse(),
        }
    }
}

/// Gains and weights of the inverse kinematics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSettings {
    /// Feedback gain on the pose error, 1/s.
    pub gain: f64,
    /// Largest palm speed, m/s.
    pub speed: f64,
    /// Planned deceleration of the palm towards the target, m/s2.
    pub deceleration: f64,
    /// Largest angular speed of the palm, rad/s.
    pub turn_speed: f64,
    /// Planned angular deceleration of the palm, rad/s2.
    pub turn_deceleration: f64,
    /// Weight of a radian of rotation error relative to a metre, m/rad.
    pub turn_weight: f64,
    /// Weight of slowing down relative to leaving the direction (k above); below 1, slowing down comes first.
    pub slowdown: f64,
    /// Damping far from singularities, m/rad.
    pub damping: f64,
    /// Damping added in a singularity, m/rad.
    pub singular_damping: f64,
    /// Smallest singular value (m/rad) below which the damping grows.
    pub singular_value: f64,
    /// Gain of the pull towards the comfortable posture in the null space, 1/s.
    pub comfort_gain: f64,
    /// Largest joint speed of that pull, rad/s.
    pub comfort_speed: f64,
    /// Share of the arm's published speed limits that is used.
    pub joint_speed_share: f64,
    /// Share of the arm's published acceleration limits that is used.
    pub joint_acceleration_share: f64,
    /// Distance kept from the joints' position limits, rad.
    pub joint_margin: f64,
}

impl Default for IkSettings {
    fn default() -> Self {
        Self {
            gain: 15.0,
            speed: 0.5,
            deceleration: 1.5,
            turn_speed: 1.74,
            turn_deceleration: 4.0,
            turn_weight: 0.25,
            slowdown: 0.05,
            damping: 0.004,
            singular_damping: 0.1,
            singular_value: 0.04,
            comfort_gain: 1.0,
            comfort_speed: 0.3,
            joint_speed_share: 1.0,
            joint_acceleration_share: 1.0,
            joint_margin: 0.01,
        }
    }
}

/// An arm with its mounting: forward kinematics, and [`ArmKinematics::solve`].
#[derive(Debug, Clone)]
pub struct ArmKinematics {
    arm: Arc<Arm>,
    mount: ArmMount,
}

impl ArmKinematics {
    /// Kinematics of a mounted arm.
    pub fn new(arm: Arm, mount: ArmMount) -> Self {
        Self { arm: Arc::new(arm), mount }
    }

    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the mounting of the arm.
    pub fn mount(&self) -> &ArmMount {
        &self.mount
    }

    /// `world_from_palm` at joint angles `q` (rad).
    pub fn palm_pose(&self, q: &Joints) -> Isometry3<f64> {
        self.mount.world_from_base * self.arm.tool_pose(q) * self.mount.tool_from_palm
    }

    /// World poses of the arm's links at joint angles `q` (rad).
    pub fn link_poses(&self, q: &Joints) -> Vec<Isometry3<f64>> {
        self.arm.tree.forward(q).iter().map(|pose| self.mount.world_from_base * pose).collect()
    }

    /// `world_from_palm` and the palm's Jacobian (rows: linear, angular, world axes; columns: joints, 0 beyond the
    /// last).
    pub fn jacobian(&self, q: &Joints) -> (Isometry3<f64>, SMatrix<f64, 6, MAX_ARM_JOINTS>) {
        let links = self.arm.tree.forward(q);
        let palm = links[self.arm.last_link()] * self.arm.last_from_tool * self.mount.tool_from_palm;
        let turn = self.mount.world_from_base.rotation;
        let mut jacobian = Jacobian::zeros();
        for (i, link) in links.iter().enumerate() {
            let axis = link.rotation * self.arm.tree.joints[i].axis.into_inner();
            let linear = axis.cross(&(palm.translation.vector - link.translation.vector));
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&(turn * linear));
            jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&(turn * axis));
        }
        (self.mount.world_from_base * palm, jacobian)
    }

    /// Checks that every angle is finite and within its limits, less `margin` (rad).
    pub fn within_limits(&self, q: &Joints, margin: f64) -> Result<(), IkError> {
        for (i, (joint, &angle)) in self.arm.tree.joints.iter().zip(q).enumerate() {
            if !(angle.is_finite() && angle >= joint.lower + margin && angle <= joint.upper - margin) {
                return Err(IkError::Posture { joint: i + 1, angle });
            }
        }
        Ok(())
    }
}

/// Wraps an angle to (-pi, pi].
pub(crate) fn wrap(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned <= -PI { PI } else { turned }
}
