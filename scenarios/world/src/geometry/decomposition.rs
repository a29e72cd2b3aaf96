//! Convex decomposition of a mesh whose parts follow its concavities.
//!
//! VHACD cuts a mesh at a given resolution and concavity, relative to the mesh's size. Here it is called with finer and
//! finer settings until no part stands out of the surface by more than a tolerance.

use nalgebra::Point3;
use parry3d_f64::math::Vector;
use parry3d_f64::shape::SharedShape;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};

use super::mesh::{Mesh, from_parry};
use super::revolution::hull_mesh;
use super::standing_hull::standing_hull;

/// (voxels along the mesh, concavity), from coarse to fine.
const RESOLUTION_LEVELS: [(u32, f64); 4] = [(64, 0.01), (96, 0.003), (128, 0.001), (192, 0.0003)];
/// Greatest number of parts: more would slow the physics down, and the finer cut is then not used.
const MAX_PARTS: usize = 96;
/// Spacing of the points on a part at which it is compared with the mesh, m.
const SAMPLE_SPACING: f64 = 1.5e-3;

/// Returns convex point sets that together fill `mesh`, and the greatest distance by which they stand out of it, m. It
/// is the first cut within `tolerance`, m, or the best of those with few enough parts.
pub(super) fn decompose(mesh: &Mesh, tolerance: f64) -> (Vec<Vec<Point3<f64>>>, f64) {
    let mut best: Option<(Vec<Vec<Point3<f64>>>, f64)> = None;
    for (resolution, concavity) in RESOLUTION_LEVELS {
        let parts = run_vhacd(mesh, VHACDParameters { resolution, concavity, ..VHACDParameters::default() });
        if best.is_some() && parts.len() > MAX_PARTS {
            break;
        }
        let out = protrusion(mesh, &parts);
        if best.as_ref().is_none_or(|(_, least)| out < *least) {
            best = Some((parts, out));
        }
        if out <= tolerance {
            break;
        }
    }
    best.unwrap_or_default()
}

pub(super) fn run_vhacd(mesh: &Mesh, parameters: VHACDParameters) -> Vec<Vec<Point3<f64>>> {
    let (points, triangles) = mesh.decomposition_input();
    VHACD::decompose(&parameters, points, triangles, true)
        .compute_exact_convex_hulls(points, triangles)
        .into_iter()
        .map(|(hull, _): (Vec<Vector>, _)| hull.into_iter().map(from_parry).collect::<Vec<_>>())
        // Some voxels contain no piece of the surface.
        .filter(|hull| hull.len() > 3)
        .collect()
}

/// Returns the greatest distance by which `parts` stand out of `mesh`, m, at points [`SAMPLE_SPACING`] apart on their
/// faces.
pub(super) fn protrusion(mesh: &Mesh, parts: &[Vec<Point3<f64>>]) -> f64 {
    // On one thread: a mesh is decomposed under the lock of its parts, where a worker that waits for others could be given
    // a job that needs the same parts.
    let hulls = parts.iter().filter_map(|part| hull_mesh(part).ok());
    let points = hulls.flat_map(|hull| surface_points(&hull));
    points.map(|point| mesh.signed_distance(&point).0).fold(0.0, f64::max)
}

/// Returns points on a mesh: its vertices, and points [`SAMPLE_SPACING`] apart between those of a larger triangle.
fn surface_points(mesh: &Mesh) -> Vec<Point3<f64>> {
    let mut points = mesh.vertices().to_vec();
    for [a, b, c] in mesh.triangles().iter().map(|corners| corners.map(|n| mesh.vertices()[n as usize])) {
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let steps = (longest / SAMPLE_SPACING).ceil().max(1.0) as usize;
        for (i, j) in (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| (i, j))) {
            let is_corner = [i, j, steps - i - j].contains(&steps);
            if !is_corner {
                let (u, v) = (i as f64 / steps as f64, j as f64 / steps as f64);
                points.push(a + (b - a) * u + (c - a) * v);
            }
        }
    }
    points
}

