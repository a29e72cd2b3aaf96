//! Props that are put into the hand: one or several solid shapes, rigidly joined.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rapier3d_f64::prelude::*;
use world::geometry::ObjectShape;

use crate::body::groups;
use crate::collision_shape;
use crate::convert;
use crate::engine::Engine;

/// A rigid prop. Its mass is distributed evenly over the volume of its parts.
#[derive(Debug, Clone)]
pub struct Prop {
    pub name: String,
    /// Parts with their pose in the prop's frame, m.
    pub parts: Vec<(Isometry3<f64>, ObjectShape)>,
    /// Mass, kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand.
    pub friction: f64,
}

impl Prop {
    /// Creates a prop of one shape.
    pub fn new(name: &str, shape: ObjectShape, mass: f64, friction: f64) -> Self {
        Self { name: name.into(), parts: vec![(Isometry3::identity(), shape)], mass, friction }
    }

    /// Creates a dumbbell along z: a handle between two cylindrical weights, m and kg.
    pub fn dumbbell(handle_radius: f64, handle_length: f64, weight_radius: f64, weight_length: f64, mass: f64) -> Self {
        let cylinder = |radius: f64, length: f64| ObjectShape::Cylinder { radius, half_height: 0.5 * length };
        let away = 0.5 * (handle_length + weight_length);
        Self {
            name: "dumbbell".into(),
            parts: vec![
                (Isometry3::identity(), cylinder(handle_radius, handle_length)),
                (Isometry3::translation(0.0, 0.0, away), cylinder(weight_radius, weight_length)),
                (Isometry3::translation(0.0, 0.0, -away), cylinder(weight_radius, weight_length)),
            ],
            mass,
            friction: 0.8,
        }
    }

    /// Computes the size along the prop's axes, m.
    pub fn extent(&self) -> Vector3<f64> {
        let corners = self.parts.iter().flat_map(|(pose, shape)| {
            let (a, b) = shape.aabb();
            let corner = move |n: usize, axis: usize| if n >> axis & 1 == 1 { b[axis] } else { a[axis] };
            (0..8).map(move |n| (pose * Point3::new(corner(n, 0), corner(n, 1), corner(n, 2))).coords)
        });
        let nothing = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (low, high) = corners.fold(nothing, |(low, high), corner| (low.inf(&corner), high.sup(&corner)));
        high - low
    }

    /// Computes the centre of mass (m) and the inertia about it (kg m2) in the prop's axes.
    pub fn inertia(&self) -> (Point3<f64>, Matrix3<f64>) {
        let volume: f64 = self.parts.iter().map(|(_, shape)| shape.volume()).sum();
        let parts: Vec<(f64, Point3<f64>, Matrix3<f64>)> = self
            .parts
            .iter()
            .map(|(pose, shape)| {
                let mass = self.mass * shape.volume() / volume;
                let (com, inertia) = shape.inertia(mass);
                let turn = pose.rotation.to_rotation_matrix();
                (mass, pose * com, turn * inertia * turn.transpose())
            })
            .collect();
        let com: Vector3<f64> = parts.iter().map(|(mass, com, _)| com.coords * *mass).sum::<Vector3<f64>>() / self.mass;
        let inertia = parts
            .iter()
            .map(|(mass, at, inertia)| {
                let d = at.coords - com;
                inertia + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * *mass
            })
            .sum();
        (com.into(), inertia)
    }

    /// Computes the signed distance from `point` (prop frame, m) to the surface, and the outward direction there.
    pub fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let mut nearest = (f64::INFINITY, Vector3::z());
        for (pose, shape) in &self.parts {
            let (distance, outward) = shape.signed_distance(&pose.inverse_transform_point(point));
            if distance < nearest.0 {
                nearest = (distance, pose * outward);
            }
        }
        nearest
    }

    /// Inserts the prop as a fixed body.
    pub(crate) fn insert(&self, engine: &mut Engine, pose: &Isometry3<f64>) -> (RigidBodyHandle, ColliderHandle) {
        let (com, inertia) = self.inertia();
        let mass = MassProperties::with_inertia_matrix(convert::point(&com), self.mass, convert::matrix(&inertia));
        let body =
            RigidBodyBuilder::fixed().pose(convert::pose(pose)).can_sleep(false).additional_mass_properties(mass);
        let body = engine.bodies.insert(body);
        let shape = match &self.parts[..] {
            [(only, shape)] if *only == Isometry3::identity() => collision_shape::collision_shape(shape),
            parts => SharedShape::compound(
                parts
                    .iter()
                    .flat_map(|(pose, shape)| {
                        let pose = convert::pose(pose);
                        collision_shape::convex_parts(shape)
                            .into_iter()
                            .map(move |(local, shape)| (pose * local, shape))
                    })
                    .collect(),
            ),
        };
        let collider = ColliderBuilder::new(shape)
            .density(0.0)
            .friction(self.friction)
            .collision_groups(InteractionGroups::all().with_memberships(groups::OBJECT));
        (body, engine.colliders.insert_with_parent(collider, body, &mut engine.bodies))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two halves of a cylinder have the inertia of the whole one.
    #[test]
    fn inertia_of_parts_adds_up() {
        let half =
            |z: f64| (Isometry3::translation(0.0, 0.0, z), ObjectShape::Cylinder { radius: 0.02, half_height: 0.05 });
        let halves = Prop { name: "two".into(), parts: vec![half(0.05), half(-0.05)], mass: 1.2, friction: 0.5 };
        let whole = Prop::new("one", ObjectShape::Cylinder { radius: 0.02, half_height: 0.1 }, 1.2, 0.5);
        let ((a, i), (b, j)) = (halves.inertia(), whole.inertia());
        assert!((a - b).norm() < 1e-12);
        assert!((i - j).norm() < 1e-12, "{i} {j}");
    }
}
