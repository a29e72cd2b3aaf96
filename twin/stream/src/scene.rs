//! The 3D scene: meshes, logged once, and the poses that move them.

use hand_model::{Arm, Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use rerun::{AsComponents, Mesh3D, RecordingStream, Transform3D};

use crate::entities;
use crate::error::StreamError;
use crate::mesh::{DrawnObject, Mesh};

/// Radii of the arm's links, m: base, then links 1 to 7.
const ARM_RADII: [f64; 8] = [0.050, 0.048, 0.046, 0.046, 0.042, 0.037, 0.037, 0.036];
const ARM_COLORS: [[u8; 3]; 2] = [[196, 200, 206], [150, 155, 163]];
const COVER_COLOR: [u8; 3] = [72, 76, 84];
const TABLE_COLOR: [u8; 3] = [126, 116, 104];
/// Half extents of the table and its centre: in front of the arm.
const TABLE: ([f64; 3], [f64; 3]) = ([0.5, 0.6, 0.02], [0.40, 0.0, -0.0205]);
const FORCE_COLOR: [u8; 3] = [255, 214, 10];
/// How transparent an estimate is drawn, and the colour it tends to.
const GHOST: ([u8; 3], u8) = ([60, 220, 255], 110);
/// Length of the arrow of a force of 1 N, m.
const METRES_PER_NEWTON: f64 = 0.02;

/// Colours of the digits in all views: thumb, index, middle, ring, little.
pub const DIGIT_COLORS: [[u8; 3]; 5] = [[230, 85, 80], [240, 160, 50], [105, 185, 90], [80, 150, 230], [175, 115, 220]];
/// Colour of what belongs to the palm.
pub const PALM_COLOR: [u8; 3] = [170, 170, 170];

/// Colour of a hand link, by its digit; `None` is the palm.
pub fn link_color(link: Option<usize>) -> [u8; 3] {
    link.map_or(PALM_COLOR, |link| DIGIT_COLORS.get(link / 3).copied().unwrap_or(PALM_COLOR))
}

/// Name of the digit whose colour is given by `index`.
pub fn digit_name(index: usize) -> &'static str {
    Digit::ALL.get(index).map_or("palm", |digit| digit.name())
}

/// A pose as Rerun's transform.
pub fn transform(pose: &Isometry3<f64>) -> Transform3D {
    let t: [f32; 3] = pose.translation.vector.cast::<f32>().into();
    let q = pose.rotation.coords.cast::<f32>();
    Transform3D::from_translation_rotation(t, rerun::Quaternion::from_xyzw([q.x, q.y, q.z, q.w]))
}

pub(crate) fn drawn(mesh: &Mesh, [r, g, b]: [u8; 3], alpha: u8) -> Mesh3D {
    Mesh3D::new(mesh.vertices.iter().copied())
        .with_vertex_normals(mesh.normals.iter().copied())
        .with_triangle_indices(mesh.triangles.iter().copied())
        .with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, alpha))
}

