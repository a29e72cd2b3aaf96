//! Mesh files of links: their location, their content, and their convex decomposition.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Vector3};

use crate::hand_mechanism::Triangles;
use crate::urdf::urdf_error;
use ftac_platform::data::DataError;

/// Largest reach of a link's mesh, m; a larger one is probably in millimetres.
const MAX_MESH_REACH: f64 = 2.0;

/// Thickness below which points span no volume, m.
const MIN_THICKNESS: f64 = 1e-6;

/// Smallest and largest number of directions in which the hull of a fine mesh is sampled.
const DIRECTION_COUNTS: (usize, usize) = (256, 4096);
/// Tolerance of the sampled hull, m.
const HULL_TOLERANCE: f64 = 1e-4;

/// A surface decomposed into convex parts.
#[derive(Debug, Clone, Default)]
pub struct ConvexDecomposition {
    /// Vertices of each part.
    pub parts: Vec<Vec<Point3<f64>>>,
    /// Largest distance by which the parts protrude from the surface, m.
    pub protrusion: f64,
}

/// Functions that read and decompose mesh files, supplied by a crate that knows their formats.
#[derive(Debug, Clone, Copy)]
pub struct MeshTools {
    /// Reads a file, in the file's own unit.
    pub read: fn(&Path) -> Result<Triangles, DataError>,
    /// Decomposes a surface (m), closed or not, into convex parts.
    pub decompose: fn(&Triangles) -> ConvexDecomposition,
}

impl MeshTools {
    /// For hands whose collision shapes are boxes, spheres, cylinders and capsules: a mesh file is an error.
    pub const NONE: Self = Self {
        read: |path| Err(DataError::field(path, "name", "a mesh", "no mesh: this program cannot read mesh files")),
        decompose: |_| ConvexDecomposition { parts: Vec::new(), protrusion: 0.0 },
    };
}

/// A mesh of a link.
#[derive(Debug)]
pub(crate) struct LinkMesh {
    /// Scaled triangles, m.
    pub triangles: Triangles,
    /// Vertices of its convex parts. For fine meshes, only those that span the hull to within 0.1 mm.
    pub parts: Vec<Vec<Point3<f64>>>,
    /// Largest distance by which the parts protrude from the mesh, m.
    pub protrusion: f64,
    /// Number of edges that do not have exactly two faces: 0 if the mesh is watertight.
    pub open_edges: usize,
}

/// Cache of meshes already read: fingers share theirs.
pub(crate) struct MeshCache {
    tools: MeshTools,
    meshes: BTreeMap<(PathBuf, [u64; 3]), Arc<LinkMesh>>,
}

impl MeshCache {
    pub(crate) fn new(tools: MeshTools) -> Self {
        Self { tools, meshes: BTreeMap::new() }
    }

    /// Reads the mesh `filename` that `element` of the URDF at `urdf` names.
    pub(crate) fn read(
        &mut self,
        filename: &str,
        scale: &Vector3<f64>,
        urdf: &Path,
        element: &str,
    ) -> Result<Arc<LinkMesh>, DataError> {
        let wrong = |field: &str, found: String, expected: &str| {
            urdf_error(urdf, format!("{element}.mesh"), field, found, expected)
        };
        if scale.iter().any(|part| !part.is_finite() || *part == 0.0) {
            return Err(wrong("scale", format!("{:?}", scale.as_slice()), "three finite numbers, none of them zero"));
        }
        let file = locate(filename, urdf).map_err(|(found, expected)| wrong("filename", found, &expected))?;
        let key = (file, [scale.x, scale.y, scale.z].map(f64::to_bits));
        if let Some(known) = self.meshes.get(&key) {
            return Ok(known.clone());
        }
        let read =
            (self.tools.read)(&key.0).map_err(|error| wrong("filename", error.to_string(), "a readable mesh"))?;
        let mesh = Arc::new(scaled(read, scale, &key.0, &wrong, self.tools)?);
        self.meshes.insert(key, mesh.clone());
        Ok(mesh)
    }
}

fn scaled(
    (vertices, mut triangles): Triangles,
    scale: &Vector3<f64>,
    file: &Path,
    wrong: &dyn Fn(&str, String, &str) -> DataError,
    tools: MeshTools,
) -> Result<LinkMesh, DataError> {
    if vertices.len() < 4 || triangles.is_empty() {
        let found = format!("{} vertices and {} triangles in {}", vertices.len(), triangles.len(), file.display());
        return Err(wrong("filename", found, "a surface: at least four vertices, and triangles between them"));
    }
    if let Some(n) = vertices.iter().position(|vertex| vertex.iter().any(|part| !part.is_finite())) {
        let found = format!("vertex {} at {:?} in {}", n + 1, vertices[n].coords.as_slice(), file.display());
        return Err(wrong("filename", found, "finite coordinates"));
    }
    let vertices: Vec<Point3<f64>> = vertices.iter().map(|v| Point3::from(v.coords.component_mul(scale))).collect();
    // Mirroring reverses the orientation of the triangles.
    if scale.product() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    let reach = vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max);
    if reach > MAX_MESH_REACH {
        let expected = "metres: a mesh in millimetres needs scale=\"0.001 0.001 0.001\"";
        return Err(wrong("scale", format!("vertices up to {reach:.1} m from the origin"), expected));
    }
    let middle: Vector3<f64> =
        vertices.iter().map(|vertex| vertex.coords).sum::<Vector3<f64>>() / vertices.len() as f64;
    let spread: Matrix3<f64> =
        vertices.iter().map(|vertex| (vertex.coords - middle) * (vertex.coords - middle).transpose()).sum();
    let thinnest = (spread.symmetric_eigenvalues().min().max(0.0) / vertices.len() as f64).sqrt();
    if thinnest < MIN_THICKNESS {
        return Err(wrong("filename", "points in one plane".into(), "points that span a volume"));
    }
    let open_edges = open_edges(&vertices, &triangles);
    let triangles = (vertices, triangles);
    let ConvexDecomposition { parts, protrusion: excess } = (tools.decompose)(&triangles);
    let parts = parts.into_iter().map(thin_points).collect();
    Ok(LinkMesh { triangles, parts, protrusion: excess, open_edges })
}

