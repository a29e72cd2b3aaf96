//! Triangle meshes with normals: the drawn objects, and the simple solids that make up the robot.

use std::collections::HashMap;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use nalgebra::{Isometry3, Point3, Vector3};

/// A triangle mesh with one normal per vertex.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Vertex positions, m.
    pub vertices: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise when viewed from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals, one per vertex.
    pub normals: Vec<[f32; 3]>,
}

/// An object to be drawn, in its own frame.
#[derive(Debug, Clone, Default)]
pub struct DrawnObject {
    /// Name; also a part of the entity path.
    pub name: String,
    /// Vertex positions, m.
    pub vertices: Vec<[f32; 3]>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals, one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// Colour, RGB.
    pub color: [u8; 3],
}

impl DrawnObject {
    /// Creates an object from a plain mesh. Normals are computed: smooth where faces meet at less than 40 degrees,
    /// sharp elsewhere.
    pub fn from_mesh(
        name: impl Into<String>,
        vertices: &[Point3<f64>],
        triangles: &[[u32; 3]],
        color: [u8; 3],
    ) -> Self {
        let Mesh { vertices, triangles, normals } = Mesh::with_normals(vertices, triangles);
        Self { name: name.into(), vertices, triangles, normals, color }
    }

    pub fn mesh(&self) -> Mesh {
        Mesh { vertices: self.vertices.clone(), triangles: self.triangles.clone(), normals: self.normals.clone() }
    }
}

impl Mesh {
    /// Adds normals to a plain mesh; see [`DrawnObject::from_mesh`]. Vertices at the same position are merged for this;
    /// triangles with an invalid vertex index or without area are left out.
    pub fn with_normals(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        const CREASE_COSINE: f64 = 0.766;
        let place = |p: &Point3<f64>| p.coords.map(|x| (x * 1e6).round() as i64);
        let mut faces: Vec<([u32; 3], Vector3<f64>)> = Vec::with_capacity(triangles.len());
        let mut around: HashMap<Vector3<i64>, Vec<usize>> = HashMap::new();
        for triangle in triangles {
            let [Some(a), Some(b), Some(c)] = triangle.map(|i| vertices.get(i as usize)) else { continue };
            let area = (b - a).cross(&(c - a));
            if area.norm() > 1e-16 {
                for corner in [a, b, c] {
                    around.entry(place(corner)).or_default().push(faces.len());
                }
                faces.push((*triangle, area));
            }
        }
        let mut mesh = Self::default();
        let mut known: HashMap<(Vector3<i64>, [i32; 3]), u32> = HashMap::new();
        for (triangle, area) in &faces {
            let unit = area.normalize();
            let corners = triangle.map(|index| {
                let point = &vertices[index as usize];
                let sum: Vector3<f64> = around[&place(point)]
                    .iter()
                    .map(|f| faces[*f].1)
                    .filter(|n| n.normalize().dot(&unit) > CREASE_COSINE)
                    .sum();
                let normal = sum.normalize();
                let key = (place(point), [normal.x, normal.y, normal.z].map(|x| (x * 500.0).round() as i32));
                *known.entry(key).or_insert_with(|| mesh.push(point.coords.cast(), normal.cast()))
            });
            mesh.triangles.push(corners);
        }
        mesh
    }

    /// Returns a rounded box with half extents `half` and edge radius `radius` (both m), centred in its frame and moved
    /// to `pose`.
    pub fn rounded_box(half: &Vector3<f64>, radius: f64, pose: &Isometry3<f64>) -> Self {
        Self::smooth_box(half, radius, pose, 2)
    }

