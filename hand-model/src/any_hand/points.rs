//! Vertices of mesh files: Wavefront OBJ and STL, binary or text, and whether their faces close.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point3, Vector3};

use crate::data::DataError;
use crate::urdf::fault;

/// A link that is longer than this is probably in millimetres, m.
const LARGEST: f64 = 2.0;

/// Thinner than this, points span no volume, m.
const FLAT: f64 = 1e-6;

/// Points whose hull stands in for that of a finely cut mesh: as many directions to begin with, and at most.
const DIRECTIONS: (usize, usize) = (256, 4096);
/// How far the hull may lose, m.
const THINNED: f64 = 1e-4;

/// A mesh file as a cloud of points.
#[derive(Debug)]
pub struct Points {
    /// Vertices, scaled, m: all, or of a fine mesh those that span its convex hull to 0.1 mm.
    pub vertices: Vec<Point3<f64>>,
    /// Edges that do not have exactly two faces: 0 if the mesh is watertight.
    pub open_edges: usize,
}

/// The mesh `filename` that `element` of the URDF at `urdf` names.
pub fn read(filename: &str, scale: &Vector3<f64>, urdf: &Path, element: &str) -> Result<Points, DataError> {
    let file = locate(filename, urdf);
    let wrong =
        |field: &str, found: String, expected: &str| fault(urdf, format!("{element}.mesh"), field, found, expected);
    let bytes = std::fs::read(&file)
        .map_err(|error| wrong("filename", format!("{}: {error}", file.display()), "a mesh file beside the URDF"))?;
    let extension = file.extension().and_then(|end| end.to_str()).unwrap_or_default().to_lowercase();
    if scale.iter().any(|part| !part.is_finite() || *part == 0.0) {
        return Err(wrong("scale", format!("{:?}", scale.as_slice()), "three finite numbers, none of them zero"));
    }
    let vertices = match extension.as_str() {
        "obj" => text_vertices(&bytes, "v"),
        "stl" => binary_stl(&bytes).or_else(|| text_vertices(&bytes, "vertex")),
        _ => return Err(wrong("filename", format!("`{filename}`"), "an .obj or .stl file")),
    };
    let faces = if extension == "obj" { obj_faces(&bytes) } else { triples(vertices.as_ref().map_or(0, Vec::len)) };
    let Some(vertices) = vertices.filter(|vertices| vertices.len() >= 4) else {
        return Err(wrong("filename", format!("no readable vertices in {}", file.display()), "at least four vertices"));
    };
    if let Some(n) = vertices.iter().position(|vertex| vertex.iter().any(|part| !part.is_finite())) {
        let found = format!("vertex {} at {:?} in {}", n + 1, vertices[n].as_slice(), file.display());
        return Err(wrong("filename", found, "finite coordinates"));
    }
    let open_edges = open_edges(&vertices, &faces);
    let vertices: Vec<Point3<f64>> = vertices.iter().map(|v| Point3::from(v.component_mul(scale))).collect();
    let reach = vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max);
    if reach > LARGEST {
        let expected = "metres: a mesh in millimetres needs scale=\"0.001 0.001 0.001\"";
        return Err(wrong("scale", format!("vertices up to {reach:.1} m from the origin"), expected));
    }
    let middle: Vector3<f64> =
        vertices.iter().map(|vertex| vertex.coords).sum::<Vector3<f64>>() / vertices.len() as f64;
    let spread: Matrix3<f64> =
        vertices.iter().map(|vertex| (vertex.coords - middle) * (vertex.coords - middle).transpose()).sum();
    let thinnest = (spread.symmetric_eigenvalues().min().max(0.0) / vertices.len() as f64).sqrt();
    if thinnest < FLAT {
        return Err(wrong("filename", "points in one plane".into(), "points that span a volume"));
    }
    Ok(Points { vertices: thinned(vertices), open_edges })
}

