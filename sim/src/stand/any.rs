//! Any hand on the stand: a mechanism read from files, moved by the tensions of its actuators.

use std::collections::BTreeSet;
use std::sync::Arc;

use hand_model::any_hand::{AnyHand, SolidShape};
use hand_model::kinematics::JointKind;
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use rapier3d_f64::geometry::{Capsule, ConvexPolyhedron};
use rapier3d_f64::prelude::*;

use super::linkage::{self, Linkage, Mechanism};
use super::prop::Prop;
use crate::body::groups;
use crate::contacts::{ContactPoint, contacts_of};
use crate::convert;
use crate::drive::JointEffort;
use crate::engine::EngineSettings;
use crate::hand_scene::Touch;

/// Two links; `None` is the root.
pub type LinkPair = (Option<usize>, Option<usize>);

/// A hand with its collision shapes, made once for all of its stands.
#[derive(Clone)]
pub struct AnyBody {
    hand: Arc<AnyHand>,
    shapes: Vec<(Option<usize>, Pose, SharedShape)>,
    passing: BTreeSet<LinkPair>,
}

impl AnyBody {
    pub fn new(hand: Arc<AnyHand>) -> Self {
        let shapes = hand
            .solids
            .iter()
            .filter_map(|solid| Some((solid.link, convert::pose(&solid.link_from_solid), shape(&solid.shape)?)))
            .collect::<Vec<_>>();
        let passing = passing(&hand, &shapes);
        Self { hand, shapes, passing }
    }

    pub fn hand(&self) -> &Arc<AnyHand> {
        &self.hand
    }

    /// Pairs of links that pass through each other: no joint connects them, but their collision shapes overlap at rest already, as
    /// those of published models often do at their joints.
    pub fn passing(&self) -> &BTreeSet<LinkPair> {
        &self.passing
    }

    /// Pairs of links that never collide: what a joint connects, and [`Self::passing`].
    pub(crate) fn excluded(&self) -> BTreeSet<LinkPair> {
        let joined = self.hand.tree.joints.iter().enumerate().map(|(link, joint)| (joint.parent, Some(link)));
        self.passing.iter().copied().chain(joined).collect()
    }
}

fn passing(hand: &AnyHand, shapes: &[(Option<usize>, Pose, SharedShape)]) -> BTreeSet<LinkPair> {
    let links = hand.tree.forward(&hand.rest());
    let place = |(link, pose, _): &(Option<usize>, Pose, SharedShape)| match link {
        Some(link) => convert::pose(&links[*link]) * *pose,
        None => *pose,
    };
    let mut passing = BTreeSet::new();
    for (n, one) in shapes.iter().enumerate() {
        for other in &shapes[n + 1..] {
            let pair = (one.0.min(other.0), one.0.max(other.0));
            let known = linkage::joined(&hand.tree, one.0, other.0) || passing.contains(&pair);
            if !known && linkage::overlap(&place(one), &*one.2, &place(other), &*other.2) > 0.0 {
                passing.insert(pair);
            }
        }
    }
    passing
}

/// The hand with what has been put into it. Its links collide with each other, but for those that a joint connects and those
/// that [`AnyBody::passing`] names.
#[derive(Clone)]
pub struct AnyStand {
    hand: Arc<AnyHand>,
    linkage: Linkage,
    props: Vec<(RigidBodyHandle, ColliderHandle)>,
}

impl AnyStand {
    /// The hand at rest, without gravity.
    pub fn new(body: &AnyBody, settings: EngineSettings) -> Self {
        Self::at(body, settings, &body.hand.rest())
    }

