//! Reader of triangles from COLLADA files (.dae), as ROS robot descriptions use them.
//!
//! Coordinates are only scaled by the file's unit. As in ROS, the up axis is ignored.

use std::collections::HashMap;
use std::path::Path;

use ftac_platform::data::DataError;
use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

/// Limits: number of elements of a file, and depth of nodes above a geometry.
const MAX_ELEMENTS: u32 = 1_000_000;
const MAX_NODE_DEPTH: usize = 64;

/// Creates an error from element, value found, and value expected.
type ErrorFn<'a> = &'a dyn Fn(&str, String, &str) -> DataError;

/// Returns three corners per triangle, m.
pub fn triangle_corners(text: &str, path: &Path) -> Result<Vec<[Point3<f64>; 3]>, DataError> {
    let fault = |field: &str, found: String, expected: &str| DataError::field(path, field, found, expected);
    let options = ParsingOptions { nodes_limit: MAX_ELEMENTS, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)
        .map_err(|error| fault("text", error.to_string(), "a COLLADA file"))?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(fault("text", format!("<{}>", root.tag_name().name()), "<COLLADA>"));
    }
    let unit = named(&root, "asset").and_then(|asset| named(&asset, "unit")).and_then(|unit| unit.attribute("meter"));
    let unit = match unit {
        Some(text) => text
            .trim()
            .parse()
            .ok()
            .filter(|unit: &f64| unit.is_finite() && *unit > 0.0)
            .ok_or_else(|| fault("asset.unit.meter", format!("`{text}`"), "a positive number"))?,
        None => 1.0,
    };
    let ids: HashMap<&str, Node<'_, '_>> =
        document.descendants().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let mut found = Vec::new();
    for placed in placed_geometries(&document, &root, &ids, &fault)? {
        let (geometry, pose) = placed;
        let place = |point: Point3<f64>| Point3::from(pose.transform_point(&point).coords * unit);
        found.extend(geometry_corners(&geometry, &ids, &fault)?.into_iter().map(|corners| corners.map(place)));
    }
    Ok(found)
}

/// Returns the first child with this name.
fn named<'a, 'i>(node: &Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.tag_name().name() == name)
}

/// Returns the element that a reference such as `#id` names.
fn resolve_reference<'a, 'i>(
    node: &Node<'a, 'i>,
    attribute: &str,
    ids: &HashMap<&str, Node<'a, 'i>>,
    fault: ErrorFn<'_>,
) -> Result<Node<'a, 'i>, DataError> {
    let text = node.attribute(attribute).unwrap_or_default();
    text.strip_prefix('#').and_then(|id| ids.get(id)).copied().ok_or_else(|| {
        let field = format!("{}.{attribute}", node.tag_name().name());
        fault(&field, format!("`{text}`"), "`#` and the id of an element of this file")
    })
}

/// Returns geometries with their poses: those of the scene's nodes, or all geometries if there is no scene.
fn placed_geometries<'a, 'i>(
    document: &'a Document<'i>,
    root: &Node<'a, 'i>,
    ids: &HashMap<&str, Node<'a, 'i>>,
    fault: ErrorFn<'_>,
) -> Result<Vec<(Node<'a, 'i>, Matrix4<f64>)>, DataError> {
    let scene = named(root, "scene").and_then(|scene| named(&scene, "instance_visual_scene"));
    let Some(scene) = scene else {
        let all = document.descendants().filter(|node| node.tag_name().name() == "geometry");
        return Ok(all.map(|geometry| (geometry, Matrix4::identity())).collect());
    };
    let mut found = Vec::new();
    let mut open = vec![(resolve_reference(&scene, "url", ids, fault)?, Matrix4::identity(), 0)];
    while let Some((node, parent, depth)) = open.pop() {
        if depth > MAX_NODE_DEPTH {
            return Err(fault("node", format!("{depth} nodes above each other"), &format!("at most {MAX_NODE_DEPTH}")));
        }
        let mut pose = parent;
        for child in node.children().filter(Node::is_element) {
            pose *= match child.tag_name().name() {
                name @ ("matrix" | "translate" | "rotate" | "scale") => transform(&child, name, fault)?,
                _ => continue,
            };
        }
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => open.push((child, pose, depth + 1)),
                "instance_node" => open.push((resolve_reference(&child, "url", ids, fault)?, pose, depth + 1)),
                "instance_geometry" => found.push((resolve_reference(&child, "url", ids, fault)?, pose)),
                _ => {}
            }
        }
    }
    Ok(found)
}

