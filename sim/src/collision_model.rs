//! Collision shapes of a hand for the physics engine.

use std::collections::BTreeSet;
use std::sync::Arc;

use hand_model::hand_mechanism::{HandMechanism, SolidShape};
use hand_model::kinematics::Tree;
use nalgebra::{Isometry3, Point3};
use rapier3d_f64::geometry::{Capsule, ConvexPolyhedron};
use rapier3d_f64::prelude::*;
use world::geometry::ObjectShape as Geometry;

use crate::body::groups;
use crate::convert;
use crate::test_stand::{are_connected, penetration_depth};

/// Collision group of the palm when the digits are separate multibodies.
const PALM_GROUP: Group = Group::GROUP_5;

/// Two links; `None` for the root.
pub type LinkPair = (Option<usize>, Option<usize>);

/// A hand with its collision shapes, built once for all of its scenes.
#[derive(Clone)]
pub struct CollisionModel {
    hand: Arc<HandMechanism>,
    shapes: Vec<(Option<usize>, Pose, SharedShape)>,
    ignored_pairs: BTreeSet<LinkPair>,
}

impl CollisionModel {
    pub fn new(hand: Arc<HandMechanism>) -> Self {
        let shapes = hand
            .solids
            .iter()
            .filter_map(|solid| Some((solid.link, convert::pose(&solid.link_from_solid), shape(&solid.shape)?)))
            .collect::<Vec<_>>();
        let passing = if hand.independent_digits { BTreeSet::new() } else { find_ignored_pairs(&hand, &shapes) };
        Self { hand, shapes, ignored_pairs: passing }
    }

    pub fn hand(&self) -> &Arc<HandMechanism> {
        &self.hand
    }

    /// Returns the pairs of links that may pass through each other: no joint connects them, but their collision shapes
    /// already overlap at rest, as is common at the joints of published models.
    pub fn ignored_pairs(&self) -> &BTreeSet<LinkPair> {
        &self.ignored_pairs
    }

    /// Returns the pairs of links that never collide: those connected by a joint, and [`Self::ignored_pairs`].
    pub(crate) fn excluded_pairs(&self) -> BTreeSet<LinkPair> {
        let joined = self.hand.tree.joints.iter().enumerate().map(|(link, joint)| (joint.parent, Some(link)));
        self.ignored_pairs.iter().copied().chain(joined).collect()
    }

    /// Builds the colliders of all shapes, with their links.
    pub(crate) fn colliders(&self) -> Vec<(Option<usize>, ColliderBuilder)> {
        let collider = |(link, pose, shape): &(Option<usize>, Pose, SharedShape)| {
            let collider = ColliderBuilder::new(shape.clone())
                .active_hooks(ActiveHooks::MODIFY_SOLVER_CONTACTS)
                .position(*pose)
                .density(0.0)
                .friction(0.0)
                .friction_combine_rule(CoefficientCombineRule::Max)
                .collision_groups(link_groups(&self.hand.tree, *link, self.hand.independent_digits));
            (*link, collider)
        };
        self.shapes.iter().map(collider).collect()
    }

    /// Triangulates the shapes in the root frame, three points a triangle, with the links at `root_from_link`; used for
    /// images.
    pub fn triangles(&self, root_from_link: &[Isometry3<f64>]) -> Vec<[Point3<f64>; 3]> {
        let mut triangles = Vec::new();
        for solid in &self.hand.solids {
            let pose = solid.link.map_or(Isometry3::identity(), |link| root_from_link[link]) * solid.link_from_solid;
            for (vertices, indices) in triangulate(&solid.shape) {
                let place = |index: u32| pose * Point3::from(convert::to_vector(vertices[index as usize]));
                triangles.extend(indices.iter().map(|corners| corners.map(place)));
            }
        }
        triangles
    }
}