/// Generates directions spread evenly over the sphere (Fibonacci).
fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |n| {
        let z = 1.0 - (2 * n + 1) as f64 / count as f64;
        let (sin, cos) = (golden * n as f64).sin_cos();
        let around = (1.0 - z * z).sqrt();
        Vector3::new(around * cos, around * sin, z)
    })
}

/// Returns the index of the farthest point along a direction.
fn farthest(points: &[Point3<f64>], way: &Vector3<f64>) -> Option<usize> {
    let along = |n: &usize| points[*n].coords.dot(way);
    (0..points.len()).max_by(|a, b| along(a).total_cmp(&along(b)))
}

/// Keeps only points that are farthest in one of many directions. Their convex hull equals that of all points to within
/// [`HULL_TOLERANCE`], which is checked along four times as many directions. Returns all points if that fails or if
/// there are few.
fn thin_points(points: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let mut count = DIRECTION_COUNTS.0;
    while count <= DIRECTION_COUNTS.1 && count < points.len() {
        let kept: BTreeSet<usize> = directions(count).filter_map(|way| farthest(&points, &way)).collect();
        let kept: Vec<Point3<f64>> = kept.into_iter().map(|n| points[n]).collect();
        let reach = |points: &[Point3<f64>], way: &Vector3<f64>| {
            farthest(points, way).map_or(0.0, |n| points[n].coords.dot(way))
        };
        if directions(4 * count + 1).all(|way| reach(&points, &way) - reach(&kept, &way) <= HULL_TOLERANCE) {
            return kept;
        }
        count *= 2;
    }
    points
}

