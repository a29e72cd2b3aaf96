//! Inside-outside test for any set of triangles: the generalized winding number (Jacobson et al. 2013).
//!
//! For a closed surface, it is 1 inside and 0 outside. With holes, overlaps and loose ends it varies smoothly instead
//! of failing. Distant triangles are combined into one dipole (Barill et al. 2018), so that a query costs a walk down a
//! tree instead of a pass over all triangles.

use nalgebra::{Point3, Vector3};

/// Distance, in radii of a cluster, beyond which the cluster is approximated by a dipole; the error is below a
/// hundredth.
const DIPOLE_DISTANCE: f64 = 3.0;
/// Greatest number of triangles of a leaf.
const MAX_LEAF_TRIANGLES: usize = 8;

/// Tree over the triangles.
pub struct WindingTree {
    triangles: Vec<[Point3<f64>; 3]>,
    nodes: Vec<Node>,
}

struct Node {
    /// Mean of the triangles' centres, weighted by area, m.
    center: Point3<f64>,
    /// Radius, m.
    radius: f64,
    /// Sum of area times normal, m2.
    dipole: Vector3<f64>,
    range: std::ops::Range<usize>,
    /// Index of the first of two consecutive children, if any.
    children: Option<usize>,
}

fn area(triangle: &[Point3<f64>; 3]) -> Vector3<f64> {
    (triangle[1] - triangle[0]).cross(&(triangle[2] - triangle[0])) * 0.5
}

fn middle(triangle: &[Point3<f64>; 3]) -> Vector3<f64> {
    (triangle[0].coords + triangle[1].coords + triangle[2].coords) / 3.0
}

impl WindingTree {
    /// Builds the tree for triangles in any order, counter-clockwise seen from outside.
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let corners = triangles.iter().map(|triangle| triangle.map(|index| vertices[index as usize])).collect();
        let mut tree = Self { triangles: corners, nodes: Vec::new() };
        let whole = tree.node(0..tree.triangles.len());
        tree.nodes.push(whole);
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let range = tree.nodes[index].range.clone();
            if range.len() <= MAX_LEAF_TRIANGLES {
                continue;
            }
            let own = &mut tree.triangles[range.clone()];
            let (low, high) = own
                .iter()
                .map(middle)
                .fold((Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)), |(low, high), at| {
                    (low.inf(&at), high.sup(&at))
                });
            let axis = (high - low).imax();
            let half = range.len() / 2;
            own.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]));
            let (left, right) = (tree.node(range.start..range.start + half), tree.node(range.start + half..range.end));
            let first = tree.nodes.len();
            tree.nodes.extend([left, right]);
            tree.nodes[index].children = Some(first);
            open.extend([first, first + 1]);
        }
        tree
    }

    fn node(&self, range: std::ops::Range<usize>) -> Node {
        let own = &self.triangles[range.clone()];
        let total: f64 = own.iter().map(|triangle| area(triangle).norm()).sum();
        let weighted: Vector3<f64> = own.iter().map(|triangle| middle(triangle) * area(triangle).norm()).sum();
        let center = Point3::from(weighted / total.max(f64::MIN_POSITIVE));
        let radius = own.iter().flatten().map(|corner| (corner - center).norm()).fold(0.0, f64::max);
        Node { center, radius, dipole: own.iter().map(area).sum(), range, children: None }
    }

    /// Returns the winding number at `point`.
    pub fn winding_number(&self, point: &Point3<f64>) -> f64 {
        let (mut sum, mut open) = (0.0, vec![0]);
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            let away = node.center - point;
            let distance = away.norm();
            if distance > DIPOLE_DISTANCE * node.radius {
                sum += node.dipole.dot(&away) / distance.powi(3);
            } else if let Some(first) = node.children {
                open.extend([first, first + 1]);
            } else {
                sum +=
                    self.triangles[node.range.clone()].iter().map(|triangle| solid_angle(triangle, point)).sum::<f64>();
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }
}

/// Returns the solid angle of a triangle seen from `point` (Van Oosterom & Strackee 1983), positive from behind.
fn solid_angle(triangle: &[Point3<f64>; 3], point: &Point3<f64>) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner - point);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let across = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * a.dot(&b.cross(&c)).atan2(across)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ObjectShape;

    /// A ball's surface has winding number 1 inside and 0 outside, with clusters and without. Without its cap, this is
    /// still nearly so.
    #[test]
    fn a_ball_winds_once() {
        let (points, triangles, _) = ObjectShape::Sphere { radius: 0.03 }.triangles();
        let whole = WindingTree::new(&points, &triangles);
        let cap: Vec<[u32; 3]> =
            triangles.iter().filter(|t| t.iter().all(|i| points[*i as usize].z < 0.027)).copied().collect();
        assert!(cap.len() < triangles.len());
        let open = WindingTree::new(&points, &cap);
        for n in 0..200 {
            let turn = 0.7 * f64::from(n);
            let way = Vector3::new(turn.cos(), turn.sin(), (0.31 * turn).sin()).normalize();
            for (radius, expected) in [(0.01, 1.0), (0.027, 1.0), (0.033, 0.0), (0.08, 0.0)] {
                let found = whole.winding_number(&Point3::from(way * radius));
                assert!((found - expected).abs() < 0.02, "{found} at {radius}");
            }
            assert!(open.winding_number(&Point3::from(way * 0.015)) > 0.7);
            assert!(open.winding_number(&Point3::from(way * 0.05)) < 0.1);
        }
    }
}