    /// As [`Mesh::rounded_box`], with `n` steps of the rounding from each face to an edge.
    pub fn smooth_box(half: &Vector3<f64>, radius: f64, pose: &Isometry3<f64>, n: u32) -> Self {
        let half: Vector3<f32> = half.cast();
        let radius = (radius as f32).min(half.min()).max(0.0);
        let inner = half.add_scalar(-radius);
        // Coordinates along one side: equal steps of the normal's angle from the edge to the flat part, symmetric at
        // the other end.
        let steps = |extent: f32| {
            let side = (0..=n).map(move |k| extent - radius + radius * (FRAC_PI_4 * k as f32 / n as f32).tan());
            side.clone().rev().map(|x| -x).chain(side).collect::<Vec<f32>>()
        };
        let points = 2 * (n + 1);
        let mut mesh = Self::default();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0f32, 1.0] {
                let first = mesh.vertices.len() as u32;
                for y in steps(half[v]) {
                    for x in steps(half[u]) {
                        let mut p = Vector3::zeros();
                        (p[axis], p[u], p[v]) = (side * half[axis], x, y);
                        let core = p.zip_map(&inner, |a, b| a.clamp(-b, b));
                        let normal = (p - core).try_normalize(1e-9).unwrap_or_else(|| {
                            let mut n = Vector3::zeros();
                            n[axis] = side;
                            n
                        });
                        mesh.push(core + normal * radius, normal);
                    }
                }
                mesh.grid(first, points, points, side < 0.0);
            }
        }
        mesh.moved(pose)
    }

    /// Returns a capsule from `a` to `b`.
    pub fn capsule(a: Point3<f64>, b: Point3<f64>, radius: f64) -> Self {
        Self::smooth_capsule([a, b], radius, (20, 5))
    }

    /// As [`Mesh::capsule`], with the given number of steps around its axis and of rings on each end.
    pub fn smooth_capsule([a, b]: [Point3<f64>; 2], radius: f64, (around, rings): (u32, u32)) -> Self {
        let (a, b, radius) = (a.coords.cast::<f32>(), b.coords.cast::<f32>(), radius as f32);
        let axis = (b - a).try_normalize(1e-6).unwrap_or_else(Vector3::z);
        let x = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
        let y = axis.cross(&x);
        let mut mesh = Self::default();
        for ring in 0..2 * rings {
            let (center, k) = if ring < rings { (a, ring as f32) } else { (b, (ring - 1) as f32) };
            let latitude = FRAC_PI_2 * (k / (rings - 1) as f32 - 1.0);
            for i in 0..=around {
                let (sin, cos) = (2.0 * PI * i as f32 / around as f32).sin_cos();
                let normal = (x * cos + y * sin) * latitude.cos() + axis * latitude.sin();
                mesh.push(center + normal * radius, normal);
            }
        }
        mesh.grid(0, around + 1, 2 * rings, false);
        mesh
    }

    /// Returns a surface over a grid: `at` gives position and unit normal for each pair of `columns` and `rows`.
    pub fn surface(columns: &[f64], rows: &[f64], at: impl Fn(f64, f64) -> (Vector3<f64>, Vector3<f64>)) -> Self {
        let mut mesh = Self::default();
        for y in rows {
            for x in columns {
                let (place, normal) = at(*x, *y);
                mesh.push(place.cast(), normal.cast());
            }
        }
        mesh.grid(0, columns.len() as u32, rows.len() as u32, false);
        mesh
    }

    /// Merges another mesh into this one.
    pub fn merged(mut self, other: Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.normals.extend(other.normals);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
        self
    }

    /// Moves each vertex outwards along its normal by `margin`, m.
    pub fn grown(mut self, margin: f32) -> Self {
        for (vertex, normal) in self.vertices.iter_mut().zip(&self.normals) {
            *vertex = std::array::from_fn(|axis| vertex[axis] + margin * normal[axis]);
        }
        self
    }

    fn moved(mut self, pose: &Isometry3<f64>) -> Self {
        let pose: Isometry3<f32> = pose.cast();
        for vertex in &mut self.vertices {
            *vertex = (pose * Point3::from(*vertex)).into();
        }
        for normal in &mut self.normals {
            *normal = (pose * Vector3::from(*normal)).into();
        }
        self
    }

    fn push(&mut self, vertex: Vector3<f32>, normal: Vector3<f32>) -> u32 {
        self.vertices.push(vertex.into());
        self.normals.push(normal.into());
        self.vertices.len() as u32 - 1
    }

    /// Adds the triangles of a grid of points, `columns` by `rows`, that starts at vertex `first`.
    fn grid(&mut self, first: u32, columns: u32, rows: u32, flip: bool) {
        for j in 0..rows - 1 {
            for i in 0..columns - 1 {
                let a = first + j * columns + i;
                let (b, c, d) = (a + 1, a + columns, a + columns + 1);
                let quad = if flip { [[a, c, b], [b, c, d]] } else { [[a, b, c], [b, d, c]] };
                self.triangles.extend(quad);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes the volume by the divergence theorem, for a closed mesh whose triangles all face outwards.
    fn volume(mesh: &Mesh) -> f64 {
        let v = |i: u32| Vector3::from(mesh.vertices[i as usize]).cast::<f64>();
        mesh.triangles.iter().map(|[a, b, c]| v(*a).dot(&v(*b).cross(&v(*c))) / 6.0).sum()
    }

    #[test]
    fn rounded_box_and_capsule_are_closed() {
        let pose = Isometry3::translation(0.1, -0.2, 0.3);
        let sharp = volume(&Mesh::rounded_box(&Vector3::new(0.1, 0.2, 0.3), 0.0, &pose));
        assert!((sharp - 0.048).abs() < 1e-6, "{sharp}");
        let round = volume(&Mesh::rounded_box(&Vector3::repeat(0.1), 0.1, &pose));
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
        assert!(round < ball && round > 0.85 * ball, "{round} {ball}");
        let capsule = volume(&Mesh::capsule(Point3::origin(), Point3::new(0.0, 0.3, 0.0), 0.1));
        let exact = ball + std::f64::consts::PI * 0.01 * 0.3;
        assert!(capsule < exact && capsule > 0.9 * exact, "{capsule} {exact}");
    }

    #[test]
    fn normals_are_sharp_at_a_cube_and_faulty_triangles_are_left_out() {
        let corner = |i: usize| Point3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
        let vertices: Vec<_> = (0..8).map(corner).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut triangles: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        triangles.extend([[0, 0, 1], [0, 1, 99]]);
        let mesh = Mesh::with_normals(&vertices, &triangles);
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (24, 12));
        assert!((volume(&mesh) - 1.0).abs() < 1e-6);
        assert!(mesh.normals.iter().all(|n| n.iter().map(|x| x.abs()).fold(0.0, f32::max) > 0.999));
    }
}