/// Counts the edges without exactly two faces. Vertices at the same position count as one.
fn open_edges(vertices: &[Point3<f64>], faces: &[[u32; 3]]) -> usize {
    let mut places: BTreeMap<[u64; 3], usize> = BTreeMap::new();
    // Adding zero maps -0 and 0 to the same bits.
    let place: Vec<usize> = vertices
        .iter()
        .map(|v| {
            let next = places.len();
            *places.entry([v.x, v.y, v.z].map(|part| (part + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for face in faces {
        for n in 0..3 {
            let corner = |n: usize| place.get(face[n % 3] as usize);
            let (Some(a), Some(b)) = (corner(n), corner(n + 1)) else { continue };
            if a != b {
                *edges.entry((*a.min(b), *a.max(b))).or_insert(0) += 1;
            }
        }
    }
    edges.values().filter(|count| **count != 2).count()
}

/// Locates the mesh file that `filename` of the URDF at `urdf` names. The error is what was found and what was
/// expected.
///
/// A name is a path relative to the URDF's folder. `file://` names a path on this machine, `package://` and `model://`
/// one in a package. A package is looked for in every folder from the URDF's upwards: by its name, then as that folder
/// itself. `%20` and backslashes are understood.
fn locate(filename: &str, urdf: &Path) -> Result<PathBuf, (String, String)> {
    let absolute = std::path::absolute(urdf).unwrap_or_else(|_| urdf.to_path_buf());
    let folder = absolute.parent().unwrap_or(Path::new("/"));
    let mut looked = Vec::new();
    for name in spellings(filename) {
        let candidates: Vec<PathBuf> =
            if let Some(inside) = ["package://", "model://"].iter().find_map(|scheme| name.strip_prefix(scheme)) {
                let rest = inside.split_once('/').map_or(inside, |(_, rest)| rest);
                let named = folder.ancestors().map(|up| up.join(inside));
                named.chain(folder.ancestors().map(|up| up.join(rest))).collect()
            } else {
                let local = name.strip_prefix("file://").unwrap_or(&name);
                // `file://host/path` names this machine or another; without a host the path follows directly.
                let local = local.strip_prefix("localhost").filter(|rest| rest.starts_with('/')).unwrap_or(local);
                vec![folder.join(local)]
            };
        if let Some(found) = candidates.iter().find(|path| path.is_file()) {
            return Ok(found.clone());
        }
        looked.extend(candidates);
    }
    let mut places: Vec<String> = Vec::new();
    for path in looked {
        let place = path.display().to_string();
        if !places.contains(&place) {
            places.push(place);
        }
    }
    // The folders far above are of no interest.
    let shown = places.len().min(MAX_PATHS_SHOWN);
    let expected = format!(
        "a mesh file; looked for {}{}",
        places[..shown].join(", "),
        if shown < places.len() { ", and further up" } else { "" }
    );
    Err((format!("no `{filename}`"), expected))
}

/// Largest number of paths in an error message.
const MAX_PATHS_SHOWN: usize = 6;

/// Returns the possible spellings of a file name: as given, with slashes for backslashes, and percent-decoded.
fn spellings(filename: &str) -> Vec<String> {
    let slashes = filename.replace('\\', "/");
    let mut names = vec![filename.to_owned(), slashes.clone(), percent_decode(&slashes)];
    names.dedup();
    names
}

/// Decodes percent-encoded bytes (`%` and two hexadecimal digits).
fn percent_decode(text: &str) -> String {
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let [first, after @ ..] = rest {
        let code = after.get(..2).and_then(|two| std::str::from_utf8(two).ok());
        match code.and_then(|two| u8::from_str_radix(two, 16).ok()) {
            Some(byte) if *first == b'%' => {
                bytes.push(byte);
                rest = &after[2..];
            }
            _ => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8(bytes).unwrap_or_else(|_| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron is closed; without one face the three edges around the hole are open.
    #[test]
    fn open_edges_are_counted() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        assert_eq!(open_edges(&corners, &faces), 0);
        assert_eq!(open_edges(&corners, &faces[..3]), 3);
        let soup: Vec<Point3<f64>> = faces.iter().flatten().map(|corner| corners[*corner as usize]).collect();
        assert_eq!(open_edges(&soup, &[[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]), 0);
    }

    /// Finds a mesh in a neighbouring package, with Windows path separators, behind `file://`, and with a blank written
    /// as %20.
    #[test]
    fn meshes_are_found_however_they_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        for name in ["own/urdf", "own/meshes", "parts/meshes"] {
            std::fs::create_dir_all(at(name)).expect("made");
        }
        for name in ["own/meshes/finger one.stl", "own/meshes/tip.stl", "parts/meshes/tip.stl"] {
            std::fs::write(at(name), "").expect("written");
        }
        let urdf = at("own/urdf/hand.urdf");
        let find = |name: &str| locate(name, &urdf).map(|path| path.canonicalize().expect("there"));
        let there = |name: &str| at(name).canonicalize().expect("there");
        assert_eq!(find("package://parts/meshes/tip.stl"), Ok(there("parts/meshes/tip.stl")), "not the own package's");
        assert_eq!(find("package://own/meshes/tip.stl"), Ok(there("own/meshes/tip.stl")));
        assert_eq!(find("package://renamed/meshes/tip.stl"), Ok(there("own/meshes/tip.stl")));
        assert_eq!(find("..\\meshes\\tip.stl"), Ok(there("own/meshes/tip.stl")));
        assert_eq!(find("../meshes/finger%20one.stl"), Ok(there("own/meshes/finger one.stl")));
        let uri = format!("file://{}", at("own/meshes/finger%20one.stl").display());
        assert_eq!(find(&uri), Ok(there("own/meshes/finger one.stl")));
        let (found, expected) = find("package://lost/meshes/tip2.stl").expect_err("none there");
        assert_eq!(found, "no `package://lost/meshes/tip2.stl`");
        assert!(expected.contains(&at("own/urdf/lost/meshes/tip2.stl").display().to_string()), "{expected}");
    }

    /// A finely meshed sphere is thinned to few points, and its hull shrinks by less than the tolerance. A box keeps
    /// its corners.
    #[test]
    fn fine_meshes_are_thinned() {
        let ball: Vec<Point3<f64>> = directions(5000).map(|way| Point3::from(way * 0.012)).collect();
        let kept = thin_points(ball.clone());
        assert!((100..1000).contains(&kept.len()), "{}", kept.len());
        let worst = directions(777).map(|way| {
            let reach = |points: &[Point3<f64>]| points.iter().map(|p| p.coords.dot(&way)).fold(0.0, f64::max);
            reach(&ball) - reach(&kept)
        });
        assert!(worst.fold(0.0, f64::max) <= HULL_TOLERANCE);
        let side: Vec<f64> = (0..20).map(|n| 0.001 * f64::from(n)).collect();
        let grid: Vec<Point3<f64>> = side
            .iter()
            .flat_map(|x| side.iter().flat_map(move |y| [0.0, 0.01].map(|z| Point3::new(*x, *y, z))))
            .collect();
        let corners = thin_points(grid);
        for (x, y, z) in [(0.0, 0.0, 0.0), (0.019, 0.0, 0.01), (0.019, 0.019, 0.0), (0.0, 0.019, 0.01)] {
            assert!(corners.iter().any(|p| (p - Point3::new(x, y, z)).norm() < 1e-9), "{x} {y} {z}");
        }
        assert!(corners.len() < 100, "{}", corners.len());
    }
}