/// Directions spread evenly over the sphere (Fibonacci).
fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |n| {
        let z = 1.0 - (2 * n + 1) as f64 / count as f64;
        let (sin, cos) = (golden * n as f64).sin_cos();
        let around = (1.0 - z * z).sqrt();
        Vector3::new(around * cos, around * sin, z)
    })
}

/// The point that is farthest along a direction.
fn farthest(points: &[Point3<f64>], way: &Vector3<f64>) -> Option<usize> {
    let along = |n: &usize| points[*n].coords.dot(way);
    (0..points.len()).max_by(|a, b| along(a).total_cmp(&along(b)))
}

/// The points that are farthest in one of many directions: their convex hull is that of all to within [`THINNED`], which is checked
/// along four times as many. All of them where that does not do, or where there are few.
fn thinned(points: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let mut count = DIRECTIONS.0;
    while count <= DIRECTIONS.1 && count < points.len() {
        let kept: BTreeSet<usize> = directions(count).filter_map(|way| farthest(&points, &way)).collect();
        let kept: Vec<Point3<f64>> = kept.into_iter().map(|n| points[n]).collect();
        let reach = |points: &[Point3<f64>], way: &Vector3<f64>| {
            farthest(points, way).map_or(0.0, |n| points[n].coords.dot(way))
        };
        if directions(4 * count + 1).all(|way| reach(&points, &way) - reach(&kept, &way) <= THINNED) {
            return kept;
        }
        count *= 2;
    }
    points
}

/// Faces of an STL: its vertices three by three.
fn triples(vertices: usize) -> Vec<Vec<usize>> {
    (0..vertices / 3).map(|n| vec![3 * n, 3 * n + 1, 3 * n + 2]).collect()
}

/// Vertex indices of an OBJ's faces, from 0; what cannot be read as an index is left out.
fn obj_faces(bytes: &[u8]) -> Vec<Vec<usize>> {
    let text = String::from_utf8_lossy(bytes);
    let corner = |word: &str| word.split('/').next()?.parse::<usize>().ok()?.checked_sub(1);
    text.lines()
        .filter_map(|line| line.trim_start().strip_prefix("f "))
        .map(|rest| rest.split_whitespace().filter_map(corner).collect())
        .collect()
}

