//! A tree of revolute and sliding joints, its root bolted to the world: the mechanism of every hand on the stand.

use std::collections::BTreeSet;

use hand_model::hand::MassProperties;
use hand_model::kinematics::{JointKind, Tree};
use hand_model::transmission::Follower;
use nalgebra::{Isometry3, Vector3};
use rapier3d_f64::parry::bounding_volume::BoundingVolume as _;
use rapier3d_f64::parry::query;
use rapier3d_f64::prelude::{
    ColliderBuilder, ColliderHandle, MultibodyJointHandle, Pose, RigidBodyBuilder, RigidBodyHandle, Shape,
};

use crate::body::{SLIDE_SLACK, couple_joints, dof_index, joint_builder, link_body, set_hinge_torque, set_slide_force};
use crate::convert;
use crate::drive::JointEffort;
use crate::engine::{Engine, EngineSettings};

/// Description of a linkage.
#[derive(Debug, Clone, Copy)]
pub struct LinkageModel<'a> {
    /// Joints, parents first.
    pub tree: &'a Tree,
    /// Mass properties of the link that each joint moves.
    pub masses: &'a [MassProperties],
    /// Damping of each joint, N m s/rad or N s/m.
    pub damping: &'a [f64],
    /// Armature of each joint, kg m2 or kg.
    pub armature: &'a [f64],
    /// True if every joint on the root gets its own root body: one multibody per digit costs a fraction of one
    /// with all joints.
    pub separate_roots: bool,
}

/// The mechanism in its own engine. The root frame is the world frame.
#[derive(Clone)]
pub struct Linkage {
    engine: Engine,
    links: Vec<RigidBodyHandle>,
    joints: Vec<MultibodyJointHandle>,
    kinds: Vec<JointKind>,
    /// Degree of freedom of each joint in its multibody.
    dof_indices: Vec<usize>,
    covers: Vec<(Option<usize>, ColliderHandle)>,
    /// Pairs of links whose covers pass through each other.
    ignored_pairs: BTreeSet<(Option<usize>, Option<usize>)>,
    angles: Vec<f64>,
    speeds: Vec<f64>,
}

impl Linkage {
    /// Builds the mechanism at joint coordinates `start` (rad or m). `covers` are collision shapes with their links
    /// (`None` for the root).
    pub fn new(
        settings: EngineSettings,
        mechanism: &LinkageModel<'_>,
        covers: Vec<(Option<usize>, ColliderBuilder)>,
        start: &[f64],
    ) -> Self {
        let LinkageModel { tree, masses, .. } = *mechanism;
        let mut engine = Engine::new(settings);
        let root = engine.bodies.insert(RigidBodyBuilder::fixed());
        let poses = tree.forward(&vec![0.0; tree.len()]);
        let mut links: Vec<RigidBodyHandle> = Vec::new();
        let mut joints = Vec::new();
        for (i, joint) in tree.joints.iter().enumerate() {
            let body = engine.bodies.insert(link_body(&poses[i], &masses[i]));
            let parent = match joint.parent {
                Some(parent) => links[parent],
                None if mechanism.separate_roots => engine.bodies.insert(RigidBodyBuilder::fixed()),
                None => root,
            };
            let joint = joint_builder(joint.kind)(&joint.origin, &joint.axis, [joint.lower, joint.upper]);
            joints.extend(engine.multibodies.insert(parent, body, joint, true));
            links.push(body);
        }
        let covers = covers
            .into_iter()
            .map(|(link, collider)| {
                let body = link.map_or(root, |link| links[link]);
                (link, engine.colliders.insert_with_parent(collider, body, &mut engine.bodies))
            })
            .collect();
        let mut linkage = Self {
            engine,
            links,
            joints,
            kinds: tree.joints.iter().map(|joint| joint.kind).collect(),
            dof_indices: Vec::new(),
            covers,
            ignored_pairs: BTreeSet::new(),
            angles: start.to_vec(),
            speeds: vec![0.0; start.len()],
        };
        linkage.settle(start, mechanism);
        linkage
    }

    /// Sets up the degrees of freedom of every multibody; the joints of a multibody are consecutive in the tree.
    fn settle(&mut self, start: &[f64], mechanism: &LinkageModel<'_>) {
        let mut first = 0;
        while let Some(handle) = self.joints.get(first) {
            let Some((multibody, _)) = self.engine.multibodies.get_mut(*handle) else { return };
            multibody.set_self_contacts_enabled(true);
            // A fixed root is first treated as a free one; this call settles the degrees of freedom.
            multibody.forward_kinematics(&self.engine.bodies, true);
            let own = first..first + multibody.ndofs();
            multibody.damping_mut().as_mut_slice().copy_from_slice(&mechanism.damping[own.clone()]);
            multibody.armature_mut().as_mut_slice().copy_from_slice(&mechanism.armature[own.clone()]);
            multibody.apply_displacements(&start[own.clone()]);
            multibody.forward_kinematics(&self.engine.bodies, false);
            multibody.update_rigid_bodies(&mut self.engine.bodies, true);
            self.dof_indices.extend(0..own.len());
            first = own.end;
        }
    }