/// Returns the collision groups of a link (`None` for the palm) of a hand on the stand. Links connected by a joint do not
/// collide. Within a multibody the engine ensures that. Between the palm and the first links of `separate` digits, which
/// have roots of their own, the groups do.
pub(crate) fn link_groups(tree: &Tree, link: Option<usize>, separate: bool) -> InteractionGroups {
    let links = groups::HAND | groups::OBJECT;
    let (member, filter) = match link.map(|link| tree.joints[link].parent) {
        None if separate => (PALM_GROUP, links),
        Some(Some(_)) if separate => (groups::HAND, links | PALM_GROUP),
        _ => (groups::HAND, links),
    };
    InteractionGroups::all().with_memberships(member).with_filter(filter)
}

fn find_ignored_pairs(hand: &HandMechanism, shapes: &[(Option<usize>, Pose, SharedShape)]) -> BTreeSet<LinkPair> {
    let links = hand.tree.forward(&hand.rest_coordinates());
    let place = |(link, pose, _): &(Option<usize>, Pose, SharedShape)| match link {
        Some(link) => convert::pose(&links[*link]) * *pose,
        None => *pose,
    };
    let mut passing = BTreeSet::new();
    for (n, one) in shapes.iter().enumerate() {
        for other in &shapes[n + 1..] {
            let pair = (one.0.min(other.0), one.0.max(other.0));
            let known = are_connected(&hand.tree, one.0, other.0) || passing.contains(&pair);
            if !known && penetration_depth(&place(one), &*one.2, &place(other), &*other.2) > 0.0 {
                passing.insert(pair);
            }
        }
    }
    passing
}

/// Builds a capsule along z.
fn capsule(radius: f64, half: f64) -> Capsule {
    Capsule::new(-Vector::Z * half, Vector::Z * half, radius)
}

/// Computes the vertices of the convex hull of a mesh's points; empty if they span no volume.
pub(crate) fn hull(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    triangulate(&SolidShape::Hull(points.to_vec()))
        .into_iter()
        .flat_map(|(vertices, _)| vertices)
        .map(|vertex| Point3::from(convert::to_vector(vertex)))
        .collect()
}

/// Triangulates a shape's surface.
fn triangulate(shape: &SolidShape) -> Vec<(Vec<Vector>, Vec<[u32; 3]>)> {
    const ROUND_SEGMENTS: u32 = 20;
    match shape {
        SolidShape::Cuboid(half) => vec![Cuboid::new(convert::vector(half)).to_trimesh()],
        SolidShape::RoundedCuboid(half, radius) => {
            let (points, triangles, _) = Geometry::Cuboid { half: *half, radius: *radius }.triangles();
            vec![(points.iter().map(convert::point).collect(), triangles)]
        }
        SolidShape::Sphere(radius) => vec![Ball::new(*radius).to_trimesh(ROUND_SEGMENTS, ROUND_SEGMENTS)],
        SolidShape::Cylinder(radius, half) => {
            let (vertices, triangles) = Cylinder::new(*half, *radius).to_trimesh(ROUND_SEGMENTS);
            let upright = Rotation::from_rotation_arc(Vector::Y, Vector::Z);
            vec![(vertices.into_iter().map(|vertex| upright * vertex).collect(), triangles)]
        }
        SolidShape::Capsule(radius, half) => {
            let (vertices, triangles) = capsule(*radius, *half).to_trimesh(ROUND_SEGMENTS, ROUND_SEGMENTS);
            vec![(vertices, triangles)]
        }
        SolidShape::Hull(points) => {
            let points: Vec<Vector> = points.iter().map(convert::point).collect();
            ConvexPolyhedron::from_convex_hull(&points).map(|hull| hull.to_trimesh()).into_iter().collect()
        }
    }
}

/// Builds the collision shape; none if the points of a mesh span no volume.
fn shape(shape: &SolidShape) -> Option<SharedShape> {
    match shape {
        SolidShape::Cuboid(half) => Some(SharedShape::cuboid(half.x, half.y, half.z)),
        SolidShape::RoundedCuboid(half, radius) => {
            let inner = half.add_scalar(-radius);
            Some(SharedShape::round_cuboid(inner.x, inner.y, inner.z, *radius))
        }
        SolidShape::Sphere(radius) => Some(SharedShape::ball(*radius)),
        SolidShape::Cylinder(radius, half) => {
            // parry's cylinder has its axis along y.
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
