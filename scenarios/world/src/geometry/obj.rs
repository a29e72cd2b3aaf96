//! Reader of meshes from Wavefront OBJ text. It uses `v` and `f` lines and ignores everything else.

use std::path::Path;

use ftac_platform::data::DataError;
use nalgebra::Point3;

use super::mesh::{GeometryError, Mesh, Triangles};

impl Mesh {
    /// Parses an OBJ file's text, in metres. Faces with more than three corners are split into fans; `path` is named in
    /// errors.
    pub fn parse_obj(text: &str, path: &Path) -> Result<Self, GeometryError> {
        Self::parse_obj_in(text, 1.0, path)
    }

    /// Like [`Self::parse_obj`], with lengths in `unit`, m.
    pub fn parse_obj_in(text: &str, unit: f64, path: &Path) -> Result<Self, GeometryError> {
        let (mut vertices, triangles) = parse_triangles(text, path)?;
        vertices.iter_mut().for_each(|vertex| vertex.coords *= unit);
        Self::new(vertices, triangles)
            .map_err(|source| GeometryError::File { path: path.into(), source: Box::new(source) })
    }
}

/// Parses the vertices and triangles of an OBJ file's text, whether or not they form a closed surface.
pub(super) fn parse_triangles(text: &str, path: &Path) -> Result<Triangles, DataError> {
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
                    Some([x, y, z, ..]) if [x, y, z].iter().all(|part| part.is_finite()) => {
                        vertices.push(Point3::new(*x, *y, *z));
                    }
                    _ => return Err(fault(format!("{line:?}"), "three finite numbers after v")),
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

/// Parses the index of a corner written `7`, `7/1`, `7//3` or, counted from the end, `-1`.
fn corner(word: &str, vertices: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let index = if number < 0 { vertices as i64 + number } else { number - 1 };
    (0..vertices as i64).contains(&index).then_some(index as u32)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TETRAHEDRON: &str = "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

    #[test]
    fn a_vertex_that_is_nowhere_is_named() {
        for word in ["nan", "inf", "-inf"] {
            let text = TETRAHEDRON.replacen("v 0.05 0 0", &format!("v 0.05 {word} 0"), 1);
            let error = Mesh::parse_obj(&text, Path::new("thing.obj")).expect_err("refused").to_string();
            assert!(error.starts_with("thing.obj:2: found ") && error.contains("three finite numbers"), "{error}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        #[test]
        fn no_bytes_make_it_panic(at in 0usize..100, cut in 0usize..20, bytes in proptest::collection::vec(any::<u8>(), 0..8)) {
            let start = at % TETRAHEDRON.len();
            let end = (start + cut).min(TETRAHEDRON.len());
            let changed = [&TETRAHEDRON.as_bytes()[..start], &bytes, &TETRAHEDRON.as_bytes()[end..]].concat();
            let _ = Mesh::parse_obj(&String::from_utf8_lossy(&changed), Path::new("thing.obj"));
        }

        /// Numbers of any size, in any order.
        #[test]
        fn no_numbers_make_it_panic(numbers in proptest::collection::vec(any::<f64>(), 12), corners in proptest::collection::vec(-6i64..7, 12)) {
            let vertices: String = numbers.chunks(3).map(|v| format!("v {} {} {}\n", v[0], v[1], v[2])).collect();
            let faces: String = corners.chunks(3).map(|f| format!("f {} {} {}\n", f[0], f[1], f[2])).collect();
            let _ = Mesh::parse_obj(&(vertices.clone() + &faces), Path::new("thing.obj"));
            let _ = Mesh::parse_obj(&(vertices + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"), Path::new("thing.obj"));
        }
    }
}
