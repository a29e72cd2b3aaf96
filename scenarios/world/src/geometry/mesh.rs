//! Watertight triangle meshes.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::OnceLock;

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::{PointQueryWithLocation, Ray, RayCast};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use platform::data::DataError;

/// Vertices (in the file's unit) and triangles.
pub type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// How far a part may stand out of the mesh if nothing else is said, m: less than a fingertip's pad gives.
pub(super) const TOLERANCE: f64 = 1e-3;

/// The largest extent a mesh may have, m: a larger one is probably in millimetres.
pub const MAX_EXTENT: f64 = 1.0;

/// What a closed surface encloses at least, m3: less has neither a centre nor an inertia.
const LEAST_VOLUME: f64 = 1e-15;

/// What can be wrong with a mesh or its file.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// The file could not be read, or a line of it is not what it should be.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The file is well-formed, its mesh is not.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with the mesh.
        source: Box<GeometryError>,
    },
    /// A triangle or vertex is unusable.
    #[error("{element}: found {found}, expected {expected}")]
    Element {
        /// Such as `triangle 12`.
        element: String,
        /// What is there.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// The surface has a hole or triangles of opposite sense.
    #[error(
        "mesh is not watertight: edge {from}-{to} found {forward} times one way and {backward} times the other, expected once each \
         ({faults} such edges)"
    )]
    Open {
        /// Vertex index.
        from: u32,
        /// Vertex index.
        to: u32,
        /// Triangles that run from `from` to `to`.
        forward: usize,
        /// Triangles that run from `to` to `from`.
        backward: usize,
        /// Edges at fault.
        faults: usize,
    },
    /// A fault that no repair could mend without inventing something.
    #[error("{fault}; it cannot be mended: {reason}")]
    Unmended {
        /// What is wrong with the mesh.
        fault: String,
        /// What a repair came to.
        reason: String,
    },
    /// The mesh is implausibly large.
    #[error(
        "mesh extent: found {found:.3} m, expected at most {MAX_EXTENT} m: the file is probably in millimetres, scale it by 0.001"
    )]
    Units {
        /// m.
        found: f64,
    },
}

/// A watertight, outward-oriented triangle mesh, m. Made by [`Mesh::new`], [`Mesh::read`] or the builders.
#[derive(Clone)]
pub struct Mesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    surface: TriMesh,
    volume: f64,
    center: Point3<f64>,
    unit_inertia: Matrix3<f64>,
    /// Convex point sets that its builder knows to fill it.
    pub(super) given: Option<Vec<Vec<Point3<f64>>>>,
    /// Those that were worked out, where none were given.
    pub(super) found: OnceLock<Vec<Vec<Point3<f64>>>>,
    /// How far convex parts may stand out, m.
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
    /// Checks that the triangles close a surface and turns them outwards if they all face inwards.
    pub fn new(vertices: Vec<Point3<f64>>, mut triangles: Vec<[u32; 3]>) -> Result<Self, GeometryError> {
        check_elements(&vertices, &triangles)?;
        check_closed(&triangles)?;
        let (mut volume, center, second) = moments(&vertices, &triangles);
        if volume < 0.0 {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            volume = -volume;
        }
        if volume < LEAST_VOLUME {
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
            given: None,
            found: OnceLock::new(),
            tolerance: TOLERANCE,
        })
    }

    /// The same with convex point sets known to fill it, in the same frame.
    pub fn with_parts(self, parts: Vec<Vec<Point3<f64>>>) -> Self {
        Self { given: Some(parts), ..self }
    }

    /// The same with convex parts that stand out of it by at most `tolerance`, m, where it has to be decomposed.
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// The same mesh in a frame at its centre of volume.
    pub fn centered(self) -> Result<Self, GeometryError> {
        let shift = self.center.coords;
        let moved = Self::new(self.vertices.iter().map(|vertex| vertex - shift).collect(), self.triangles)?
            .with_tolerance(self.tolerance);
        Ok(match self.given {
            Some(parts) => moved.with_parts(
                parts.into_iter().map(|part| part.into_iter().map(|point| point - shift).collect()).collect(),
            ),
            None => moved,
        })
    }

    /// The same mesh `factor` times as large, its convex parts those of this one: cut anew, it would come apart a little differently.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        let larger = |points: &[Point3<f64>]| points.iter().map(|point| point * factor).collect::<Vec<_>>();
        let mesh = Self::new(larger(&self.vertices), self.triangles.clone())?.with_tolerance(self.tolerance);
        Ok(mesh.with_parts(self.convex_parts().iter().map(|part| larger(part)).collect()))
    }

    /// m.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Vertex indices, counter-clockwise from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// m3.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Centre of volume, m.
    pub fn center_of_mass(&self) -> Point3<f64> {
        self.center
    }

    /// Inertia of a uniform body of 1 kg about its centre of mass, m2.
    pub fn unit_inertia(&self) -> Matrix3<f64> {
        self.unit_inertia
    }

    /// Lowest and highest corner, m.
    pub fn aabb(&self) -> (Point3<f64>, Point3<f64>) {
        extent(&self.vertices)
    }

    /// See [`super::Shape::signed_distance`].
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

    /// See [`super::Shape::ray`].
    pub fn ray(&self, origin: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Option<f64> {
        let ray = Ray::new(to_parry(origin), Vector::new(direction.x, direction.y, direction.z));
        let hit = self.surface.cast_local_ray_and_get_normal(&ray, f64::MAX, false)?;
        let normal = vector(self.surface.triangle(hit.subshape).scaled_normal());
        // A first hit from behind means that the origin is inside.
        Some(if normal.dot(direction) > 0.0 { 0.0 } else { hit.time_of_impact })
    }

    /// See [`super::Shape::support`].
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

    /// Whether no vertex stands out of any triangle's plane by more than 1e-6 of the mesh's size.
    pub fn is_convex(&self) -> bool {
        let (low, high) = self.aabb();
        let tolerance = 1e-6 * (high - low).norm();
        self.triangles.iter().all(|triangle| {
            let [a, b, c] = triangle.map(|index| self.vertices[index as usize]);
            let normal = (b - a).cross(&(c - a)).normalize();
            self.support(&normal).coords.dot(&normal) - a.coords.dot(&normal) <= tolerance
        })
    }

    /// Vertices and triangles as the decomposition takes them.
    pub(super) fn surface(&self) -> (&[Vector], &[[u32; 3]]) {
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
    if found > MAX_EXTENT { Err(GeometryError::Units { found }) } else { Ok(()) }
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
        Some(((from, to), [forward, backward])) => Err(GeometryError::Open { from, to, forward, backward, faults }),
        None => Ok(()),
    }
}

/// Signed volume, centre, and the mean of (x - centre)(x - centre)' over the solid, from tetrahedra at the first vertex.
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
