//! Arm and hand as one reduced-coordinate multibody, and the generalized forces on it.
//!
//! Every joint force is applied as an implicit spring whose rest angle is shifted so that the force at the present
//! angle is the desired one: rest = q + tau / K. The arm's spring is its position controller (with gravity compensation
//! and torque clamp); a finger's is its torsion spring, stiffened by the cable's own elasticity.

use hand_model::arm::WristCapsule;
use hand_model::hand::{CoverShape, MassProperties};
use hand_model::kinematics::JointKind;
use hand_model::transmission::Follower;
use hand_model::{Arm, ArmVector, GRAVITY, Hand, HandVector};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use plant::ArmDefects;
use rapier3d_f64::prelude::*;

use crate::convert;
use crate::engine::Engine;

/// Collision groups: the hand, the arm's wrist, objects, table.
pub mod groups {
    use rapier3d_f64::prelude::Group;
    /// Palm and phalanges.
    pub const HAND: Group = Group::GROUP_1;
    /// Wrist capsules of the arm.
    pub const ARM: Group = Group::GROUP_2;
    pub const OBJECT: Group = Group::GROUP_3;
    pub const TABLE: Group = Group::GROUP_4;
}

/// Index of a joint's degree of freedom among its six: the rotation about x of a hinge, and the translation along x of
/// a slide.
pub(crate) const HINGE_DOF: usize = 3;
pub(crate) const SLIDE_DOF: usize = 0;

/// Upper bound for the motion of a sliding joint in one step, m.
pub(crate) const SLIDE_SLACK: f64 = 0.01;

/// Handles of the multibody.
#[derive(Clone)]
pub struct RobotBody {
    links: Vec<RigidBodyHandle>,
    joints: Vec<MultibodyJointHandle>,
    /// Colliders of the palm's cover, then of the links' covers.
    pub covers: Vec<ColliderHandle>,
    /// The arm's wrist capsules.
    pub wrist: Vec<ColliderHandle>,
    /// Kinds of the hand's joints.
    kinds: Vec<JointKind>,
    /// Masses as gravity compensation assumes them.
    masses: Vec<MassProperties>,
    arm_joints: usize,
}

/// Joint angles and speeds, arm then hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointState {
    /// Arm angles, rad.
    pub arm: ArmVector,
    /// Arm speeds, rad/s.
    pub arm_speed: ArmVector,
    /// Finger angles, rad.
    pub hand: HandVector,
    /// Finger speeds, rad/s.
    pub hand_speed: HandVector,
}

/// Goal of the arm's position control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmGoal {
    /// Joint angles, rad.
    pub position: ArmVector,
    /// Joint speeds, rad/s.
    pub speed: ArmVector,
}

/// Computes the true pose of the palm in the arm's last link.
pub fn last_from_palm(arm: &Arm, hand: &Hand, defects: &ArmDefects) -> Isometry3<f64> {
    arm.last_from_tool * defects.mount() * hand.palm_from_flange.inverse()
}

/// Returns the constructor of a joint of this kind.
pub(crate) fn joint_builder(kind: JointKind) -> fn(&Isometry3<f64>, &Vector3<f64>, [f64; 2]) -> GenericJoint {
    match kind {
        JointKind::Turn => revolute,
        JointKind::Slide => prismatic,
    }
}

/// Returns the index of a joint's degree of freedom among its six coordinates: the rotation about its x, or the
/// translation along it.
pub(crate) fn dof_index(kind: JointKind) -> usize {
    match kind {
        JointKind::Turn => HINGE_DOF,
        JointKind::Slide => SLIDE_DOF,
    }
}

/// Couples one joint of a multibody to another as `follower` specifies.
pub(crate) fn couple_joints(
    engine: &mut Engine,
    (leader, leader_kind): (MultibodyJointHandle, JointKind),
    (joint, kind): (MultibodyJointHandle, JointKind),
    follower: &Follower,
) {
    let link = |handle| engine.multibodies.get(handle).map(|(_, link)| link);
    let (Some(link1), Some(link2)) = (link(leader), link(joint)) else { return };
    if let Some((multibody, _)) = engine.multibodies.get_mut(joint) {
        multibody.add_dof_coupling(MultibodyDofCoupling {
            link1,
            dof1: 0,
            axis1: dof_index(leader_kind),
            link2,
            dof2: 0,
            axis2: dof_index(kind),
            coeff: follower.multiplier,
            offset: follower.offset,
        });
    }
}