    /// The hand at joint coordinates `start` (rad or m), without gravity.
    pub fn at(body: &AnyBody, settings: EngineSettings, start: &[f64]) -> Self {
        let hand = body.hand.clone();
        let covers = body
            .shapes
            .iter()
            .map(|(link, pose, shape)| {
                let collider = ColliderBuilder::new(shape.clone())
                    .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS)
                    .position(*pose)
                    .density(0.0)
                    .friction(0.0)
                    .friction_combine_rule(CoefficientCombineRule::Max)
                    .collision_groups(
                        InteractionGroups::all()
                            .with_memberships(groups::HAND)
                            .with_filter(groups::HAND | groups::OBJECT),
                    );
                (*link, collider)
            })
            .collect();
        let mechanism = Mechanism {
            tree: &hand.tree,
            masses: &hand.masses,
            damping: hand.turn.damping,
            armature: hand.turn.armature,
        };
        let mut linkage = Linkage::new(settings, &mechanism, covers, start);
        for joint in (0..hand.tree.len()).filter(|joint| hand.tree.joints[*joint].kind == JointKind::Slide) {
            linkage.set_feel(joint, hand.slide.damping, hand.slide.armature);
        }
        linkage.set_gravity(&Vector3::zeros());
        for (one, two) in &body.passing {
            linkage.let_pass(*one, *two);
        }
        for follower in &hand.followers {
            linkage.couple(follower.leader, follower.joint, follower.multiplier, follower.offset);
        }
        Self { hand, linkage, props: Vec::new() }
    }

    /// Puts a prop at `root_from_prop`, held in place until [`Self::release`].
    pub fn put(&mut self, prop: &Prop, root_from_prop: &Isometry3<f64>) {
        self.props.push(prop.insert(self.linkage.engine_mut(), root_from_prop));
    }

    /// Lets go of all props.
    pub fn release(&mut self) {
        for (body, _) in &self.props {
            self.linkage.engine_mut().bodies[*body].set_body_type(RigidBodyType::Dynamic, true);
        }
    }

    /// Steps for `seconds` with a tension (N) in each actuator's cable.
    pub fn run(&mut self, tensions: &[f64], seconds: f64) {
        let steps = (seconds / self.dt()).round() as usize;
        for _ in 0..steps {
            self.step(tensions, &Vector3::zeros());
        }
    }

    /// Sets gravity (m/s2, root frame).
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.linkage.set_gravity(gravity);
    }

    /// One step with a tension (N) in each actuator's cable and a `force` (N, root frame) on every prop's centre of mass.
    pub fn step(&mut self, tensions: &[f64], force: &Vector3<f64>) {
        for (body, _) in &self.props {
            let body = &mut self.linkage.engine_mut().bodies[*body];
            body.reset_forces(true);
            body.add_force(convert::vector(force), true);
        }
        let torques = self.hand.torques(self.linkage.angles(), tensions);
        let efforts = torques.into_iter().enumerate();
        let efforts: Vec<JointEffort> =
            efforts.map(|(joint, torque)| JointEffort { torque, stiffness: self.hand.feel(joint).spring }).collect();
        self.linkage.step(&efforts);
    }

    /// Length of a step, s.
    pub fn dt(&self) -> f64 {
        self.linkage.engine().settings.dt
    }

    /// Damping of the props' motion, 1/s, linear and angular.
    pub fn set_prop_damping(&mut self, damping: f64) {
        for (body, _) in &self.props {
            let body = &mut self.linkage.engine_mut().bodies[*body];
            body.set_linear_damping(damping);
            body.set_angular_damping(damping);
        }
    }

    /// Friction coefficient between hand and props.
    pub fn set_friction(&mut self, friction: f64) {
        for (_, collider) in &self.props {
            self.linkage.engine_mut().colliders[*collider].set_friction(friction);
        }
    }

    /// `root_from_prop` of every prop.
    pub fn poses(&self) -> Vec<Isometry3<f64>> {
        let bodies = &self.linkage.engine().bodies;
        self.props.iter().map(|(body, _)| convert::to_pose(bodies[*body].position())).collect()
    }

    /// The collision shapes as triangles in the root frame, three points a triangle: for pictures.
    pub fn triangles(&self) -> Vec<[Point3<f64>; 3]> {
        let links = self.links();
        let mut triangles = Vec::new();
        for solid in &self.hand.solids {
            let pose = solid.link.map_or(Isometry3::identity(), |link| links[link]) * solid.link_from_solid;
            for (vertices, indices) in surface(&solid.shape) {
                let place = |index: u32| pose * Point3::from(convert::to_vector(vertices[index as usize]));
                triangles.extend(indices.iter().map(|corners| corners.map(place)));
            }
        }
        triangles
    }

    /// Loaded contacts between hand and props, root frame.
    pub fn touches(&self) -> Vec<Touch> {
        let contacts = self.props.iter().flat_map(|(_, prop)| contacts_of(self.linkage.engine(), *prop));
        let touch = |contact: ContactPoint| {
            Some(Touch {
                link: self.linkage.cover_of(contact.other)?,
                point: contact.point,
                normal: UnitVector3::new_normalize(-contact.normal),
                force: contact.force,
            })
        };
        contacts.filter_map(touch).collect()
    }

    /// How deep hand and props, or two links that collide, overlap at most, m.
    pub fn penetration(&self) -> f64 {
        let props = self.props.iter().map(|(_, prop)| self.linkage.penetration(*prop));
        props.fold(self.self_penetration(), f64::max)
    }

    /// How deep two links that collide overlap at most, m.
    pub fn self_penetration(&self) -> f64 {
        self.linkage.self_penetration(&self.hand.tree)
    }

    /// Joint coordinates, rad or m.
    pub fn angles(&self) -> &[f64] {
        self.linkage.angles()
    }

    /// `root_from_link` of every moving link.
    pub fn links(&self) -> Vec<Isometry3<f64>> {
        self.linkage.links()
    }

    /// Normal force of each moving link on the props, N.
    pub fn forces(&self) -> Vec<f64> {
        let mut forces = vec![0.0; self.hand.tree.len()];
        for contact in self.props.iter().flat_map(|(_, prop)| contacts_of(self.linkage.engine(), *prop)) {
            if let Some(Some(link)) = self.linkage.cover_of(contact.other) {
                forces[link] += contact.force;
            }
        }
        forces
    }
}

