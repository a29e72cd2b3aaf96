//! Reader of triangles from mesh files: OBJ, STL, PLY, COLLADA, and glTF with its buffers in the file or beside it.
//!
//! STL repeats a corner for each triangle, and glTF a vertex for each texture seam. Vertices in the same place are
//! therefore merged, so that a closed surface is recognised as closed. In glTF, y points up; here, as in the other
//! formats, z does.

use std::collections::HashMap;
use std::path::Path;

use ftac_platform::data::DataError;
use ftac_platform::file::read_regular;
use ftac_platform::file_access::FileAccess;
use gltf::buffer::Source;
use nalgebra::{Matrix4, Point3};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};

use super::collada;
use super::mesh::{GeometryError, Mesh, Triangles};
use super::obj::parse_triangles;
use super::repair::RepairReport;

impl Mesh {
    /// Reads a mesh file of any of these formats, in metres, and mends its faults. Also returns a report of the
    /// repairs.
    pub fn load(path: &Path) -> Result<(Self, RepairReport), GeometryError> {
        let (vertices, triangles) = read_triangles(path)?;
        Self::repaired(&vertices, &triangles)
            .map_err(|source| GeometryError::File { path: path.into(), source: Box::new(source) })
    }
}

/// Greatest size of a mesh file, bytes.
const MAX_FILE_SIZE: u64 = 256 << 20;

/// Reads the vertices and triangles of a mesh file, whether or not they form a closed surface.
pub fn read_triangles(path: &Path) -> Result<Triangles, DataError> {
    let io = |source| DataError::Io { path: path.into(), source };
    let bytes = read_regular(path, MAX_FILE_SIZE).map_err(io)?;
    let extension = path.extension().and_then(|end| end.to_str()).unwrap_or_default().to_lowercase();
    match extension.as_str() {
        "obj" => {
            let text = String::from_utf8(bytes)
                .map_err(|error| DataError::field(path, "text", error, "a Wavefront OBJ file"))?;
            parse_triangles(&text, path)
        }
        "stl" => stl(&bytes, path),
        "ply" => ply(&bytes, path),
        "gltf" | "glb" => gltf(&bytes, path),
        "dae" => {
            let text = String::from_utf8(bytes)
                .map_err(|error| DataError::field(path, "text", error, "a COLLADA file in UTF-8"))?;
            weld_corners(collada::triangle_corners(&text, path)?.into_iter(), path)
        }
        _ => Err(DataError::field(path, "name", format!("`.{extension}`"), ".obj, .stl, .ply, .gltf, .glb or .dae")),
    }
}

/// Formats triangles as the text of a Wavefront OBJ file.
pub fn to_obj((vertices, triangles): &Triangles) -> String {
    let vertices = vertices.iter().map(|v| format!("v {} {} {}\n", v.x, v.y, v.z));
    let faces = triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(faces).collect()
}

fn stl(bytes: &[u8], path: &Path) -> Result<Triangles, DataError> {
    let scene =
        mesh_loader::stl::from_slice(bytes).map_err(|error| DataError::field(path, "text", error, "an STL file"))?;
    let corners = scene.meshes.iter().flat_map(|mesh| {
        mesh.faces.iter().map(|face| face.map(|n| Point3::from(mesh.vertices[n as usize]).cast::<f64>()))
    });
    weld_corners(corners, path)
}

fn ply(bytes: &[u8], path: &Path) -> Result<Triangles, DataError> {
    let fault = |field: &str, found: String, expected: &str| DataError::field(path, field, found, expected);
    let file = Parser::<DefaultElement>::new()
        .read_ply(&mut &*bytes)
        .map_err(|error| fault("text", error.to_string(), "a PLY file"))?;
    let elements = |name: &str| file.payload.get(name).map(Vec::as_slice).unwrap_or_default();
    let vertices: Vec<Point3<f64>> = (elements("vertex").iter().enumerate())
        .map(|(n, vertex)| {
            let part = |name: &str| vertex.get(name).and_then(number);
            part("x")
                .zip(part("y"))
                .zip(part("z"))
                .map(|((x, y), z)| Point3::new(x, y, z))
                .ok_or_else(|| fault(&format!("vertex {n}"), format!("{vertex:?}"), "x, y and z"))
        })
        .collect::<Result<_, _>>()?;
    let mut corners = Vec::new();
    for (n, face) in elements("face").iter().enumerate() {
        let indices = face.get("vertex_indices").or_else(|| face.get("vertex_index")).and_then(indices);
        let at =
            indices.and_then(|all| all.iter().map(|index| vertices.get(*index).copied()).collect::<Option<Vec<_>>>());
        let at = at.filter(|at| at.len() >= 3).ok_or_else(|| {
            let expected =
                format!("vertex_indices of three or more vertices from 0 to {}", vertices.len().saturating_sub(1));
            fault(&format!("face {n}"), format!("{face:?}"), &expected)
        })?;
        corners.extend((2..at.len()).map(|k| [at[0], at[k - 1], at[k]]));
    }
    weld_corners(corners.into_iter(), path)
}

fn number(property: &Property) -> Option<f64> {
    match property {
        Property::Float(value) => Some(f64::from(*value)),
        Property::Double(value) => Some(*value),
        Property::Int(value) => Some(f64::from(*value)),
        Property::Short(value) => Some(f64::from(*value)),
        _ => None,
    }
}

