//! Convex hulls on which objects stand stably.
//!
//! parry makes contacts with a hull's face from the face's first four vertices only. On a round foot these lie side by
//! side, so that the object rests on a sliver and rocks. In each face with more vertices, [`standing_hull`] keeps the
//! four that span the largest area and moves the others back by 50 um. The face becomes a quadrilateral, contacts span
//! it, and the hull changes by less than the tactile sensors can resolve.

use nalgebra::Point3;
use parry3d_f64::math::Vector;
use parry3d_f64::shape::{ConvexPolyhedron, SharedShape};

use super::mesh::to_parry;

/// Distance by which a vertex that is not one of the four is moved back behind its face, m.
const SET_BACK_DISTANCE: f64 = 5e-5;

/// Computes the convex hull of `points` such that no face on which it could stand has more than four vertices. `None`
/// if they span no volume.
pub fn standing_hull(points: &[Point3<f64>]) -> Option<SharedShape> {
    let points: Vec<Vector> = points.iter().map(to_parry).collect();
    let hull = ConvexPolyhedron::from_convex_hull(&points)?;
    let mut moved = hull.points().to_vec();
    for face in hull.faces() {
        let from = face.first_vertex_or_edge as usize;
        let vertices = &hull.vertices_adj_to_face()[from..from + face.num_vertices_or_edges as usize];
        if vertices.len() <= 4 {
            continue;
        }
        let outline: Vec<Vector> = vertices.iter().map(|&vertex| hull.points()[vertex as usize]).collect();
        let corners = largest_quadrilateral(&outline, face.normal);
        for (n, &vertex) in vertices.iter().enumerate() {
            if !corners.contains(&n) {
                moved[vertex as usize] -= face.normal * SET_BACK_DISTANCE;
            }
        }
    }
    SharedShape::convex_hull(&moved)
}

/// Returns the indices of the four vertices of a convex outline that span the largest area.
fn largest_quadrilateral(outline: &[Vector], normal: Vector) -> [usize; 4] {
    let count = outline.len();
    let area =
        |a: usize, b: usize, c: usize| (outline[b] - outline[a]).cross(outline[c] - outline[a]).dot(normal).abs();
    let mut best = ([0, 1, 2, 3], 0.0);
    for a in 0..count {
        for c in a + 2..count {
            // For a given diagonal, the other two corners can be chosen independently, one on each side.
            let farthest = |side: &mut dyn Iterator<Item = usize>| {
                side.map(|n| (n, area(a, c, n))).max_by(|x, y| x.1.total_cmp(&y.1))
            };
            let one = farthest(&mut (a + 1..c));
            let other = farthest(&mut (c + 1..count).chain(0..a));
            if let (Some((b, left)), Some((d, right))) = (one, other)
                && left + right > best.1 * (1.0 + 1e-9)
            {
                best = ([a, b, c, d], left + right);
            }
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// The foot of a 48-sided prism becomes a square of its corners.
    #[test]
    fn a_round_foot_becomes_a_square() {
        let ring = |z: f64| {
            (0..48).map(move |k| {
                let angle = TAU * f64::from(k) / 48.0;
                Point3::new(0.02 * angle.cos(), 0.02 * angle.sin(), z)
            })
        };
        let points: Vec<_> = ring(0.0).chain(ring(0.03)).collect();
        let shape = standing_hull(&points).unwrap();
        let hull = shape.as_convex_polyhedron().unwrap();
        let foot = hull.faces().iter().find(|face| face.normal.z < -0.999_999).unwrap();
        assert_eq!(foot.num_vertices_or_edges, 4);
        let from = foot.first_vertex_or_edge as usize;
        let corners: Vec<Vector> =
            hull.vertices_adj_to_face()[from..from + 4].iter().map(|&v| hull.points()[v as usize]).collect();
        let area = 0.5 * (corners[2] - corners[0]).cross(corners[3] - corners[1]).length();
        assert!((area - 2.0 * 0.02_f64.powi(2)).abs() < 1e-9, "{area}");
    }
}