fn transform(node: &Node<'_, '_>, name: &str, fault: ErrorFn<'_>) -> Result<Matrix4<f64>, DataError> {
    let values: Vec<f64> = numbers(node, fault)?;
    match (name, &values[..]) {
        ("matrix", all) if all.len() == 16 => Ok(Matrix4::from_row_slice(all)),
        ("translate", [x, y, z]) => Ok(Matrix4::new_translation(&Vector3::new(*x, *y, *z))),
        ("scale", [x, y, z]) => Ok(Matrix4::new_nonuniform_scaling(&Vector3::new(*x, *y, *z))),
        ("rotate", [x, y, z, degrees]) => {
            let axis = Unit::try_new(Vector3::new(*x, *y, *z), 1e-9);
            let turn = axis.map(|axis| Rotation3::from_axis_angle(&axis, degrees.to_radians()));
            Ok(turn.unwrap_or_else(Rotation3::identity).to_homogeneous())
        }
        _ => Err(fault(name, format!("{} numbers", values.len()), "16 of a matrix, 4 of a rotation, 3 of the others")),
    }
}

/// Returns the numbers in an element's text.
fn numbers<T: std::str::FromStr>(node: &Node<'_, '_>, fault: ErrorFn<'_>) -> Result<Vec<T>, DataError> {
    let words = node.text().unwrap_or_default().split_whitespace();
    words.map(|word| word.parse().map_err(|_| fault(node.tag_name().name(), format!("`{word}`"), "numbers"))).collect()
}

fn geometry_corners(
    geometry: &Node<'_, '_>,
    ids: &HashMap<&str, Node<'_, '_>>,
    fault: ErrorFn<'_>,
) -> Result<Vec<[Point3<f64>; 3]>, DataError> {
    let mut found = Vec::new();
    // Curves and other kinds of surfaces have no <mesh>.
    let Some(mesh) = named(geometry, "mesh") else { return Ok(found) };
    for primitive in mesh.children().filter(|node| {
        matches!(node.tag_name().name(), "triangles" | "polylist" | "polygons" | "tristrips" | "trifans")
    }) {
        let name = primitive.tag_name().name();
        let inputs: Vec<Node<'_, '_>> = primitive.children().filter(|node| node.tag_name().name() == "input").collect();
        let offset =
            |node: &Node<'_, '_>| node.attribute("offset").and_then(|text| text.parse::<usize>().ok()).unwrap_or(0);
        let stride = inputs.iter().map(offset).max().unwrap_or(0) + 1;
        let Some(vertex) = inputs.iter().find(|input| input.attribute("semantic") == Some("VERTEX")) else {
            return Err(fault(name, "no input VERTEX".into(), "one"));
        };
        let vertices = resolve_reference(vertex, "source", ids, fault)?;
        let position = vertices.children().find(|node| node.attribute("semantic") == Some("POSITION"));
        let Some(position) = position else { return Err(fault("vertices", "no input POSITION".into(), "one")) };
        let points = points(&resolve_reference(&position, "source", ids, fault)?, fault)?;
        let lists = primitive.children().filter(|node| node.tag_name().name() == "p");
        let counts: Option<Vec<usize>> = named(&primitive, "vcount").map(|node| numbers(&node, fault)).transpose()?;
        for list in lists {
            let indices: Vec<usize> = numbers(&list, fault)?;
            let own: Vec<usize> =
                indices.chunks(stride).filter_map(|chunk| chunk.get(offset(vertex)).copied()).collect();
            let at: Vec<Point3<f64>> = own
                .iter()
                .map(|index| {
                    points.get(*index).copied().ok_or_else(|| {
                        fault(&format!("{name}.p"), index.to_string(), &format!("an index below {}", points.len()))
                    })
                })
                .collect::<Result<_, _>>()?;
            match name {
                "triangles" => found.extend(at.chunks_exact(3).map(|three| [three[0], three[1], three[2]])),
                "polygons" | "trifans" => fan_triangles(&at, &mut found),
                "tristrips" => found.extend(at.windows(3).enumerate().map(|(n, three)| {
                    if n % 2 == 0 { [three[0], three[1], three[2]] } else { [three[1], three[0], three[2]] }
                })),
                _ => {
                    let mut rest = &at[..];
                    for count in counts.iter().flatten() {
                        let Some((polygon, after)) = rest.split_at_checked(*count) else {
                            let found = format!("{} corners left of {count}", rest.len());
                            return Err(fault("polylist.vcount", found, "as many corners as it counts"));
                        };
                        fan_triangles(polygon, &mut found);
                        rest = after;
                    }
                }
            }
        }
    }
    Ok(found)
}