/// A capsule along z.
fn capsule(radius: f64, half: f64) -> Capsule {
    Capsule::new(-Vector::Z * half, Vector::Z * half, radius)
}

/// The corners of the convex hull of a mesh's points; none where they span no volume.
pub(crate) fn hull(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    surface(&SolidShape::Hull(points.to_vec()))
        .into_iter()
        .flat_map(|(vertices, _)| vertices)
        .map(|vertex| Point3::from(convert::to_vector(vertex)))
        .collect()
}

/// Vertices and triangles of a shape's surface.
fn surface(shape: &SolidShape) -> Vec<(Vec<Vector>, Vec<[u32; 3]>)> {
    const ROUND: u32 = 20;
    match shape {
        SolidShape::Cuboid(half) => vec![Cuboid::new(convert::vector(half)).to_trimesh()],
        SolidShape::Sphere(radius) => vec![Ball::new(*radius).to_trimesh(ROUND, ROUND)],
        SolidShape::Cylinder(radius, half) => {
            let (vertices, triangles) = Cylinder::new(*half, *radius).to_trimesh(ROUND);
            let upright = Rotation::from_rotation_arc(Vector::Y, Vector::Z);
            vec![(vertices.into_iter().map(|vertex| upright * vertex).collect(), triangles)]
        }
        SolidShape::Capsule(radius, half) => {
            let (vertices, triangles) = capsule(*radius, *half).to_trimesh(ROUND, ROUND);
            vec![(vertices, triangles)]
        }
        SolidShape::Hull(points) => {
            let points: Vec<Vector> = points.iter().map(convert::point).collect();
            ConvexPolyhedron::from_convex_hull(&points).map(|hull| hull.to_trimesh()).into_iter().collect()
        }
    }
}

/// The collision shape; none where the points of a mesh span no volume.
fn shape(shape: &SolidShape) -> Option<SharedShape> {
    match shape {
        SolidShape::Cuboid(half) => Some(SharedShape::cuboid(half.x, half.y, half.z)),
        SolidShape::Sphere(radius) => Some(SharedShape::ball(*radius)),
        SolidShape::Cylinder(radius, half) => {
            // parry's cylinder stands along y.
            let upright = Pose::from_rotation(Rotation::from_rotation_arc(Vector::Y, Vector::Z));
            Some(SharedShape::compound(vec![(upright, SharedShape::cylinder(*half, *radius))]))
        }
        SolidShape::Capsule(radius, half) => Some(SharedShape::new(capsule(*radius, *half))),
        SolidShape::Hull(points) => {
            let points: Vec<Vector> = points.iter().map(convert::point).collect();
            SharedShape::convex_hull(&points)
        }
    }
}