/// Logs everything that does not change its shape.
pub fn log_static(rec: &RecordingStream, hand: &Hand, arm: &Arm, objects: &[DrawnObject]) -> Result<(), StreamError> {
    rec.log_static(entities::WORLD, &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    let (half, center) = TABLE;
    let table = Mesh::rounded_box(&half.into(), 0.004, &Isometry3::translation(center[0], center[1], center[2]));
    rec.log_static(entities::TABLE, &drawn(&table, TABLE_COLOR, 255))?;
    log_arm(rec, arm)?;
    log_hand(rec, hand)?;
    for object in objects {
        rec.log_static(entities::object(&object.name), &drawn(&object.mesh(), object.color, 255))?;
    }
    Ok(())
}

/// The arm has no mesh files: a capsule runs from each joint to the next.
fn log_arm(rec: &RecordingStream, arm: &Arm) -> Result<(), StreamError> {
    let joints = &arm.tree.joints;
    let to = |offset: &Isometry3<f64>| Point3::from(offset.translation.vector);
    if let Some(first) = joints.first() {
        let foot =
            Mesh::rounded_box(&Vector3::new(0.075, 0.075, 0.012), 0.006, &Isometry3::translation(0.0, 0.0, 0.012));
        let base = Mesh::capsule(Point3::new(0.0, 0.0, 0.03), to(&first.origin), ARM_RADII[0]).and(foot);
        rec.log_static(entities::ARM_BASE, &drawn(&base, ARM_COLORS[1], 255))?;
    }
    for k in 0..joints.len() {
        let end = joints.get(k + 1).map_or(&arm.last_from_tool, |joint| &joint.origin);
        let radius = ARM_RADII.get(k + 1).copied().unwrap_or(0.036);
        let link = Mesh::capsule(Point3::origin(), to(end), radius);
        rec.log_static(entities::arm_link(k), &drawn(&link, ARM_COLORS[k % 2], 255))?;
    }
    Ok(())
}

fn cover(shape: &hand_model::hand::CoverShape) -> Mesh3D {
    drawn(&Mesh::rounded_box(&shape.half, shape.radius, &shape.link_from_cover), COVER_COLOR, 255)
}

/// The hand alone below `root`, with its joints at `angles` (rad), for good.
pub(crate) fn log_hand_at(rec: &RecordingStream, root: &str, hand: &Hand, angles: &[f64]) -> Result<(), StreamError> {
    let links = hand.tree.forward(angles);
    rec.log_static(root, &cover(&hand.palm_cover))?;
    let path = |link: usize| format!("{root}/{}", hand.tree.joints[link].name);
    for (link, shape) in hand.covers.iter().enumerate() {
        let (mesh, pose) = (cover(shape), transform(&links[link]));
        let both: [&dyn AsComponents; 2] = [&mesh, &pose];
        rec.log_static(path(link), &both)?;
    }
    for pad in &hand.pads {
        let sheet = Mesh::sheet(pad.w, pad.h, 7, 2.5e-4, |x, y| pad.surface_height(x, y));
        let mesh = drawn(&sheet, link_color(pad.link), 255);
        let pose = transform(&pad.link_from_pad);
        let both: [&dyn AsComponents; 2] = [&mesh, &pose];
        rec.log_static(format!("{}/{}", pad.link.map_or(root.to_owned(), path), pad.name), &both)?;
    }
    Ok(())
}

fn log_hand(rec: &RecordingStream, hand: &Hand) -> Result<(), StreamError> {
    // The servo pack fills the room between flange and palm.
    let pack = Isometry3::from(Vector3::from(hand.parameters.palm.servo_pack_com));
    let pack = drawn(&Mesh::rounded_box(&Vector3::new(0.036, 0.018, 0.028), 0.008, &pack), [52, 54, 60], 255);
    rec.log_static(entities::HAND, &cover(&hand.palm_cover))?;
    rec.log_static(format!("{}/servo_pack", entities::HAND), &pack)?;
    for (joint, shape) in hand.tree.joints.iter().zip(&hand.covers) {
        rec.log_static(entities::hand_link(&joint.name), &cover(shape))?;
    }
    for pad in &hand.pads {
        let sheet = Mesh::sheet(pad.w, pad.h, 7, 2.5e-4, |x, y| pad.surface_height(x, y));
        let link = pad.link.map(|link| hand.tree.joints[link].name.as_str());
        let mesh = drawn(&sheet, link_color(pad.link), 255);
        let pose = transform(&pad.link_from_pad);
        let both: [&dyn AsComponents; 2] = [&mesh, &pose];
        rec.log_static(entities::pad(link, &pad.name), &both)?;
    }
    Ok(())
}

/// The ghost that stands for an estimated pose.
pub fn ghost(object: &DrawnObject) -> Mesh3D {
    let (tint, alpha) = GHOST;
    let color = std::array::from_fn(|i| ((u16::from(object.color[i]) + 3 * u16::from(tint[i])) / 4) as u8);
    drawn(&object.mesh(), color, alpha)
}

/// Contact forces (N) as arrows at their points (m, world).
pub fn forces(points: &[Point3<f64>], forces: &[Vector3<f64>]) -> rerun::Arrows3D {
    let vectors = forces.iter().map(|f| <[f32; 3]>::from((f * METRES_PER_NEWTON).cast::<f32>()));
    rerun::Arrows3D::from_vectors(vectors)
        .with_origins(points.iter().take(forces.len()).map(|p| <[f32; 3]>::from(p.coords.cast::<f32>())))
        .with_radii([0.0015f32])
        .with_colors([FORCE_COLOR])
}
