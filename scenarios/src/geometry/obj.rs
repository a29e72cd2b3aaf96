//! Meshes from Wavefront OBJ text: `v` and `f` lines; everything else is passed over.

use std::path::Path;

use hand_model::data::{DataError, read_text};
use nalgebra::Point3;

use super::mesh::{GeometryError, Mesh};

impl Mesh {
    /// Reads an OBJ file in metres. Faces with more than three corners are split into fans.
    pub fn read_obj(path: &Path) -> Result<Self, GeometryError> {
        Self::parse_obj(&read_text(path)?, path)
    }

    /// The same from text; `path` is used in errors.
    pub fn parse_obj(text: &str, path: &Path) -> Result<Self, GeometryError> {
        let (vertices, triangles) = parse_triangles(text, path)?;
        Self::new(vertices, triangles)
            .map_err(|source| GeometryError::File { path: path.into(), source: Box::new(source) })
    }
}

/// Vertices (m) and triangles.
type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// The vertices and triangles of an OBJ file, whether or not they close a surface.
pub fn read_triangles(path: &Path) -> Result<Triangles, GeometryError> {
    Ok(parse_triangles(&read_text(path)?, path)?)
}

fn parse_triangles(text: &str, path: &Path) -> Result<Triangles, DataError> {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (number, line) in text.lines().enumerate() {
        let fault = |found: String, expected: &str| DataError::Line {
            path: path.into(),
            line: number + 1,
            found,
            expected: expected.into(),
        };
        let mut words = line.split('#').next().unwrap_or_default().split_whitespace();
        match words.next() {
            Some("v") => {
                let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
                match numbers.as_deref() {
                    Some([x, y, z, ..]) => vertices.push(Point3::new(*x, *y, *z)),
                    _ => return Err(fault(format!("{line:?}"), "three numbers after v")),
                }
            }
            Some("f") => {
                let mut corners = Vec::new();
                for word in words {
                    corners.push(corner(word, vertices.len()).ok_or_else(|| {
                        fault(format!("corner {word:?}"), &format!("a vertex number from 1 to {}", vertices.len()))
                    })?);
                }
                if corners.len() < 3 {
                    return Err(fault(format!("{} corners", corners.len()), "at least 3 after f"));
                }
                triangles.extend((2..corners.len()).map(|n| [corners[0], corners[n - 1], corners[n]]));
            }
            _ => {}
        }
    }
    Ok((vertices, triangles))
}

/// Index of a corner written `7`, `7/1`, `7//3` or, counted from the end, `-1`.
fn corner(word: &str, vertices: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let index = if number < 0 { vertices as i64 + number } else { number - 1 };
    (0..vertices as i64).contains(&index).then_some(index as u32)
}
