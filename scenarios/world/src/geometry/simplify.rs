//! Simplification of a closed surface: edges are collapsed in the order of their quadric error (Garland & Heckbert
//! 1997).
//!
//! The surface stays closed and keeps its topology. An edge is collapsed only if its two ends share exactly two
//! neighbours, and if no triangle is flipped by it.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, Point3, Vector3};

/// Least cosine of the rotation of a triangle's normal in one collapse.
const MIN_NORMAL_COSINE: f64 = 0.2;
/// Least value of twice the area of a triangle, m2.
const MIN_DOUBLE_AREA: f64 = 1e-14;
/// Determinant, relative to the cube of the trace, above which the best position of a vertex is well determined.
const MIN_DETERMINANT: f64 = 1e-4;

/// Sum of squared distances to planes, weighted by their triangles' areas: x'Ax + 2 b'x + c.
#[derive(Debug, Clone, Copy, Default)]
struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    fn of_plane(normal: &Vector3<f64>, at: &Point3<f64>, weight: f64) -> Self {
        let offset = -normal.dot(&at.coords);
        Self { a: normal * normal.transpose() * weight, b: normal * (offset * weight), c: offset * offset * weight }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }

    fn error_at(&self, point: &Point3<f64>) -> f64 {
        let x = point.coords;
        (x.dot(&(self.a * x)) + 2.0 * self.b.dot(&x) + self.c).max(0.0)
    }
}

/// An edge that may be collapsed. In the order of candidates, the cheapest is the greatest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    cost: f64,
    ends: (u32, u32),
    /// Versions of the two ends when the cost was computed.
    versions: (u32, u32),
    place: Point3<f64>,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.ends.cmp(&self.ends)).then(other.versions.cmp(&self.versions))
    }
}

struct Surface {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<Option<[u32; 3]>>,
    /// Triangles around each vertex.
    around: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    versions: Vec<u32>,
    left: usize,
}

fn double_area([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

impl Surface {
    fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut around = vec![Vec::new(); vertices.len()];
        let mut quadrics = vec![Quadric::default(); vertices.len()];
        for (number, triangle) in triangles.iter().enumerate() {
            let corners = triangle.map(|index| vertices[index as usize]);
            let double = double_area(corners);
            let weight = double.norm();
            let plane = Quadric::of_plane(&(double / weight), &corners[0], weight);
            for index in triangle {
                around[*index as usize].push(number as u32);
                quadrics[*index as usize] = quadrics[*index as usize].plus(&plane);
            }
        }
        Self {
            vertices: vertices.to_vec(),
            triangles: triangles.iter().copied().map(Some).collect(),
            around,
            quadrics,
            versions: vec![0; vertices.len()],
            left: triangles.len(),
        }
    }

    fn candidate(&self, from: u32, to: u32) -> Candidate {
        let (low, high) = (from.min(to), from.max(to));
        let quadric = self.quadrics[low as usize].plus(&self.quadrics[high as usize]);
        let (a, b) = (self.vertices[low as usize], self.vertices[high as usize]);
        let determined = quadric.a.determinant() > MIN_DETERMINANT * quadric.a.trace().powi(3);
        let best =
            determined.then(|| quadric.a.try_inverse()).flatten().map(|inverse| Point3::from(-(inverse * quadric.b)));
        // A position far from the edge results from nearly parallel planes.
        let near = best.filter(|place| (place - nalgebra::center(&a, &b)).norm() < 2.0 * (b - a).norm());
        let choices = [near, Some(nalgebra::center(&a, &b)), Some(a), Some(b)];
        let costs = choices.into_iter().flatten().map(|place| (quadric.error_at(&place), place));
        let (cost, place) = costs.min_by(|x, y| x.0.total_cmp(&y.0)).unwrap_or((f64::INFINITY, a));
        let versions = (self.versions[low as usize], self.versions[high as usize]);
        Candidate { cost, ends: (low, high), versions, place }
    }

    /// Returns the neighbours of a vertex, sorted.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let corners =
            self.around[vertex as usize].iter().filter_map(|number| self.triangles[*number as usize]).flatten();
        let mut neighbours: Vec<u32> = corners.filter(|index| *index != vertex).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        neighbours
    }

    fn may_collapse(&self, candidate: &Candidate) -> bool {
        let (low, high) = candidate.ends;
        let others = self.neighbours(high);
        let shared = self.neighbours(low).into_iter().filter(|vertex| others.binary_search(vertex).is_ok()).count();
        let keeps = |vertex: u32, other: u32| {
            self.around[vertex as usize].iter().filter_map(|number| self.triangles[*number as usize]).all(|triangle| {
                if triangle.contains(&other) {
                    return true;
                }
                let before = double_area(triangle.map(|index| self.vertices[index as usize]));
                let moved = |index: u32| if index == vertex { candidate.place } else { self.vertices[index as usize] };
                let after = double_area(triangle.map(moved));
                after.norm() > MIN_DOUBLE_AREA && after.dot(&before) > MIN_NORMAL_COSINE * after.norm() * before.norm()
            })
        };
        shared == 2 && keeps(low, high) && keeps(high, low)
    }

    fn collapse(&mut self, candidate: &Candidate) {
        let (low, high) = candidate.ends;
        self.vertices[low as usize] = candidate.place;
        self.quadrics[low as usize] = self.quadrics[low as usize].plus(&self.quadrics[high as usize]);
        for number in std::mem::take(&mut self.around[high as usize]) {
            let Some(triangle) = &mut self.triangles[number as usize] else { continue };
            if triangle.contains(&low) {
                self.triangles[number as usize] = None;
                self.left -= 1;
                continue;
            }
            triangle.iter_mut().filter(|index| **index == high).for_each(|index| *index = low);
            self.around[low as usize].push(number);
        }
        let triangles = &self.triangles;
        self.around[low as usize].retain(|number| triangles[*number as usize].is_some());
        self.versions[low as usize] += 1;
        self.versions[high as usize] += 1;
    }
}