/// Edges without exactly two faces. Vertices at the same place are the same.
fn open_edges(vertices: &[Vector3<f64>], faces: &[Vec<usize>]) -> usize {
    let mut places: BTreeMap<[u64; 3], usize> = BTreeMap::new();
    // Adding zero makes -0 and 0 the same place.
    let place: Vec<usize> = vertices
        .iter()
        .map(|v| {
            let next = places.len();
            *places.entry([v.x, v.y, v.z].map(|part| (part + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for face in faces {
        for (n, corner) in face.iter().enumerate() {
            let (Some(a), Some(b)) = (place.get(*corner), place.get(face[(n + 1) % face.len()])) else { continue };
            if a != b {
                *edges.entry((*a.min(b), *a.max(b))).or_insert(0) += 1;
            }
        }
    }
    edges.values().filter(|count| **count != 2).count()
}

/// A path relative to the URDF; of a package path, the part behind the package's name, from the URDF's folder upwards.
fn locate(filename: &str, urdf: &Path) -> PathBuf {
    let folder = urdf.parent().unwrap_or(Path::new("."));
    let Some(inside) = filename.strip_prefix("package://") else { return folder.join(filename) };
    let inside = inside.split_once('/').map_or(inside, |(_, rest)| rest);
    let found = folder.ancestors().map(|up| up.join(inside)).find(|path| path.exists());
    found.unwrap_or_else(|| folder.join(inside))
}

fn text_vertices(bytes: &[u8], word: &str) -> Option<Vec<Vector3<f64>>> {
    let text = std::str::from_utf8(bytes).ok()?;
    text.lines()
        .map(str::split_whitespace)
        .filter_map(|mut words| (words.next() == Some(word)).then_some(words))
        .map(|words| {
            let numbers: Vec<f64> = words.take(3).map_while(|word| word.parse().ok()).collect();
            (numbers.len() == 3).then(|| Vector3::from_column_slice(&numbers))
        })
        .collect()
}

/// 80 bytes of header, a count, then 50 bytes a triangle: normal, three vertices, two bytes.
fn binary_stl(bytes: &[u8]) -> Option<Vec<Vector3<f64>>> {
    let count = u32::from_le_bytes(bytes.get(80..84)?.try_into().ok()?) as usize;
    let triangles = bytes.get(84..)?;
    if triangles.len() != 50 * count {
        return None;
    }
    let number = |at: &[u8]| at.try_into().ok().map(f32::from_le_bytes).map(f64::from);
    triangles
        .chunks_exact(50)
        .flat_map(|triangle| triangle[12..48].chunks_exact(12))
        .map(|vertex| Some(Vector3::new(number(&vertex[0..4])?, number(&vertex[4..8])?, number(&vertex[8..12])?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron is closed; without one face the three edges around the hole are open.
    #[test]
    fn open_edges_are_counted() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from);
        let faces = obj_faces(b"f 1 3 2\nf 1/1 2/2 4/4\nf 1//1 4//1 3//1\nf 2 3 4\n");
        assert_eq!(open_edges(&corners, &faces), 0);
        assert_eq!(open_edges(&corners, &faces[..3]), 3);
        let soup: Vec<Vector3<f64>> = faces.iter().flatten().map(|corner| corners[*corner]).collect();
        assert_eq!(open_edges(&soup, &triples(12)), 0);
    }

    /// Of a finely cut ball few points are left, and its hull is smaller by less than is allowed; a box keeps its corners.
    #[test]
    fn fine_meshes_are_thinned() {
        let ball: Vec<Point3<f64>> = directions(5000).map(|way| Point3::from(way * 0.012)).collect();
        let kept = thinned(ball.clone());
        assert!((100..1000).contains(&kept.len()), "{}", kept.len());
        let worst = directions(777).map(|way| {
            let reach = |points: &[Point3<f64>]| points.iter().map(|p| p.coords.dot(&way)).fold(0.0, f64::max);
            reach(&ball) - reach(&kept)
        });
        assert!(worst.fold(0.0, f64::max) <= THINNED);
        let side: Vec<f64> = (0..20).map(|n| 0.001 * f64::from(n)).collect();
        let grid: Vec<Point3<f64>> = side
            .iter()
            .flat_map(|x| side.iter().flat_map(move |y| [0.0, 0.01].map(|z| Point3::new(*x, *y, z))))
            .collect();
        let corners = thinned(grid);
        for (x, y, z) in [(0.0, 0.0, 0.0), (0.019, 0.0, 0.01), (0.019, 0.019, 0.0), (0.0, 0.019, 0.01)] {
            assert!(corners.iter().any(|p| (p - Point3::new(x, y, z)).norm() < 1e-9), "{x} {y} {z}");
        }
        assert!(corners.len() < 100, "{}", corners.len());
    }

    #[test]
    fn both_kinds_of_stl_and_obj_agree() {
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let mut binary = vec![0; 80];
        binary.extend(1u32.to_le_bytes());
        binary.extend([0; 12]);
        corners.iter().flatten().for_each(|x| binary.extend(x.to_le_bytes()));
        binary.extend([0; 2]);
        let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 2 0\nendloop\n";
        let obj = "v 0 0 0\nvn 0 0 1\nv 1 0 0\nv 0 2 0\nf 1 2 3\n";
        let expected = binary_stl(&binary).expect("binary");
        assert_eq!(text_vertices(stl.as_bytes(), "vertex").expect("text"), expected);
        assert_eq!(text_vertices(obj.as_bytes(), "v").expect("obj"), expected);
        assert!(binary_stl(stl.as_bytes()).is_none());
    }
}
