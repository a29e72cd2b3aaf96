//! Shapes of objects: primitives in closed form, meshes through parry.

use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};

use super::mesh::{GeometryError, Mesh};
use super::primitive;
use super::tessellation::{self, Tessellation};

/// The shape of an object, in the object's frame, m.
#[derive(Debug, Clone)]
pub enum ObjectShape {
    /// A ball around the origin.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// A cylinder around the z axis, centred on the origin.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Half of the height, m.
        half_height: f64,
    },
    /// A box centred on the origin with rounded edges.
    Cuboid {
        /// Half extents including the rounding, m.
        half: Vector3<f64>,
        /// Rounding radius, m; 0 for sharp edges.
        radius: f64,
    },
    /// A watertight triangle mesh.
    Mesh(Arc<Mesh>),
}

impl ObjectShape {
    /// Returns the shape scaled by `factor` about the frame's origin.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        Ok(match self {
            Self::Sphere { radius } => Self::Sphere { radius: radius * factor },
            Self::Cylinder { radius, half_height } => {
                Self::Cylinder { radius: radius * factor, half_height: half_height * factor }
            }
            Self::Cuboid { half, radius } => Self::Cuboid { half: half * factor, radius: radius * factor },
            Self::Mesh(mesh) => Self::Mesh(Arc::new(mesh.scaled(factor)?)),
        })
    }

    /// Returns the distance from `point` to the surface, m, negative inside, and its gradient: the unit outward
    /// direction.
    pub fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        match self {
            Self::Sphere { radius } => primitive::sphere_distance(*radius, point),
            Self::Cylinder { radius, half_height } => primitive::cylinder_distance(*radius, *half_height, point),
            Self::Cuboid { half, radius } => primitive::cuboid_distance(half, *radius, point),
            Self::Mesh(mesh) => mesh.signed_distance(point),
        }
    }

    /// Returns the distance along the ray to the first point of the solid, m: 0 if the origin is inside already, none
    /// on a miss.
    pub fn ray(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<f64> {
        match self {
            Self::Sphere { radius } => primitive::sphere_ray(*radius, origin, direction),
            Self::Cylinder { radius, half_height } => primitive::cylinder_ray(*radius, *half_height, origin, direction),
            Self::Cuboid { half, radius } => primitive::cuboid_ray(half, *radius, origin, direction),
            Self::Mesh(mesh) => mesh.ray(origin, direction),
        }
    }

    /// Returns the radius of the smallest ball around the frame's origin that contains the shape, m.
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Self::Cuboid { half, radius } => half.add_scalar(-radius).norm() + radius,
            Self::Mesh(mesh) => mesh.vertices().iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max),
        }
    }

    /// Returns the lowest and highest corner of the axis-aligned bounding box, m.
    pub fn aabb(&self) -> (Point3<f64>, Point3<f64>) {
        let half = match self {
            Self::Sphere { radius } => Vector3::repeat(*radius),
            Self::Cylinder { radius, half_height } => Vector3::new(*radius, *radius, *half_height),
            Self::Cuboid { half, .. } => *half,
            Self::Mesh(mesh) => return mesh.aabb(),
        };
        (Point3::from(-half), Point3::from(half))
    }

    /// Returns the volume, m3.
    pub fn volume(&self) -> f64 {
        match self {
            Self::Sphere { radius } => 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
            Self::Cylinder { radius, half_height } => std::f64::consts::TAU * radius * radius * half_height,
            Self::Cuboid { half, radius } => primitive::cuboid_volume(half, *radius),
            Self::Mesh(mesh) => mesh.volume(),
        }
    }

    /// Returns the centre of mass (m) and the inertia about it (kg m2, the frame's axes) of a uniform body of `mass`
    /// kg.
    pub fn inertia(&self, mass: f64) -> (Point3<f64>, Matrix3<f64>) {
        let diagonal = match self {
            Self::Sphere { radius } => Vector3::repeat(0.4 * radius * radius),
            Self::Cylinder { radius, half_height } => {
                let across = (3.0 * radius * radius + 4.0 * half_height * half_height) / 12.0;
                Vector3::new(across, across, 0.5 * radius * radius)
            }
            Self::Cuboid { half, radius } => primitive::cuboid_unit_inertia(half, *radius),
            Self::Mesh(mesh) => return (mesh.center_of_mass(), mesh.unit_inertia() * mass),
        };
        (Point3::origin(), Matrix3::from_diagonal(&diagonal) * mass)
    }

    /// Returns the point of the shape farthest along `direction` (any length but 0), m.
    pub fn support(&self, direction: &Vector3<f64>) -> Point3<f64> {
        match self {
            Self::Sphere { radius } => Point3::from(direction.normalize() * *radius),
            Self::Cylinder { radius, half_height } => {
                let across =
                    Vector3::new(direction.x, direction.y, 0.0).try_normalize(1e-12).unwrap_or_default() * *radius;
                Point3::from(across + Vector3::z() * half_height.copysign(direction.z))
            }
            Self::Cuboid { half, radius } => {
                let corner = half.add_scalar(-radius).zip_map(direction, f64::copysign);
                Point3::from(corner + direction.normalize() * *radius)
            }
            Self::Mesh(mesh) => mesh.support(direction),
        }
    }

    /// Returns the height of the lowest point relative to the frame's origin (negative, m) when the shape is rotated by
    /// `rotation`. On the table z = 0, the origin is at minus this height.
    pub fn lowest_height(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let down = rotation.inverse_transform_vector(&-Vector3::z());
        -self.support(&down).coords.dot(&down)
    }

    /// Returns a tessellation for display: points (m), triangles (counter-clockwise from outside), one unit normal per
    /// point.
    pub fn triangles(&self) -> Tessellation {
        match self {
            Self::Sphere { radius } => tessellation::sphere(*radius),
            Self::Cylinder { radius, half_height } => tessellation::cylinder(*radius, *half_height),
            Self::Cuboid { half, radius } => tessellation::cuboid(half, *radius),
            Self::Mesh(mesh) => tessellation::mesh(mesh),
        }
    }

    /// Returns `n` points evenly distributed over the surface, the same at every call, m.
    pub fn surface_samples(&self, n: usize) -> Vec<Point3<f64>> {
        let (points, triangles, _) = self.triangles();
        let mut samples = tessellation::sample(&points, &triangles, n);
        if !matches!(self, Self::Mesh(_)) {
            for sample in &mut samples {
                let (distance, outward) = self.signed_distance(sample);
                *sample -= outward * distance;
            }
        }
        samples
    }

    /// Returns convex point sets that together fill the shape, for dynamics. Primitives return the points of their
    /// tessellation; physics engines have better primitives.
    pub fn convex_parts(&self) -> Vec<Vec<Point3<f64>>> {
        match self {
            Self::Mesh(mesh) => mesh.convex_parts().to_vec(),
            _ => vec![self.triangles().0],
        }
    }
}