/// Returns a closed surface of about `target` triangles, or of as few as its topology allows.
pub fn simplify(vertices: &[Point3<f64>], triangles: &[[u32; 3]], target: usize) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let mut surface = Surface::new(vertices, triangles);
    let mut queue: BinaryHeap<Candidate> = triangles
        .iter()
        .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
        .filter(|(from, to)| from < to)
        .map(|(from, to)| surface.candidate(from, to))
        .collect();
    while surface.left > target
        && let Some(candidate) = queue.pop()
    {
        let (low, high) = candidate.ends;
        let current = (surface.versions[low as usize], surface.versions[high as usize]) == candidate.versions;
        if !current || !surface.may_collapse(&candidate) {
            continue;
        }
        surface.collapse(&candidate);
        for neighbour in surface.neighbours(low) {
            queue.push(surface.candidate(low, neighbour));
        }
    }
    let mut number = vec![u32::MAX; surface.vertices.len()];
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for triangle in surface.triangles.iter().flatten() {
        faces.push(triangle.map(|index| {
            let place = &mut number[index as usize];
            if *place == u32::MAX {
                *place = points.len() as u32;
                points.push(surface.vertices[index as usize]);
            }
            *place
        }));
    }
    (points, faces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Mesh;
    use crate::geometry::repair::tests::ball;

    /// A ball of a hundred thousand triangles keeps its surface and volume with a tenth of them.
    #[test]
    fn a_ball_of_fewer_triangles_is_the_same_ball() {
        let radius = 0.03;
        let (vertices, triangles) = ball(160, |_| radius);
        let before = Mesh::new(vertices, triangles).expect("a ball");
        let (points, faces) = simplify(before.vertices(), before.triangles(), 10_000);
        let after = Mesh::new(points, faces).expect("still closed");
        assert!(before.triangles().len() > 100_000 && after.triangles().len() <= 10_000);
        assert!((after.volume() / before.volume() - 1.0).abs() < 3e-3, "{} {}", after.volume(), before.volume());
        let off = after.vertices().iter().map(|at| (at.coords.norm() - radius).abs()).fold(0.0, f64::max);
        assert!(off < 4e-5, "{off}");
    }
}