impl Mesh {
    /// Returns convex point sets that together fill the mesh: those given by its builder, the mesh itself if it is
    /// convex, or an approximate decomposition. The first call computes the decomposition, which takes seconds for a
    /// large mesh.
    pub fn convex_parts(&self) -> &[Vec<Point3<f64>>] {
        let find = || {
            if self.is_convex() {
                return vec![self.vertices().to_vec()];
            }
            decompose(self, self.tolerance).0
        };
        self.known_parts.as_deref().unwrap_or_else(|| self.computed_parts.get_or_init(find))
    }

    /// Returns the convex parts as collision shapes ([`standing_hull`]), without those that have no volume. They are made
    /// by the first call.
    pub fn standing_hulls(&self) -> &[SharedShape] {
        self.standing_hulls
            .get_or_init(|| self.convex_parts().iter().filter_map(|points| standing_hull(points)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::DEFAULT_PART_TOLERANCE;
    use super::*;
    use crate::geometry::ObjectShape;
    use crate::objects::ObjectSet;

    /// Returns a cup: a pot of 60 x 70 mm with walls of 4 mm, without known parts.
    fn cup() -> Mesh {
        const SEGMENTS: u32 = 24;
        let outline = [[30.0, 0.0], [30.0, 70.0], [26.0, 70.0], [26.0, 4.0]];
        let mut vertices: Vec<Point3<f64>> = vec![Point3::origin(), Point3::new(0.0, 0.0, 0.004)];
        for [radius, z] in outline {
            vertices.extend((0..SEGMENTS).map(|n| {
                let angle = std::f64::consts::TAU * f64::from(n) / f64::from(SEGMENTS);
                Point3::new(radius * angle.cos(), radius * angle.sin(), z) * 1e-3
            }));
        }
        let at = |ring: u32, n: u32| 2 + ring * SEGMENTS + n % SEGMENTS;
        let mut triangles = Vec::new();
        for n in 0..SEGMENTS {
            triangles.push([0, at(0, n + 1), at(0, n)]);
            for ring in 0..3 {
                triangles.push([at(ring, n), at(ring, n + 1), at(ring + 1, n + 1)]);
                triangles.push([at(ring, n), at(ring + 1, n + 1), at(ring + 1, n)]);
            }
            triangles.push([1, at(3, n), at(3, n + 1)]);
        }
        Mesh::new(vertices, triangles).expect("a closed mesh")
    }

    /// A single hull of the cup stands out by the distance to the nearest wall of the cavity. Parts of a fine cut leave
    /// the cavity free.
    #[test]
    fn parts_follow_a_cavity() {
        let cup = cup();
        let whole = protrusion(&cup, &[cup.vertices().to_vec()]);
        assert!((whole - 0.026).abs() < 0.002, "{whole}");
        let coarse = run_vhacd(&cup, VHACDParameters::default());
        let (parts, out) = decompose(&cup, DEFAULT_PART_TOLERANCE);
        println!(
            "{} parts, {:.2} mm; coarse {} parts, {:.2} mm",
            parts.len(),
            1e3 * out,
            coarse.len(),
            1e3 * protrusion(&cup, &coarse)
        );
        assert!(out < 0.5 * protrusion(&cup, &coarse) && parts.len() <= MAX_PARTS);
        assert_eq!(out, protrusion(&cup, &parts));
    }

    /// A mesh with a larger tolerance keeps its first cut.
    #[test]
    fn what_is_good_enough_stays_coarse() {
        let set = ObjectSet::standard();
        for name in ["l_block", "caddy"] {
            let Some(ObjectShape::Mesh(mesh)) = set.get(name).map(|object| &object.shape) else {
                panic!("{name} is a mesh")
            };
            let first = run_vhacd(mesh, VHACDParameters::default());
            assert_eq!(mesh.convex_parts(), first, "{name}: its own tolerance");
            let (finer, out) = decompose(mesh, DEFAULT_PART_TOLERANCE);
            assert!(finer.len() > first.len() && out < protrusion(mesh, &first), "{name}: {out} m");
        }
    }
}
