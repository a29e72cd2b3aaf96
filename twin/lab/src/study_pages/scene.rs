//! Data that a page draws: the hand's links once, the objects, and a few numbers per grasp.

use std::sync::Arc;

use dexterous_grasping::synthesis::held::HeldGrasp;
use grasp_analysis::classification::ClassifiedGrasp;
use hand_model::Hand;
use hand_model::hand::CoverShape;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;
use world::objects::ObjectModel;

/// Triangle mesh in its own frame, in whole multiples of 0.1 mm to keep the file small.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PageMesh {
    /// x, y, z of each vertex, 0.1 mm.
    pub v: Vec<i32>,
    /// Vertex indices, three per triangle.
    pub f: Vec<u32>,
}

impl PageMesh {
    /// Creates a mesh from points in m.
    pub fn new(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        Self {
            v: points.iter().flat_map(|p| [p.x, p.y, p.z].map(|x| (x * 1e4).round() as i32)).collect(),
            f: triangles.iter().flatten().copied().collect(),
        }
    }

    /// Returns a rounded box with one facet per rounded edge.
    fn cover(cover: &CoverShape) -> Self {
        let inner = cover.half.add_scalar(-cover.radius);
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0, 1.0] {
                let base = points.len() as u32;
                for j in 0..4 {
                    for i in 0..4 {
                        let at = |n: usize, a: usize| [-cover.half[a], -inner[a], inner[a], cover.half[a]][n];
                        let mut p = Vector3::zeros();
                        (p[axis], p[u], p[v]) = (side * cover.half[axis], at(i, u), at(j, v));
                        let core = p.zip_map(&inner, |x, limit| x.clamp(-limit, limit));
                        let surface = core + (p - core).normalize() * cover.radius;
                        points.push(cover.link_from_cover * Point3::from(surface));
                    }
                }
                for (i, j) in (0..3).flat_map(|j| (0..3).map(move |i| (i, j))) {
                    let corner = base + 4 * j + i;
                    let quad = [corner, corner + 1, corner + 5, corner + 4];
                    let [a, b, c, d] = if side > 0.0 { quad } else { [quad[0], quad[3], quad[2], quad[1]] };
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        Self::new(&points, &triangles)
    }
}

/// Frame of a joint: its parent (-1 is the palm), and row-major rotation and position (m) in the parent's frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct JointFrame {
    p: i32,
    r: [f64; 9],
    t: [f64; 3],
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PageObject {
    pub name: String,
    pub mesh: PageMesh,
}

/// A grasp on an object, with its contacts in the palm frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PageGrasp {
    pub id: String,
    /// Index of the object.
    pub o: usize,
    /// `palm_from_object`: x, y, z, i, j, k, w.
    pub p: [f64; 7],
    /// Joint angles, rad.
    pub q: Vec<f64>,
    /// Contacts: position, m, and the unit normal into the object.
    pub c: Vec<[f64; 6]>,
}

impl PageGrasp {
    /// Converts a held grasp of object number `object`. Contacts of one link within 3 mm of each other are merged.
    pub fn new(id: String, object: usize, grasp: &HeldGrasp) -> Self {
        let mut seen: Vec<(Option<usize>, [f64; 3])> = Vec::new();
        let mut c = Vec::new();
        for contact in &grasp.contacts {
            let near = |p: &[f64; 3]| p.iter().zip(&contact.point).all(|(a, b)| (a - b).abs() < 3e-3);
            if !seen.iter().any(|(link, point)| *link == contact.link && near(point)) {
                seen.push((contact.link, contact.point));
                let ([x, y, z], [a, b, n]) = (contact.point, contact.normal);
                c.push([x, y, z, a, b, n]);
            }
        }
        Self { id, o: object, p: *grasp.closed, q: grasp.joints.to_vec(), c }
    }
}

/// All data of a page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PageScene {
    joints: Vec<JointFrame>,
    links: Vec<PageMesh>,
    objects: Vec<PageObject>,
    grasps: Vec<PageGrasp>,
}

impl PageScene {
    pub fn new(hand: &Hand, objects: Vec<PageObject>, grasps: Vec<PageGrasp>) -> Self {
        let frame = |parent: Option<usize>, origin: &Isometry3<f64>| JointFrame {
            p: parent.map_or(-1, |parent| parent as i32),
            r: std::array::from_fn(|n| (origin.rotation.to_rotation_matrix()[(n / 3, n % 3)] * 1e7).round() / 1e7),
            t: [origin.translation.x, origin.translation.y, origin.translation.z],
        };
        Self {
            joints: hand.tree.joints.iter().map(|joint| frame(joint.parent, &joint.origin)).collect(),
            links: std::iter::once(&hand.palm_cover).chain(&hand.covers).map(PageMesh::cover).collect(),
            objects,
            grasps,
        }
    }

    /// Creates the scene of `grasps` of `hand` on their `objects`, which are in the order of the classification.
    pub fn from_grasps<'a>(
        hand: &Hand,
        objects: &[Arc<ObjectModel>],
        grasps: impl IntoIterator<Item = &'a ClassifiedGrasp>,
    ) -> Self {
        let objects = objects.iter().map(|object| {
            let (points, triangles, _) = object.shape.triangles();
            PageObject { name: object.name.clone(), mesh: PageMesh::new(&points, &triangles) }
        });
        let grasps = grasps.into_iter().map(|grasp| PageGrasp::new(grasp.id.clone(), grasp.object, &grasp.grasp));
        Self::new(hand, objects.collect(), grasps.collect())
    }

    /// Returns the number of grasps.
    pub fn grasp_count(&self) -> usize {
        self.grasps.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The drawn surface of a cover is closed (every edge is used once in each direction, up to shared corners) and
    /// faces outwards.
    #[test]
    fn covers_face_outwards() {
        let hand = Hand::ftac();
        for cover in &hand.covers {
            let mesh = PageMesh::cover(cover);
            let at = |n: u32| Vector3::from_fn(|k, _| f64::from(mesh.v[3 * n as usize + k]));
            let center = cover.link_from_cover.translation.vector * 1e4;
            let volume: f64 = mesh
                .f
                .chunks(3)
                .map(|f| (at(f[0]) - center).dot(&(at(f[1]) - center).cross(&(at(f[2]) - center))) / 6.0)
                .sum();
            let half = cover.half * 1e4;
            let full = 8.0 * half.x * half.y * half.z;
            // Rounded edges and corners remove up to a quarter of a thin box.
            assert!(volume > 0.7 * full && volume < full, "{volume} {full}");
        }
    }
}