pub(crate) fn revolute(origin: &Isometry3<f64>, axis: &Vector3<f64>, limits: [f64; 2]) -> GenericJoint {
    // rapier's revolute joints turn about the frame's x.
    let axis_as_x = Rotation::from_rotation_arc(Vector::X, convert::vector(axis));
    let frame1 = convert::pose(origin) * Pose::from_rotation(axis_as_x);
    let mut builder = GenericJointBuilder::new(JointAxesMask::LOCKED_REVOLUTE_AXES)
        .local_frame1(frame1)
        .local_frame2(Pose::from_rotation(axis_as_x))
        .contacts_enabled(false)
        .softness(SpringCoefficients::new(240.0, 5.0));
    if limits[0].is_finite() {
        builder = builder.limits(JointAxis::AngX, limits);
    }
    builder.build()
}

/// Builds a joint that slides along `axis` between `limits` (m).
pub(crate) fn prismatic(origin: &Isometry3<f64>, axis: &Vector3<f64>, limits: [f64; 2]) -> GenericJoint {
    // rapier's prismatic joints move along the frame's x.
    let axis_as_x = Rotation::from_rotation_arc(Vector::X, convert::vector(axis));
    GenericJointBuilder::new(JointAxesMask::LOCKED_PRISMATIC_AXES)
        .local_frame1(convert::pose(origin) * Pose::from_rotation(axis_as_x))
        .local_frame2(Pose::from_rotation(axis_as_x))
        .contacts_enabled(false)
        .softness(SpringCoefficients::new(240.0, 5.0))
        .limits(JointAxis::LinX, limits)
        .build()
}

pub(crate) fn cover_collider(cover: &CoverShape) -> ColliderBuilder {
    let inner = cover.half.add_scalar(-cover.radius);
    ColliderBuilder::round_cuboid(inner.x, inner.y, inner.z, cover.radius)
        .position(convert::pose(&cover.link_from_cover))
        .density(0.0)
        .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS)
        .friction(0.0)
        // An object's friction coefficient is that against the hand's elastomer; on the table it is capped.
        .friction_combine_rule(CoefficientCombineRule::Max)
        .collision_groups(
            InteractionGroups::all()
                .with_memberships(groups::HAND)
                .with_filter(groups::HAND | groups::OBJECT | groups::TABLE),
        )
}

pub(crate) fn link_body(world: &Isometry3<f64>, mass: &MassProperties) -> RigidBodyBuilder {
    RigidBodyBuilder::dynamic().pose(convert::pose(world)).can_sleep(false).additional_mass_properties(
        rapier3d_f64::prelude::MassProperties::with_inertia_matrix(
            convert::point(&mass.com),
            mass.mass,
            convert::matrix(&mass.inertia),
        ),
    )
}

impl RobotBody {
    /// Inserts arm (at `world_from_base`) and hand into the engine at their true joint angles.
    pub fn insert(
        engine: &mut Engine,
        arm: &Arm,
        hand: &Hand,
        world_from_base: &Isometry3<f64>,
        defects: &ArmDefects,
        (arm_q, hand_q): (&[f64], &[f64]),
    ) -> Self {
        let arm_poses = arm.tree.forward(arm_q);
        let base = engine.bodies.insert(RigidBodyBuilder::fixed().pose(convert::pose(world_from_base)));
        let mut links = Vec::new();
        let mut joints = Vec::new();
        let mut masses = Vec::new();
        let last_from_palm = last_from_palm(arm, hand, defects);
        let mut parent = base;
        for (i, joint) in arm.tree.joints.iter().enumerate() {
            let mut mass = arm.masses[i];
            if i == arm.last_link() {
                // Bracelet, servo pack and palm form one rigid link.
                mass = merge(&mass, &hand.palm_mass, &last_from_palm);
            }
            let mut real = mass;
            if i == arm.last_link() && defects.payload > 0.0 {
                let payload =
                    MassProperties { mass: defects.payload, com: Point3::origin(), inertia: Matrix3::zeros() };
                real = merge(&mass, &payload, &last_from_palm);
            }
            let body = engine.bodies.insert(link_body(&(world_from_base * arm_poses[i]), &real));
            let handle = engine.multibodies.insert(
                parent,
                body,
                revolute(&joint.origin, &joint.axis, [joint.lower, joint.upper]),
                true,
            );
            joints.extend(handle);
            links.push(body);
            masses.push(mass);
            parent = body;
        }
        let palm_link = parent;
        let mut palm_cover = hand.palm_cover;
        palm_cover.link_from_cover = last_from_palm * palm_cover.link_from_cover;
        let mut covers =
            vec![engine.colliders.insert_with_parent(cover_collider(&palm_cover), palm_link, &mut engine.bodies)];
        let mut wrist = Vec::new();
        for WristCapsule { link, end, radius } in &arm.wrist {
            let capsule = ColliderBuilder::capsule_from_endpoints(Vector::ZERO, convert::vector(end), *radius)
                .density(0.0)
                .collision_groups(
                    InteractionGroups::all().with_memberships(groups::ARM).with_filter(groups::TABLE | groups::OBJECT),
                );
            wrist.push(engine.colliders.insert_with_parent(capsule, links[*link], &mut engine.bodies));
        }
        let world_from_palm = world_from_base * arm_poses[arm.last_link()] * last_from_palm;
        let hand_poses = hand.tree.forward(&hand.open_angles());
        let mut hand_links: Vec<RigidBodyHandle> = Vec::new();
        for (i, joint) in hand.tree.joints.iter().enumerate() {
            let body = engine.bodies.insert(link_body(&(world_from_palm * hand_poses[i]), &hand.masses[i]));
            let (parent, origin) = match joint.parent {
                Some(parent) => (hand_links[parent], joint.origin),
                None => (palm_link, last_from_palm * joint.origin),
            };
            let own = joint_builder(joint.kind)(&origin, &joint.axis, [joint.lower, joint.upper]);
            joints.extend(engine.multibodies.insert(parent, body, own, true));
            covers.push(engine.colliders.insert_with_parent(cover_collider(&hand.covers[i]), body, &mut engine.bodies));
            hand_links.push(body);
            masses.push(hand.masses[i]);
        }
        links.extend(&hand_links);
        let kinds = hand.tree.joints.iter().map(|joint| joint.kind).collect();
        let mut robot = Self { links, joints, arm_joints: arm.joints(), covers, wrist, kinds, masses };
        robot.initialise(engine, arm, hand, (arm_q, hand_q));
        robot
    }

