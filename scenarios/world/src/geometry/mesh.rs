//! Watertight triangle meshes.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::OnceLock;

use ftac_platform::data::DataError;
use nalgebra::{Matrix3, Point3, Unit, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQueryWithLocation, Ray, RayCast};
use parry3d_f64::shape::{SharedShape, TriMesh, TriMeshFlags};

/// Vertices (in the file's unit) and triangles (vertex indices).
pub type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Default tolerance of convex parts: greatest distance by which a part may stand out of the mesh, m. It is less than a
/// fingertip's pad yields.
pub(super) const DEFAULT_PART_TOLERANCE: f64 = 1e-3;

/// Greatest allowed extent of a mesh, m: a larger one is probably in millimetres.
pub const MAX_EXTENT: f64 = 1.0;

/// Least volume of a closed surface, m3: below it, centre and inertia are undefined.
const MIN_VOLUME: f64 = 1e-15;

/// Faults of a mesh or its file.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// The file could not be read, or one of its lines is invalid.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The file is well-formed, but its mesh is not.
    #[error("{path}: {source}")]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Fault of the mesh.
        source: Box<GeometryError>,
    },
    /// A triangle or vertex is unusable.
    #[error("{element}: found {found}, expected {expected}")]
    Element {
        /// The element, such as `triangle 12`.
        element: String,
        /// The value found.
        found: String,
        /// The value expected.
        expected: String,
    },
    /// The surface has a hole, or neighbouring triangles of opposite orientation.
    #[error(
        "mesh is not watertight: edge {from}-{to} found {forward} times one way and {backward} times the other, expected once each \
         ({faults} such edges)"
    )]
    NotWatertight {
        /// Index of the edge's first vertex.
        from: u32,
        /// Index of the edge's second vertex.
        to: u32,
        /// Number of triangles that run from `from` to `to`.
        forward: usize,
        /// Number of triangles that run from `to` to `from`.
        backward: usize,
        /// Number of faulty edges.
        faults: usize,
    },
    /// A fault that no repair could mend without inventing geometry.
    #[error("{fault}; it cannot be mended: {reason}")]
    NotRepaired {
        /// Fault of the mesh.
        fault: String,
        /// Reason why the repair failed.
        reason: String,
    },
    /// The mesh is implausibly large.
    #[error(
        "mesh extent: found {found:.3} m, expected at most {MAX_EXTENT} m: the file is probably in millimetres; scale it by 0.001"
    )]
    ImplausibleSize {
        /// Extent found, m.
        found: f64,
    },
}

/// A watertight, outward-oriented triangle mesh, m. Create it with [`Mesh::new`], [`Mesh::read`] or the builders.
#[derive(Clone)]
pub struct Mesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    surface: TriMesh,
    volume: f64,
    center: Point3<f64>,
    unit_inertia: Matrix3<f64>,
    /// Convex point sets that fill the mesh, known to its builder.
    pub(super) known_parts: Option<Vec<Vec<Point3<f64>>>>,
    /// Convex parts from a decomposition, if none were given.
    pub(super) computed_parts: OnceLock<Vec<Vec<Point3<f64>>>>,
    /// Hulls of the convex parts.
    pub(super) standing_hulls: OnceLock<Vec<SharedShape>>,
    /// Greatest distance by which convex parts may stand out of the mesh, m.
    pub(super) tolerance: f64,
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            formatter,
            "Mesh({} vertices, {} triangles, {:.3e} m3)",
            self.vertices.len(),
            self.triangles.len(),
            self.volume
        )
    }
}

pub fn to_parry(point: &Point3<f64>) -> Vector {
    Vector::new(point.x, point.y, point.z)
}

pub fn from_parry(point: Vector) -> Point3<f64> {
    Point3::new(point.x, point.y, point.z)
}

