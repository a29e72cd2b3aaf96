//! Between nalgebra (our types) and glam (rapier's types).

use crate::hull::standing_hull;
use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::geometry::SharedShape;
use rapier3d_f64::math::{Matrix, Pose, Rotation, Vector};
use scenarios::geometry::Shape;

/// Rounding of a cylinder's rim, m; a sharp one chatters.
const RIM: f64 = 0.002;

/// nalgebra vector to rapier.
pub fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// nalgebra point to rapier.
pub fn point(p: &Point3<f64>) -> Vector {
    Vector::new(p.x, p.y, p.z)
}

/// rapier vector to nalgebra.
pub fn to_vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// nalgebra pose to rapier.
pub fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation.quaternion();
    Pose { rotation: Rotation::from_xyzw(q.i, q.j, q.k, q.w), translation: vector(&p.translation.vector) }
}

/// rapier pose to nalgebra.
pub fn to_pose(p: &Pose) -> Isometry3<f64> {
    let q = p.rotation;
    Isometry3::from_parts(
        Translation3::from(to_vector(p.translation)),
        UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z)),
    )
}

/// nalgebra matrix to rapier.
pub fn matrix(m: &Matrix3<f64>) -> Matrix {
    Matrix::from_cols(
        vector(&m.column(0).into_owned()),
        vector(&m.column(1).into_owned()),
        vector(&m.column(2).into_owned()),
    )
}

/// The collision shape of an object's shape.
pub fn shape(shape: &Shape) -> SharedShape {
    match shape {
        Shape::Sphere { .. } | Shape::Cuboid { .. } => {
            let mut parts = convex_parts(shape);
            parts.swap_remove(0).1
        }
        Shape::Cylinder { .. } | Shape::Mesh(_) => SharedShape::compound(convex_parts(shape)),
    }
}

/// The convex pieces of a shape, each with its pose in the object's frame.
pub fn convex_parts(shape: &Shape) -> Vec<(Pose, SharedShape)> {
    match shape {
        Shape::Sphere { radius } => vec![(Pose::IDENTITY, SharedShape::ball(*radius))],
        Shape::Cylinder { radius, half_height } => {
            // parry's cylinder stands along y.
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
