//! Meshes of a hand's links, in any format; concave ones are cut into convex parts.
//!
//! A link gets fewer parts than an object, because they may collide with many neighbouring links.

use std::path::Path;

use ftac_platform::data::DataError;
use hand_model::hand_mechanism::Triangles;
use hand_model::urdf_hand::{ConvexDecomposition, MeshTools};
use nalgebra::Point3;
use parry3d_f64::transformation::vhacd::VHACDParameters;

use super::decomposition::{protrusion, run_vhacd};
use super::mesh::Mesh;
use super::mesh_file::read_triangles;

/// Reader and cutter for the meshes of a URDF.
pub const LINK_MESHES: MeshTools = MeshTools { read: read_link, decompose: decompose_link };

/// Distance beyond which parts that stand out of a link's surface are cut more finely, m.
const PROTRUSION_TOLERANCE: f64 = 1.5e-3;
/// (voxels along the mesh, concavity), from coarse to fine.
const RESOLUTION_LEVELS: [(u32, f64); 3] = [(40, 0.02), (64, 0.01), (96, 0.003)];
/// Greatest number of parts of a link: with more, self-collision costs more than the rest of the physics.
const MAX_PARTS: usize = 32;

/// Reads the triangles of a link's mesh file. Unlike objects, robot descriptions use glTF's axes unchanged.
fn read_link(path: &Path) -> Result<Triangles, DataError> {
    let (mut vertices, triangles) = read_triangles(path)?;
    let extension = path.extension().and_then(|end| end.to_str()).unwrap_or_default().to_lowercase();
    if matches!(extension.as_str(), "gltf" | "glb") {
        vertices.iter_mut().for_each(|vertex| *vertex = Point3::new(vertex.x, vertex.z, -vertex.y));
    }
    Ok((vertices, triangles))
}

/// Returns the hull of a surface if it stands out only slightly, otherwise its convex parts: the first cut within
/// [`PROTRUSION_TOLERANCE`], or the best of those with few enough parts. An open surface is mended first.
pub fn decompose_link(surface: &Triangles) -> ConvexDecomposition {
    let (vertices, triangles) = surface;
    let whole = vec![vertices.clone()];
    let closed = Mesh::new(vertices.clone(), triangles.clone());
    let Some(mesh) = closed.ok().or_else(|| Some(Mesh::repaired(vertices, triangles).ok()?.0)) else {
        // Nothing to cut or to measure against.
        return ConvexDecomposition { parts: whole, protrusion: 0.0 };
    };
    let mut best = ConvexDecomposition { protrusion: protrusion(&mesh, &whole), parts: whole };
    for (resolution, concavity) in RESOLUTION_LEVELS {
        if best.protrusion <= PROTRUSION_TOLERANCE {
            break;
        }
        let parts = run_vhacd(&mesh, VHACDParameters { resolution, concavity, ..VHACDParameters::default() });
        let parts: Vec<Vec<Point3<f64>>> = parts.into_iter().filter(|part| part.len() >= 4).collect();
        if parts.is_empty() || parts.len() > MAX_PARTS {
            break;
        }
        let out = protrusion(&mesh, &parts);
        if out < best.protrusion {
            best = ConvexDecomposition { parts, protrusion: out };
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ObjectShape;
    use nalgebra::Vector3;

    /// An angle bracket of two plates: its hull stands out by the depth of the corner, its parts by less than the
    /// tolerance.
    #[test]
    fn hulls_of_concave_links_are_cut() {
        let outline = [[0.0, 0.0], [0.05, 0.0], [0.05, 0.01], [0.01, 0.01], [0.01, 0.05], [0.0, 0.05]];
        let at = |[x, y]: [f64; 2], z: f64| Point3::new(x, y, z);
        let vertices: Vec<Point3<f64>> =
            [-0.01, 0.01].iter().flat_map(|z| outline.iter().map(move |corner| at(*corner, *z))).collect();
        let caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
        let mut triangles: Vec<[u32; 3]> = caps.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        triangles.extend(caps.iter().map(|corners| corners.map(|n| n + 6)));
        for n in 0..6 {
            let next = (n + 1) % 6;
            triangles.extend([[n, next, next + 6], [n, next + 6, n + 6]]);
        }
        let mesh = Mesh::new(vertices.clone(), triangles.clone()).expect("closed");
        let whole = protrusion(&mesh, std::slice::from_ref(&vertices));
        let cut = decompose_link(&(vertices, triangles));
        println!("hull {:.2} mm, {} parts {:.2} mm", 1e3 * whole, cut.parts.len(), 1e3 * cut.protrusion);
        assert!(whole > 0.018 && cut.parts.len() > 1, "{whole} m, {} parts", cut.parts.len());
        assert!(cut.protrusion <= PROTRUSION_TOLERANCE, "{} m", cut.protrusion);
    }

    /// A convex link remains a single hull.
    #[test]
    fn a_convex_link_is_one_part() {
        let shape = ObjectShape::Cuboid { half: Vector3::new(0.02, 0.01, 0.03), radius: 0.0 };
        let (vertices, triangles, _) = shape.triangles();
        let cut = decompose_link(&(vertices, triangles));
        assert_eq!(cut.parts.len(), 1);
        assert!(cut.protrusion < 1e-6, "{}", cut.protrusion);
    }
}