    fn initialise(&mut self, engine: &mut Engine, arm: &Arm, hand: &Hand, (arm_q, hand_q): (&[f64], &[f64])) {
        let bodies = &engine.bodies;
        let Some((multibody, _)) = engine.multibodies.get_mut(self.joints[0]) else { return };
        multibody.set_self_contacts_enabled(true);
        // A fixed root is first treated as a free one; this call settles the degrees of freedom.
        multibody.forward_kinematics(bodies, true);
        for (i, damping) in arm.damping.iter().enumerate() {
            multibody.damping_mut()[i] = *damping;
            multibody.armature_mut()[i] = arm.armature;
        }
        for joint in 0..hand.tree.len() {
            multibody.damping_mut()[arm.joints() + joint] = hand.joint_damping(joint);
            multibody.armature_mut()[arm.joints() + joint] = hand.joint_armature(joint);
        }
        let displacement = [arm_q, hand_q].concat();
        multibody.apply_displacements(&displacement);
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(&mut engine.bodies, true);
        for follower in &hand.transmission.followers {
            let [leader, joint] =
                [follower.leader, follower.joint].map(|own| (self.joints[arm.joints() + own], self.kinds[own]));
            couple_joints(engine, leader, joint, follower);
        }
    }

    /// Reads the true joint angles and speeds.
    pub fn joint_state(&self, engine: &Engine) -> JointState {
        let mut state = JointState {
            arm: (0..self.arm_joints).map(|_| 0.0).collect(),
            arm_speed: (0..self.arm_joints).map(|_| 0.0).collect(),
            hand: self.hand_joints().map(|_| 0.0).collect(),
            hand_speed: self.hand_joints().map(|_| 0.0).collect(),
        };
        let Some((multibody, _)) = engine.multibodies.get(self.joints[0]) else { return state };
        let speeds = multibody.generalized_velocity();
        for (i, handle) in self.joints.iter().enumerate() {
            let Some((_, link)) = engine.multibodies.get(*handle) else { continue };
            let Some(link) = multibody.link(link) else { continue };
            let at = |axis: usize| link.joint.coords()[axis];
            if i < self.arm_joints {
                state.arm[i] = at(HINGE_DOF);
                state.arm_speed[i] = speeds[i];
            } else {
                state.hand[i - self.arm_joints] = at(dof_index(self.kinds[i - self.arm_joints]));
                state.hand_speed[i - self.arm_joints] = speeds[i];
            }
        }
        state
    }

    fn hand_joints(&self) -> std::ops::Range<usize> {
        self.arm_joints..self.joints.len()
    }

    /// Returns the body of the arm's last link, which includes the palm.
    pub(crate) fn palm_link(&self) -> RigidBodyHandle {
        self.links[self.arm_joints - 1]
    }

    /// Returns the world poses of the arm's links, then of the hand's.
    pub fn link_poses(&self, engine: &Engine) -> Vec<Isometry3<f64>> {
        self.links.iter().map(|link| convert::to_pose(engine.bodies[*link].position())).collect()
    }

