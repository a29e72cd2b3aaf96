//! Conversions between nalgebra (our types) and glam (rapier's types).

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::math::{Matrix, Pose, Rotation, Vector};

/// Converts a vector from nalgebra to rapier.
pub fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// Converts a point from nalgebra to rapier.
pub fn point(p: &Point3<f64>) -> Vector {
    Vector::new(p.x, p.y, p.z)
}

/// Converts a vector from rapier to nalgebra.
pub fn to_vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// Converts a pose from nalgebra to rapier.
pub fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation.quaternion();
    Pose { rotation: Rotation::from_xyzw(q.i, q.j, q.k, q.w), translation: vector(&p.translation.vector) }
}

/// Converts a pose from rapier to nalgebra.
pub fn to_pose(p: &Pose) -> Isometry3<f64> {
    let q = p.rotation;
    Isometry3::from_parts(
        Translation3::from(to_vector(p.translation)),
        UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z)),
    )
}

/// Converts a matrix from nalgebra to rapier.
pub fn matrix(m: &Matrix3<f64>) -> Matrix {
    Matrix::from_cols(
        vector(&m.column(0).into_owned()),
        vector(&m.column(1).into_owned()),
        vector(&m.column(2).into_owned()),
    )
}