fn vector(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

impl Mesh {
    /// Checks that the triangles form a closed surface, and flips all of them if they face inwards.
    pub fn new(vertices: Vec<Point3<f64>>, mut triangles: Vec<[u32; 3]>) -> Result<Self, GeometryError> {
        check_elements(&vertices, &triangles)?;
        check_closed(&triangles)?;
        let (mut volume, center, second) = moments(&vertices, &triangles);
        if volume < 0.0 {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            volume = -volume;
        }
        if volume < MIN_VOLUME {
            return Err(GeometryError::Element {
                element: "mesh".into(),
                found: format!("{volume:.1e} m3 within its surface"),
                expected: "a solid".into(),
            });
        }
        let points: Vec<Vector> = vertices.iter().map(to_parry).collect();
        let surface = TriMesh::with_flags(points, triangles.clone(), TriMeshFlags::ORIENTED).map_err(|error| {
            GeometryError::Element {
                element: "mesh".into(),
                found: error.to_string(),
                expected: "a triangle surface".into(),
            }
        })?;
        Ok(Self {
            vertices,
            triangles,
            surface,
            volume,
            center,
            unit_inertia: Matrix3::identity() * second.trace() - second,
            known_parts: None,
            computed_parts: OnceLock::new(),
            standing_hulls: OnceLock::new(),
            tolerance: DEFAULT_PART_TOLERANCE,
        })
    }

    /// Returns the mesh with `parts`, convex point sets known to fill it, in the same frame.
    pub fn with_parts(self, parts: Vec<Vec<Point3<f64>>>) -> Self {
        Self { known_parts: Some(parts), standing_hulls: OnceLock::new(), ..self }
    }

    /// Returns the mesh with a tolerance for its decomposition: convex parts may stand out of it by at most
    /// `tolerance`, m.
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Returns the mesh in a frame at its centre of volume.
    pub fn centered(self) -> Result<Self, GeometryError> {
        let shift = self.center.coords;
        let moved = Self::new(self.vertices.iter().map(|vertex| vertex - shift).collect(), self.triangles)?
            .with_tolerance(self.tolerance);
        Ok(match self.known_parts {
            Some(parts) => moved.with_parts(
                parts.into_iter().map(|part| part.into_iter().map(|point| point - shift).collect()).collect(),
            ),
            None => moved,
        })
    }

    /// Returns the mesh scaled by `factor`, with its convex parts scaled as well: a new decomposition would give
    /// slightly different parts.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        let larger = |points: &[Point3<f64>]| points.iter().map(|point| point * factor).collect::<Vec<_>>();
        let mesh = Self::new(larger(&self.vertices), self.triangles.clone())?.with_tolerance(self.tolerance);
        Ok(mesh.with_parts(self.convex_parts().iter().map(|part| larger(part)).collect()))
    }

    /// Returns the vertices, m.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Returns the triangles as vertex indices, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Returns the volume, m3.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Returns the centre of volume, m.
    pub fn center_of_mass(&self) -> Point3<f64> {
        self.center
    }

    /// Returns the inertia of a uniform body of 1 kg about its centre of mass, m2.
    pub fn unit_inertia(&self) -> Matrix3<f64> {
        self.unit_inertia
    }

    /// Returns the axis-aligned bounding box: lowest and highest corner, m.
    pub fn aabb(&self) -> (Point3<f64>, Point3<f64>) {
        extent(&self.vertices)
    }

    /// Implements [`super::ObjectShape::signed_distance`].
    pub fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let (projection, (triangle, _)) = self.surface.project_local_point_and_get_location(to_parry(point), false);
        let away = point.coords - vector(projection.point);
        let distance = away.norm();
        let face = || vector(self.surface.triangle(triangle).scaled_normal()).normalize();
        match (distance > 1e-9, projection.is_inside) {
            (true, false) => (distance, away / distance),
            (true, true) => (-distance, away / -distance),
            (false, false) => (distance, face()),
            (false, true) => (-distance, face()),
        }
    }

    /// Implements [`super::ObjectShape::ray`].
    pub fn ray(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<f64> {
        let ray = Ray::new(to_parry(origin), Vector::new(direction.x, direction.y, direction.z));
        let hit = self.surface.cast_local_ray_and_get_normal(&ray, f64::MAX, false)?;
        let normal = vector(self.surface.triangle(hit.subshape).scaled_normal());
        // If the first hit is from behind, the origin is inside.
        Some(if normal.dot(direction) > 0.0 { 0.0 } else { hit.time_of_impact })
    }

    /// Implements [`super::ObjectShape::support`].
    pub fn support(&self, direction: &Vector3<f64>) -> Point3<f64> {
        let mut best = (f64::NEG_INFINITY, Point3::origin());
        for vertex in &self.vertices {
            let along = vertex.coords.dot(direction);
            if along > best.0 {
                best = (along, *vertex);
            }
        }
        best.1
    }

    /// True if no vertex stands out of any triangle's plane by more than 1e-6 of the mesh's size.
    pub fn is_convex(&self) -> bool {
        let (low, high) = self.aabb();
        let tolerance = 1e-6 * (high - low).norm();
        self.triangles.iter().all(|triangle| {
            let [a, b, c] = triangle.map(|index| self.vertices[index as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            self.support(&normal).coords.dot(&normal) - a.coords.dot(&normal) <= tolerance
        })
    }

    /// Returns vertices and triangles in the format of the decomposition.
    pub(super) fn decomposition_input(&self) -> (&[Vector], &[[u32; 3]]) {
        (self.surface.vertices(), self.surface.indices())
    }
}

fn extent(vertices: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let start = (Point3::from(Vector3::repeat(f64::INFINITY)), Point3::from(Vector3::repeat(f64::NEG_INFINITY)));
    vertices.iter().fold(start, |(low, high), vertex| (low.inf(vertex), high.sup(vertex)))
}

fn check_elements(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
    let fault =
        |element: String, found: String, expected: String| Err(GeometryError::Element { element, found, expected });
    if let Some(n) = vertices.iter().position(|vertex| !vertex.iter().all(|x| x.is_finite())) {
        return fault(
            format!("vertex {n}"),
            format!("{:?}", vertices[n].coords.as_slice()),
            "finite coordinates".into(),
        );
    }
    if triangles.len() < 4 {
        return fault(
            "mesh".into(),
            format!("{} triangles", triangles.len()),
            "at least 4 that close a surface".into(),
        );
    }
    for (n, triangle) in triangles.iter().enumerate() {
        if let Some(index) = triangle.iter().find(|&&index| index as usize >= vertices.len()) {
            return fault(
                format!("triangle {n}"),
                format!("vertex index {index}"),
                format!("one below {}", vertices.len()),
            );
        }
        if triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0] {
            return fault(format!("triangle {n}"), format!("{triangle:?}"), "three different vertices".into());
        }
        let [a, b, c] = triangle.map(|index| vertices[index as usize]);
        if (b - a).cross(&(c - a)).norm() < 1e-16 {
            return fault(format!("triangle {n}"), "an area of 0".into(), "three corners that are not in line".into());
        }
    }
    let (low, high) = extent(vertices);
    let found = (high - low).max();
    if found > MAX_EXTENT { Err(GeometryError::ImplausibleSize { found }) } else { Ok(()) }
}

fn check_closed(triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
    let mut edges: HashMap<(u32, u32), [usize; 2]> = HashMap::new();
    for triangle in triangles {
        for corner in 0..3 {
            let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
            edges.entry((from.min(to), from.max(to))).or_default()[usize::from(from > to)] += 1;
        }
    }
    let faults = edges.values().filter(|uses| **uses != [1, 1]).count();
    match edges.into_iter().filter(|(_, uses)| *uses != [1, 1]).min() {
        Some(((from, to), [forward, backward])) => {
            Err(GeometryError::NotWatertight { from, to, forward, backward, faults })
        }
        None => Ok(()),
    }
}

/// Computes the signed volume, the centre, and the mean of (x - centre)(x - centre)' over the solid, from tetrahedra at
/// the first vertex.
fn moments(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> (f64, Point3<f64>, Matrix3<f64>) {
    let base = vertices[0];
    let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for triangle in triangles {
        let [a, b, c] = triangle.map(|index| vertices[index as usize] - base);
        let part = a.dot(&b.cross(&c)) / 6.0;
        let sum = a + b + c;
        volume += part;
        first += sum * (part / 4.0);
        second += (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose()) * (part / 20.0);
    }
    let mean = first / volume;
    (volume, base + mean, second / volume - mean * mean.transpose())
}