    /// Lets the covers of two links (`None` for the root) pass through each other.
    pub fn ignore_collisions(&mut self, one: Option<usize>, two: Option<usize>) {
        let of = |link: Option<usize>| self.covers.iter().filter(move |(own, _)| *own == link).map(|(_, cover)| *cover);
        let pairs: Vec<_> = of(one).flat_map(|a| of(two).map(move |b| (a, b))).collect();
        for (a, b) in pairs {
            self.engine.ignore_collisions(a, b);
        }
        self.ignored_pairs.insert((one.min(two), one.max(two)));
    }

    /// Couples a joint to another.
    pub fn couple(&mut self, follower: &Follower) {
        let [leader, joint] = [follower.leader, follower.joint].map(|own| (self.joints[own], self.kinds[own]));
        couple_joints(&mut self.engine, leader, joint, follower);
    }

    /// Advances one physics step under these efforts, one per joint.
    pub fn step(&mut self, efforts: &[JointEffort]) {
        let slack = self.engine.limit_slack();
        for (n, (handle, effort)) in self.joints.iter().zip(efforts).enumerate() {
            if let Some((multibody, link)) = self.engine.multibodies.get_mut(*handle)
                && let Some(link) = multibody.link_mut(link)
            {
                let (joint, at) = (&mut link.joint, self.angles[n]);
                match self.kinds[n] {
                    JointKind::Turn => set_hinge_torque(joint, at, effort.torque, effort.stiffness, slack),
                    JointKind::Slide => set_slide_force(joint, at, effort.torque, effort.stiffness, SLIDE_SLACK),
                }
            }
        }
        self.engine.step();
        self.read();
    }

    fn read(&mut self) {
        for (i, handle) in self.joints.iter().enumerate() {
            let Some((multibody, link)) = self.engine.multibodies.get(*handle) else { continue };
            let Some(link) = multibody.link(link) else { continue };
            self.angles[i] = link.joint.coords()[dof_index(self.kinds[i])];
            self.speeds[i] = multibody.generalized_velocity()[self.dof_indices[i]];
        }
    }

    /// Sets gravity (m/s2, root frame).
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.engine.gravity = convert::vector(gravity);
    }

    /// Returns the joint coordinates, rad or m.
    pub fn angles(&self) -> &[f64] {
        &self.angles
    }

    /// Returns the joint speeds, rad/s or m/s.
    pub fn speeds(&self) -> &[f64] {
        &self.speeds
    }

    /// Returns `root_from_link` of every link.
    pub fn links(&self) -> Vec<Isometry3<f64>> {
        self.links.iter().map(|link| convert::to_pose(self.engine.bodies[*link].position())).collect()
    }

    /// Gives access to the engine, to insert other bodies.
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// Returns the link to which the cover `collider` belongs (`Some(None)` for the root), if it is a cover.
    pub fn cover_of(&self, collider: ColliderHandle) -> Option<Option<usize>> {
        self.covers.iter().find(|(_, cover)| *cover == collider).map(|(link, _)| *link)
    }

    /// Returns the deepest penetration between `collider` and the covers, m; 0 without overlap.
    pub fn penetration(&self, collider: ColliderHandle) -> f64 {
        self.covers.iter().map(|(_, cover)| self.penetration_between(*cover, collider)).fold(0.0, f64::max)
    }

    /// Returns the deepest penetration between any two covers, m, of links that no joint connects and that may not pass
    /// through each other.
    pub fn self_penetration(&self, tree: &Tree) -> f64 {
        let mut deepest: f64 = 0.0;
        for (i, (a, first)) in self.covers.iter().enumerate() {
            for (b, second) in &self.covers[i + 1..] {
                if !are_connected(tree, *a, *b) && !self.ignored_pairs.contains(&(*a.min(b), *a.max(b))) {
                    deepest = deepest.max(self.penetration_between(*first, *second));
                }
            }
        }
        deepest
    }

    fn penetration_between(&self, a: ColliderHandle, b: ColliderHandle) -> f64 {
        let pose = |handle: ColliderHandle| {
            let collider = &self.engine.colliders[handle];
            // Use the body's pose: a collider's own pose lags one step behind.
            match (collider.parent(), collider.position_wrt_parent()) {
                (Some(body), Some(local)) => *self.engine.bodies[body].position() * *local,
                _ => *collider.position(),
            }
        };
        let shape = |handle: ColliderHandle| self.engine.colliders[handle].shape();
        penetration_depth(&pose(a), shape(a), &pose(b), shape(b))
    }
}

/// True if two links (`None` for the root) are the same or connected by a joint.
pub fn are_connected(tree: &Tree, a: Option<usize>, b: Option<usize>) -> bool {
    let parent = |link: Option<usize>| link.and_then(|link| tree.joints[link].parent);
    a == b || (a.is_some() && parent(a) == b) || (b.is_some() && parent(b) == a)
}

/// Computes the penetration depth of two shapes at these poses, m; 0 if they do not overlap.
pub fn penetration_depth(pose_a: &Pose, a: &dyn Shape, pose_b: &Pose, b: &dyn Shape) -> f64 {
    if !a.compute_aabb(pose_a).intersects(&b.compute_aabb(pose_b)) {
        return 0.0;
    }
    match query::contact(pose_a, a, pose_b, b, 0.0) {
        Ok(Some(contact)) => (-contact.dist).max(0.0),
        // No contact, or a pair of shapes that parry cannot compare; that does not occur for rounded boxes and hulls.
        _ => 0.0,
    }
}