/// Splits a polygon into triangles.
fn fan_triangles(at: &[Point3<f64>], found: &mut Vec<[Point3<f64>; 3]>) {
    found.extend((2..at.len()).map(|n| [at[0], at[n - 1], at[n]]));
}

/// Returns the points of a <source>.
fn points(source: &Node<'_, '_>, fault: ErrorFn<'_>) -> Result<Vec<Point3<f64>>, DataError> {
    let Some(array) = named(source, "float_array") else {
        return Err(fault("source", "no float_array".into(), "one"));
    };
    let accessor = named(source, "technique_common").and_then(|common| named(&common, "accessor"));
    let stride = accessor.and_then(|node| node.attribute("stride")).and_then(|text| text.parse().ok()).unwrap_or(3);
    if stride < 3 {
        return Err(fault("accessor.stride", stride.to_string(), "3 or more"));
    }
    let values: Vec<f64> = numbers(&array, fault)?;
    Ok(values
        .chunks(stride)
        .filter(|chunk| chunk.len() >= 3)
        .map(|chunk| Point3::new(chunk[0], chunk[1], chunk[2]))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r##"<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="millimeter" meter="0.001"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 10 0 0 10 20 0 0 20 0</float_array>
<technique_common><accessor source="#a" count="4" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#s" offset="1"/>
<vcount>4</vcount><p>0 0 1 0 2 0 3 0</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>0 0 5</translate>
<node><rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node><node><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"##;

    /// Every node places its own copy of a polygon, in metres, with unchanged axes.
    #[test]
    fn a_geometry_is_placed_by_every_node() {
        let found = triangle_corners(FILE, Path::new("tip.dae")).expect("read");
        assert_eq!(found.len(), 4);
        for place in [Point3::new(0.01, 0.02, 0.005), Point3::new(-0.02, 0.01, 0.005)] {
            assert!(found.iter().flatten().any(|corner| (corner - place).norm() < 1e-12), "{place}: {found:?}");
        }
    }

    #[test]
    fn faults_are_named() {
        let cases = [
            (FILE.replace("3 0</p>", "9 0</p>"), "polylist.p: found 9, expected an index below 4"),
            (FILE.replace("url=\"#g\"", "url=\"#h\""), "instance_geometry.url: found `#h`"),
            (FILE.replace("0.001", "-1"), "asset.unit.meter: found `-1`"),
            (FILE.replace("<vcount>4", "<vcount>5"), "polylist.vcount: found 4 corners left of 5"),
            (FILE.replace("0 0 0 10", "0 0 x 10"), "float_array: found `x`"),
            (FILE.replace("COLLADA", "X3D"), "text: found <X3D>, expected <COLLADA>"),
            (FILE.replace("</COLLADA>", ""), "text: found"),
        ];
        for (text, expected) in cases {
            let error = triangle_corners(&text, Path::new("tip.dae")).expect_err(expected).to_string();
            assert!(error.starts_with(&format!("tip.dae: {expected}")), "{error}\n{expected}");
        }
    }
}
