//! The collision shapes of a URDF's links, in the frames of the joints that move them.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use urdf_rs::{Geometry, Link, Pose, Robot};

use super::meshes::{self, MeshTools};
use crate::hand_mechanism::{CollisionSolid, MeshSurface, SolidShape};
use crate::kinematics::pose_from_xyz_rpy;
use crate::urdf::numbers::check_shape;
use ftac_platform::data::DataError;

/// Distance between a mesh and its convex parts above which it is reported, m.
const REPORTED_PROTRUSION: f64 = 1e-3;

/// All shapes of a hand.
#[derive(Default)]
pub(crate) struct HandShapes {
    pub solids: Vec<CollisionSolid>,
    pub surfaces: Vec<MeshSurface>,
    pub links_without_collision: Vec<String>,
}

/// A shape with its pose and its name in the URDF.
struct Shape<'a> {
    geometry: &'a Geometry,
    origin: &'a Pose,
    element: String,
}

/// Returns the collision shapes of a link, or its visual ones.
fn link_shapes(link: &Link, visual: bool) -> Vec<Shape<'_>> {
    let name = &link.name;
    if visual {
        let shapes = link.visual.iter().enumerate();
        let named = shapes.map(|(n, own)| (&own.geometry, &own.origin, format!("link[{name}].visual[{n}]")));
        named.map(|(geometry, origin, element)| Shape { geometry, origin, element }).collect()
    } else {
        let shapes = link.collision.iter().enumerate();
        let named = shapes.map(|(n, own)| (&own.geometry, &own.origin, format!("link[{name}].collision[{n}]")));
        named.map(|(geometry, origin, element)| Shape { geometry, origin, element }).collect()
    }
}

/// Reads the shapes of all links. With `visuals`, a link without collision shapes uses its visual ones. This is always
/// done for a hand without any collision shape.
pub(crate) fn read(
    robot: &Robot,
    carried: &BTreeMap<String, (Option<usize>, Isometry3<f64>)>,
    path: &Path,
    visuals: bool,
    tools: MeshTools,
    notes: &mut Vec<String>,
) -> Result<HandShapes, DataError> {
    let mut known = meshes::MeshCache::new(tools);
    let mut shapes = HandShapes::default();
    let none = robot.links.iter().all(|link| link.collision.is_empty());
    let mut shown = Vec::new();
    for link in &robot.links {
        let Some((carrier, pose)) = carried.get(&link.name) else { continue };
        let visual = link.collision.is_empty() && !link.visual.is_empty() && (visuals || none);
        if visual {
            shown.push(link.name.as_str());
        } else if link.collision.is_empty() && (!link.visual.is_empty() || link.inertial.mass.value > 0.0) {
            shapes.links_without_collision.push(link.name.clone());
        }
        for Shape { geometry, origin, element } in link_shapes(link, visual) {
            check_shape(geometry, origin, element.clone(), path)?;
            let place = pose * pose_from_xyz_rpy(origin.xyz.0, origin.rpy.0);
            let solid =
                |shape| CollisionSolid { link: *carrier, link_name: link.name.clone(), link_from_solid: place, shape };
            let shape = match geometry {
                Geometry::Box { size } => SolidShape::Cuboid(0.5 * Vector3::from(size.0)),
                Geometry::Sphere { radius } => SolidShape::Sphere(*radius),
                Geometry::Cylinder { radius, length } => SolidShape::Cylinder(*radius, 0.5 * length),
                Geometry::Capsule { radius, length } => SolidShape::Capsule(*radius, 0.5 * length),
                Geometry::Mesh { filename, scale } => {
                    let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0));
                    let mesh = known.read(filename, &scale, path, &element)?;
                    let file = path.display();
                    if mesh.open_edges > 0 {
                        notes.push(format!(
                            "{file}: {element}.mesh: `{filename}` is not watertight ({} open edges); {} for it",
                            mesh.open_edges,
                            if mesh.parts.len() > 1 { "convex parts stand" } else { "its convex hull stands" }
                        ));
                    }
                    if mesh.protrusion > REPORTED_PROTRUSION {
                        notes.push(format!(
                            "{file}: {element}.mesh: the {} convex part{} of `{filename}` stand out of its surface by up to {:.1} mm",
                            mesh.parts.len(),
                            if mesh.parts.len() == 1 { "" } else { "s" },
                            1e3 * mesh.protrusion
                        ));
                    }
                    shapes.solids.extend(mesh.parts.iter().map(|part| solid(SolidShape::Hull(part.clone()))));
                    shapes.surfaces.push(MeshSurface {
                        link: *carrier,
                        link_name: link.name.clone(),
                        link_from_mesh: place,
                        triangles: mesh.triangles.clone(),
                        protrusion: mesh.protrusion,
                    });
                    continue;
                }
            };
            shapes.solids.push(solid(shape));
        }
    }
    add_notes(&shapes.links_without_collision, &shown, robot, path, notes);
    Ok(shapes)
}

/// Adds notes on links that collide with nothing, and on links whose visual shapes are used for collision.
fn add_notes(bare: &[String], shown: &[&str], robot: &Robot, path: &Path, notes: &mut Vec<String>) {
    let file = path.display();
    if !shown.is_empty() {
        notes.push(format!(
            "{file}: link.collision: none of {}; their visual shapes are taken for it",
            shown.join(", ")
        ));
    }
    if !bare.is_empty() {
        let visual =
            bare.iter().any(|name| robot.links.iter().any(|link| link.name == *name && !link.visual.is_empty()));
        let offer = if visual { "; `visuals = true` in the pulls file takes their visual shapes" } else { "" };
        notes.push(format!(
            "{file}: link.collision: none of {}; everything passes through them{offer}",
            bare.join(", ")
        ));
    }
}