fn indices(property: &Property) -> Option<Vec<usize>> {
    match property {
        Property::ListInt(list) => list.iter().map(|index| usize::try_from(*index).ok()).collect(),
        Property::ListUInt(list) => list.iter().map(|index| usize::try_from(*index).ok()).collect(),
        Property::ListShort(list) => list.iter().map(|index| usize::try_from(*index).ok()).collect(),
        Property::ListUShort(list) => Some(list.iter().map(|index| usize::from(*index)).collect()),
        Property::ListUChar(list) => Some(list.iter().map(|index| usize::from(*index)).collect()),
        _ => None,
    }
}

fn gltf(bytes: &[u8], path: &Path) -> Result<Triangles, DataError> {
    let fault = |field: String, found: String, expected: &str| DataError::field(path, field, found, expected);
    let mut file =
        gltf::Gltf::from_slice(bytes).map_err(|error| fault("text".into(), error.to_string(), "a glTF 2.0 file"))?;
    let mut blob = file.blob.take();
    let buffers: Vec<Vec<u8>> = (file.buffers())
        .map(|buffer| match buffer.source() {
            Source::Bin => blob.take().ok_or_else(|| {
                fault(format!("buffers[{}]", buffer.index()), "no binary chunk".into(), "the chunk of a .glb file")
            }),
            Source::Uri(uri) if uri.starts_with("data:") => Err(fault(
                format!("buffers[{}].uri", buffer.index()),
                "data in the text".into(),
                "a file beside this one; or save it as .glb",
            )),
            Source::Uri(uri) => {
                let field = format!("buffers[{}].uri", buffer.index());
                let beside = FileAccess::in_folder_of(path).resolve(path, &field, Path::new(uri))?;
                read_regular(&beside, MAX_FILE_SIZE).map_err(|error| {
                    let found = format!("{}: {error}", beside.display());
                    fault(format!("buffers[{}].uri", buffer.index()), found, "a file beside this one")
                })
            }
        })
        .collect::<Result<_, _>>()?;
    let mut corners = Vec::new();
    let upright = Matrix4::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let mut open: Vec<(gltf::Node<'_>, Matrix4<f64>)> =
        file.scenes().flat_map(|scene| scene.nodes().map(|node| (node, upright)).collect::<Vec<_>>()).collect();
    let mut visited = vec![false; file.nodes().len()];
    while let Some((node, parent)) = open.pop() {
        // The format demands a tree: a node below itself would never end.
        if std::mem::replace(&mut visited[node.index()], true) {
            return Err(fault(format!("nodes[{}]", node.index()), "two parents".into(), "one parent at most"));
        }
        let place = parent * Matrix4::from(node.transform().matrix()).cast::<f64>();
        open.extend(node.children().map(|child| (child, place)));
        for primitive in node.mesh().into_iter().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let name = format!("meshes[{}]", node.mesh().map_or(0, |mesh| mesh.index()));
            if primitive.mode() != gltf::mesh::Mode::Triangles {
                return Err(fault(name, format!("{:?}", primitive.mode()), "triangles"));
            }
            let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
            let positions: Vec<Point3<f64>> = (reader.read_positions())
                .ok_or_else(|| fault(name.clone(), "no positions".into(), "the attribute POSITION"))?
                .map(|at| place.transform_point(&Point3::from(at).cast()))
                .collect();
            let order: Vec<u32> = match reader.read_indices() {
                Some(indices) => indices.into_u32().collect(),
                None => (0..positions.len() as u32).collect(),
            };
            for triangle in order.chunks_exact(3) {
                let at = |n: usize| positions.get(triangle[n] as usize).copied();
                let [a, b, c] = [at(0), at(1), at(2)];
                let Some(((a, b), c)) = a.zip(b).zip(c) else {
                    let expected = format!("indices below {}", positions.len());
                    return Err(fault(name, format!("{triangle:?}"), &expected));
                };
                corners.push([a, b, c]);
            }
        }
    }
    weld_corners(corners.into_iter(), path)
}

/// Builds an indexed mesh from the corners of triangles: corners in the same place become one vertex, and triangles
/// that thereby lose their area are dropped.
fn weld_corners(corners: impl Iterator<Item = [Point3<f64>; 3]>, path: &Path) -> Result<Triangles, DataError> {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let mut known: HashMap<[u64; 3], u32> = HashMap::new();
    for (n, corners) in corners.enumerate() {
        if let Some(corner) = corners.iter().find(|corner| corner.iter().any(|part| !part.is_finite())) {
            let found = format!("{:?}", corner.coords.as_slice());
            return Err(DataError::field(path, format!("triangle {n}"), found, "finite coordinates"));
        }
        let triangle = corners.map(|corner| {
            // Adding zero makes -0 and 0 the same place.
            let place = [corner.x, corner.y, corner.z].map(|part| (part + 0.0).to_bits());
            *known.entry(place).or_insert_with(|| {
                vertices.push(corner);
                vertices.len() as u32 - 1
            })
        });
        if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
            triangles.push(triangle);
        }
    }
    Ok((vertices, triangles))
}

#[cfg(test)]
mod tests;
