//! The collision shapes of objects: primitives, rounded where a sharp edge would chatter, and meshes as convex parts.

use rapier3d_f64::geometry::SharedShape;
use rapier3d_f64::math::{Pose, Rotation, Vector};
use world::geometry::ObjectShape;

/// Rounding radius of a cylinder's rim, m; a sharp rim chatters.
const RIM_RADIUS: f64 = 0.002;

/// Builds the collision shape of an object.
pub fn collision_shape(shape: &ObjectShape) -> SharedShape {
    match shape {
        ObjectShape::Sphere { .. } | ObjectShape::Cuboid { .. } => {
            let mut parts = convex_parts(shape);
            parts.swap_remove(0).1
        }
        ObjectShape::Cylinder { .. } | ObjectShape::Mesh(_) => SharedShape::compound(convex_parts(shape)),
    }
}

/// Decomposes a shape into convex parts, each with its pose in the object's frame.
pub fn convex_parts(shape: &ObjectShape) -> Vec<(Pose, SharedShape)> {
    match shape {
        ObjectShape::Sphere { radius } => vec![(Pose::IDENTITY, SharedShape::ball(*radius))],
        ObjectShape::Cylinder { radius, half_height } => {
            // parry's cylinder has its axis along y.
            let upright = Pose::from_rotation(Rotation::from_rotation_arc(Vector::Y, Vector::Z));
            vec![(upright, SharedShape::round_cylinder(half_height - RIM_RADIUS, radius - RIM_RADIUS, RIM_RADIUS))]
        }
        ObjectShape::Cuboid { half, radius } => vec![(
            Pose::IDENTITY,
            SharedShape::round_cuboid(half.x - radius, half.y - radius, half.z - radius, *radius),
        )],
        ObjectShape::Mesh(mesh) => mesh.standing_hulls().iter().map(|hull| (Pose::IDENTITY, hull.clone())).collect(),
    }
}
