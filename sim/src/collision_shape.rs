//! The collision shapes of objects: primitives, rounded where a sharp edge would chatter, and meshes as convex parts.

use rapier3d_f64::geometry::SharedShape;
use rapier3d_f64::math::{Pose, Rotation, Vector};
use world::geometry::Shape;

use crate::hull::standing_hull;

/// Rounding radius of a cylinder's rim, m; a sharp rim chatters.
const RIM: f64 = 0.002;

/// Builds the collision shape of an object.
pub fn shape(shape: &Shape) -> SharedShape {
    match shape {
        Shape::Sphere { .. } | Shape::Cuboid { .. } => {
            let mut parts = convex_parts(shape);
            parts.swap_remove(0).1
        }
        Shape::Cylinder { .. } | Shape::Mesh(_) => SharedShape::compound(convex_parts(shape)),
    }
}

/// Decomposes a shape into convex parts, each with its pose in the object's frame.
pub fn convex_parts(shape: &Shape) -> Vec<(Pose, SharedShape)> {
    match shape {
        Shape::Sphere { radius } => vec![(Pose::IDENTITY, SharedShape::ball(*radius))],
        Shape::Cylinder { radius, half_height } => {
            // parry's cylinder has its axis along y.
            let upright = Pose::from_rotation(Rotation::from_rotation_arc(Vector::Y, Vector::Z));
            vec![(upright, SharedShape::round_cylinder(half_height - RIM, radius - RIM, RIM))]
        }
        Shape::Cuboid { half, radius } => vec![(
            Pose::IDENTITY,
            SharedShape::round_cuboid(half.x - radius, half.y - radius, half.z - radius, *radius),
        )],
        Shape::Mesh(_) => {
            shape.convex_parts().iter().filter_map(|points| Some((Pose::IDENTITY, standing_hull(points)?))).collect()
        }
    }
}