    /// Computes the torques that hold arm and hand (without any held object) against gravity, N m.
    pub fn gravity_torques(&self, poses: &[Isometry3<f64>]) -> ArmVector {
        let mut torques: ArmVector = (0..self.arm_joints).map(|_| 0.0).collect();
        for (link, mass) in self.masses.iter().enumerate() {
            let com = poses[link] * mass.com;
            let weight = Vector3::new(0.0, 0.0, -GRAVITY * mass.mass);
            for (joint, torque) in torques.iter_mut().enumerate().take((link + 1).min(self.arm_joints)) {
                let axis = poses[joint] * Vector3::z();
                *torque -= axis.dot(&(com.coords - poses[joint].translation.vector).cross(&weight));
            }
        }
        torques
    }

    /// Sets the arm's position control for the next step: spring and damper towards `goal` plus the torques `gravity`
    /// (N m), clamped to the arm's limits. Returns the commanded torques, N m.
    pub fn drive_arm(
        &self,
        engine: &mut Engine,
        arm: &Arm,
        state: &JointState,
        goal: &ArmGoal,
        gravity: &[f64],
    ) -> ArmVector {
        arm.each(|i| {
            let (k, d, limit) = (arm.stiffness[i], arm.damping[i], arm.effort_limits[i]);
            // Only the motor's torque is clamped; its damping part acts in the engine, implicitly, on the joint's
            // speed.
            let motor = k * (goal.position[i] - state.arm[i]) + d * (goal.speed[i] - state.arm_speed[i]) + gravity[i];
            let motor = motor.clamp(-limit, limit);
            self.set_torque(engine, i, state.arm[i], motor + d * state.arm_speed[i], k);
            motor
        })
    }

    /// Sets a finger joint's torque (N m; force in N for a slide) for the next step, with an implicit stiffness.
    pub fn drive_finger(&self, engine: &mut Engine, state: &JointState, joint: usize, torque: f64, stiffness: f64) {
        let index = self.arm_joints + joint;
        match self.kinds[joint] {
            JointKind::Turn => self.set_torque(engine, index, state.hand[joint], torque, stiffness),
            JointKind::Slide => {
                if let Some((multibody, link)) = engine.multibodies.get_mut(self.joints[index])
                    && let Some(link) = multibody.link_mut(link)
                {
                    set_slide_force(&mut link.joint, state.hand[joint], torque, stiffness, SLIDE_SLACK);
                }
            }
        }
    }

    fn set_torque(&self, engine: &mut Engine, index: usize, angle: f64, torque: f64, stiffness: f64) {
        let slack = engine.limit_slack();
        if let Some((multibody, link)) = engine.multibodies.get_mut(self.joints[index])
            && let Some(link) = multibody.link_mut(link)
        {
            set_hinge_torque(&mut link.joint, angle, torque, stiffness, slack);
        }
    }
}

/// Sets a hinge's torque (N m) for the next step at its present `angle` (rad), with an implicit stiffness (N m/rad), by
/// a spring with a shifted rest angle. Its limits are enabled only where the joint is beyond one or within `slack`
/// (rad) of it. Elsewhere they could not act, yet would cost the engine a solved constraint.
pub(crate) fn set_hinge_torque(joint: &mut MultibodyJoint, angle: f64, torque: f64, stiffness: f64, slack: f64) {
    joint.set_spring(HINGE_DOF, stiffness, angle + torque / stiffness);
    let limits = joint.data.limits[HINGE_DOF];
    let close = angle < limits.min + slack || angle > limits.max - slack;
    joint.data.limit_axes.set(JointAxesMask::ANG_X, close);
}

/// Sets the force (N) on a slide for the next step at its present `position` (m), with an implicit stiffness (N/m),
/// like [`set_hinge_torque`] for a hinge.
pub(crate) fn set_slide_force(joint: &mut MultibodyJoint, position: f64, force: f64, stiffness: f64, slack: f64) {
    joint.set_spring(SLIDE_DOF, stiffness, position + force / stiffness);
    let limits = joint.data.limits[SLIDE_DOF];
    let close = position < limits.min + slack || position > limits.max - slack;
    joint.data.limit_axes.set(JointAxesMask::LIN_X, close);
}

fn merge(a: &MassProperties, b: &MassProperties, a_from_b: &Isometry3<f64>) -> MassProperties {
    let rotation = a_from_b.rotation.to_rotation_matrix();
    let com_b = a_from_b * b.com;
    let mass = a.mass + b.mass;
    let com = (a.com.coords * a.mass + com_b.coords * b.mass) / mass;
    let shift = |m: f64, d: Vector3<f64>| (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * m;
    MassProperties {
        mass,
        com: com.into(),
        inertia: a.inertia
            + shift(a.mass, a.com.coords - com)
            + rotation * b.inertia * rotation.transpose()
            + shift(b.mass, com_b.coords - com),
    }
}
