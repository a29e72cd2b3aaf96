//! Triangle soup on shared vertices, and its first clean-up: coincident vertices, triangles without an area, duplicate
//! triangles, flaps.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Point3, Vector3};

use super::report::RepairReport;

/// Threshold of twice the area below which a triangle counts as having none, m2; as in [`crate::geometry::Mesh::new`].
pub const MIN_DOUBLE_AREA: f64 = 1e-16;

/// Vertices (m) and triangles that need not form a closed surface.
#[derive(Debug, Clone, Default)]
pub struct TriangleSoup {
    pub vertices: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle's use of an edge. The edge is named by its lower vertex first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct HalfEdge {
    pub edge: (u32, u32),
    pub triangle: u32,
    /// True if the triangle runs from the lower vertex to the higher one.
    pub forward: bool,
}

impl TriangleSoup {
    /// Returns twice the area vector of a triangle, m2.
    pub fn double_area(&self, triangle: &[u32; 3]) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// Returns the corners of a triangle, m.
    pub fn corners(&self, triangle: &[u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|index| self.vertices[index as usize])
    }

    /// Returns the total area, m2.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|triangle| 0.5 * self.double_area(triangle).norm()).sum()
    }

    /// Returns the longest side of the bounding box, m.
    pub fn extent(&self) -> f64 {
        let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let used = self.triangles.iter().flatten().map(|index| self.vertices[*index as usize].coords);
        let (low, high) = used.fold(start, |(low, high), at| (low.inf(&at), high.sup(&at)));
        (high - low).max().max(0.0)
    }

    /// Returns all sides, sorted by edge.
    pub fn half_edges(&self) -> Vec<HalfEdge> {
        let mut sides = Vec::with_capacity(3 * self.triangles.len());
        for (number, triangle) in self.triangles.iter().enumerate() {
            for corner in 0..3 {
                let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
                sides.push(HalfEdge {
                    edge: (from.min(to), from.max(to)),
                    triangle: number as u32,
                    forward: from < to,
                });
            }
        }
        sides.sort_unstable();
        sides
    }

    /// Merges vertices in the same place, and drops triangles that have no area then.
    pub fn weld(&mut self, repair: &mut RepairReport) {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let target: Vec<u32> = (self.vertices.iter().enumerate())
            .map(|(number, vertex)| {
                // Adding zero makes -0 and 0 the same place.
                let place = [vertex.x, vertex.y, vertex.z].map(|part| (part + 0.0).to_bits());
                *known.entry(place).or_insert(number as u32)
            })
            .collect();
        self.renumber(&target, repair);
    }

    /// Renumbers every vertex as in `target`.
    pub fn renumber(&mut self, target: &[u32], repair: &mut RepairReport) {
        let mut moved = vec![false; self.vertices.len()];
        for index in self.triangles.iter_mut().flatten() {
            let to = target[*index as usize];
            moved[*index as usize] |= to != *index;
            *index = to;
        }
        repair.welded += moved.into_iter().filter(|moved| *moved).count();
        self.drop_degenerate(repair);
    }

    /// Drops triangles without an area.
    pub fn drop_degenerate(&mut self, repair: &mut RepairReport) {
        let before = self.triangles.len();
        let triangles = std::mem::take(&mut self.triangles);
        self.triangles = triangles
            .into_iter()
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .filter(|triangle| self.double_area(triangle).norm() >= MIN_DOUBLE_AREA)
            .collect();
        repair.degenerate += before - self.triangles.len();
    }

    /// Of triangles on the same three vertices, keeps one if it closes something, and none if its edges are closed
    /// without it.
    pub fn drop_duplicates(&mut self, repair: &mut RepairReport) {
        let mut alike: BTreeMap<[u32; 3], Vec<u32>> = BTreeMap::new();
        for (number, triangle) in self.triangles.iter().enumerate() {
            let mut sorted = *triangle;
            sorted.sort_unstable();
            alike.entry(sorted).or_default().push(number as u32);
        }
        alike.retain(|_, numbers| numbers.len() > 1);
        if alike.is_empty() {
            return;
        }
        let sides = self.half_edges();
        let mut gone = vec![false; self.triangles.len()];
        for (corners, numbers) in &alike {
            let others = |edge: (u32, u32)| {
                let start = sides.partition_point(|side| side.edge < edge);
                sides[start..]
                    .iter()
                    .take_while(|side| side.edge == edge)
                    .filter(|side| !numbers.contains(&side.triangle))
                    .count()
            };
            let [a, b, c] = *corners;
            let open = [(a, b), (b, c), (a, c)].into_iter().filter(|edge| others(*edge) == 1).count();
            let kept = usize::from(open >= 2);
            numbers.iter().skip(kept).for_each(|number| gone[*number as usize] = true);
        }
        repair.duplicates += self.retain(|number| !gone[number]);
    }

    /// Drops flaps: triangles on an edge that two others already close.
    pub fn drop_flaps(&mut self, repair: &mut RepairReport) {
        loop {
            let sides = self.half_edges();
            let mut edges = vec![(false, false); self.triangles.len()];
            for uses in sides.chunk_by(|a, b| a.edge == b.edge) {
                for side in uses {
                    edges[side.triangle as usize].0 |= uses.len() == 1;
                    edges[side.triangle as usize].1 |= uses.len() > 2;
                }
            }
            let dropped = self.retain(|number| edges[number] != (true, true));
            repair.duplicates += dropped;
            if dropped == 0 {
                return;
            }
        }
    }

    /// Keeps the triangles whose index satisfies `wanted`. Returns the number dropped.
    pub fn retain(&mut self, wanted: impl Fn(usize) -> bool) -> usize {
        let before = self.triangles.len();
        let mut number = 0;
        self.triangles.retain(|_| {
            number += 1;
            wanted(number - 1)
        });
        before - self.triangles.len()
    }

    /// Returns for each triangle the number of its connected component, in order of first appearance, and the number of
    /// components.
    pub fn components(&self) -> (Vec<usize>, usize) {
        let mut union = DisjointSets::new(self.vertices.len());
        for [a, b, c] in &self.triangles {
            union.merge(*a, *b);
            union.merge(*b, *c);
        }
        let mut numbers: HashMap<u32, usize> = HashMap::new();
        let of = self.triangles.iter().map(|triangle| {
            let next = numbers.len();
            *numbers.entry(union.root(triangle[0])).or_insert(next)
        });
        let of: Vec<usize> = of.collect();
        (of, numbers.len())
    }

    /// Splits the triangles by component, each with vertices of its own.
    pub fn pieces(&self, component: &[usize], count: usize) -> Vec<Self> {
        let mut pieces = vec![Self::default(); count];
        let mut place = vec![(usize::MAX, 0); self.vertices.len()];
        for (triangle, &of) in self.triangles.iter().zip(component) {
            let piece = &mut pieces[of];
            let own = triangle.map(|index| {
                let place = &mut place[index as usize];
                if place.0 != of {
                    *place = (of, piece.vertices.len() as u32);
                    piece.vertices.push(self.vertices[index as usize]);
                }
                place.1
            });
            piece.triangles.push(own);
        }
        pieces
    }

    /// Returns vertices and triangles without unused vertices.
    pub fn compact(&self) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let mut number = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        let triangles = self.triangles.iter().map(|triangle| {
            triangle.map(|index| {
                let place = &mut number[index as usize];
                if *place == u32::MAX {
                    *place = vertices.len() as u32;
                    vertices.push(self.vertices[index as usize]);
                }
                *place
            })
        });
        let triangles = triangles.collect();
        (vertices, triangles)
    }
}

/// Disjoint sets (union-find).
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Creates `count` sets of one item each.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// Returns the representative of the set of `item`: its lowest member.
    pub fn root(&mut self, item: u32) -> u32 {
        let mut at = item;
        while self.0[at as usize] != at {
            let above = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = above;
            at = above;
        }
        at
    }

    /// Joins two sets.
    pub fn merge(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
