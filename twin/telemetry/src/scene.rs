//! The 3D scene: meshes, logged once, and the poses that move them.

use std::collections::BTreeMap;

use hand_model::{Arm, Digit, Hand, RobotModel};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rerun::{Arrows3D, AsComponents, LineStrips3D, Mesh3D, RecordingStream, Transform3D};

use crate::entities;
use crate::error::TelemetryError;
use crate::hand_mesh::{self, COARSE_STEPS, Material, RigidPart};
use crate::mesh::{DrawnObject, Mesh};

/// Radii of the arm's links, m: base, then links 1 to 7.
const ARM_RADII: [f64; 8] = [0.050, 0.048, 0.046, 0.046, 0.042, 0.037, 0.037, 0.036];
const ARM_COLORS: [[u8; 3]; 2] = [[196, 200, 206], [150, 155, 163]];
const COVER_COLOR: [u8; 3] = [72, 76, 84];
const TABLE_COLOR: [u8; 3] = [126, 116, 104];
/// Half extents of the table and its centre, m, in front of the arm.
const TABLE_BOX: ([f64; 3], [f64; 3]) = ([0.5, 0.6, 0.02], [0.40, 0.0, -0.0205]);
const FORCE_COLOR: [u8; 3] = [255, 214, 10];
const OBJECT_FORCE_COLOR: [u8; 3] = [255, 70, 60];
/// Length of the arrow of a force of 1 N, m.
const METRES_PER_NEWTON: f64 = 0.005;
/// Tension at the end of the colour scale, N, and number of colours.
const TENSION_SCALE: (f64, u8) = (40.0, 16);
/// Radius of a drawn cable, m.
const CABLE_RADIUS: f32 = 0.0009;

/// Colours of the digits in all views: thumb, index, middle, ring, little.
pub const DIGIT_COLORS: [[u8; 3]; 5] = [[230, 85, 80], [240, 160, 50], [105, 185, 90], [80, 150, 230], [175, 115, 220]];
/// Colour of the palm and its parts.
pub const PALM_COLOR: [u8; 3] = [170, 170, 170];

/// Returns the colour of a hand link, by its digit; `None` is the palm.
pub fn link_color(hand: &Hand, link: Option<usize>) -> [u8; 3] {
    hand.digit_of(link).map_or(PALM_COLOR, |digit| DIGIT_COLORS[digit.index()])
}

/// Returns the name of the digit whose colour is given by `index`.
pub fn digit_name(index: usize) -> &'static str {
    Digit::ALL.get(index).map_or("palm", |digit| digit.name())
}

/// Converts a pose to Rerun's transform.
pub fn transform(pose: &Isometry3<f64>) -> Transform3D {
    let t: [f32; 3] = pose.translation.vector.cast::<f32>().into();
    let q = pose.rotation.coords.cast::<f32>();
    Transform3D::from_translation_rotation(t, rerun::Quaternion::from_xyzw([q.x, q.y, q.z, q.w]))
}

/// Returns a frame that moves with the palm and stays upright, with x towards the thumb's side. If the thumb points up
/// or down, it keeps the world's axes.
pub fn follow_frame(palm: &Isometry3<f64>) -> Isometry3<f64> {
    let thumb = palm * Vector3::x();
    let heading = if thumb.xy().norm() > 0.1 { thumb.y.atan2(thumb.x) } else { 0.0 };
    Isometry3::from_parts(palm.translation, UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading))
}

pub(crate) fn colored_mesh(mesh: &Mesh, [r, g, b]: [u8; 3], alpha: u8) -> Mesh3D {
    Mesh3D::new(mesh.vertices.iter().copied())
        .with_vertex_normals(mesh.normals.iter().copied())
        .with_triangle_indices(mesh.triangles.iter().copied())
        .with_albedo_factor(rerun::Rgba32::from_unmultiplied_rgba(r, g, b, alpha))
}

/// Logs everything whose shape does not change.
pub fn log_static(rec: &RecordingStream, robot: &RobotModel, objects: &[DrawnObject]) -> Result<(), TelemetryError> {
    rec.log_static(entities::WORLD, &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    rec.log_static(entities::TABLE, &colored_mesh(&table(), TABLE_COLOR, 255))?;
    log_arm(rec, &robot.arm)?;
    log_hand(rec, &robot.hand)?;
    for object in objects {
        rec.log_static(entities::object(&object.name), &colored_mesh(&object.mesh(), object.color, 255))?;
    }
    Ok(())
}

/// Returns the meshes of the arm: the base first, then each link in its frame. There are no mesh files for the arm; a
/// capsule runs from each joint to the next.
pub fn arm_parts(arm: &Arm) -> Vec<Mesh> {
    let joints = &arm.tree.joints;
    let to = |offset: &Isometry3<f64>| Point3::from(offset.translation.vector);
    let foot = Mesh::rounded_box(&Vector3::new(0.075, 0.075, 0.012), 0.006, &Isometry3::translation(0.0, 0.0, 0.012));
    let shoulder = joints.first().map_or(Point3::origin(), |first| to(&first.origin));
    let mut parts = vec![Mesh::capsule(Point3::new(0.0, 0.0, 0.03), shoulder, ARM_RADII[0]).merged(foot)];
    for k in 0..joints.len() {
        let end = joints.get(k + 1).map_or(&arm.last_from_tool, |joint| &joint.origin);
        let radius = ARM_RADII.get(k + 1).copied().unwrap_or(0.036);
        parts.push(Mesh::capsule(Point3::origin(), to(end), radius));
    }
    parts
}

/// Returns the table top, world frame.
pub fn table() -> Mesh {
    let (half, center) = TABLE_BOX;
    Mesh::rounded_box(&half.into(), 0.004, &Isometry3::translation(center[0], center[1], center[2]))
}

fn log_arm(rec: &RecordingStream, arm: &Arm) -> Result<(), TelemetryError> {
    let parts = arm_parts(arm);
    rec.log_static(entities::ARM_BASE, &colored_mesh(&parts[0], ARM_COLORS[1], 255))?;
    for (k, link) in parts[1..].iter().enumerate() {
        rec.log_static(entities::arm_link(k), &colored_mesh(link, ARM_COLORS[k % 2], 255))?;
    }
    Ok(())
}

fn material_color(material: Material) -> [u8; 3] {
    match material {
        Material::Palm | Material::Cover => COVER_COLOR,
        Material::Knuckle => [104, 109, 118],
        Material::Board => [30, 84, 58],
        Material::ServoPack => [52, 54, 60],
    }
}

/// Logs the meshes of each link, merged by material, below the path of the link.
fn log_parts(rec: &RecordingStream, hand: &Hand, path: impl Fn(Option<usize>) -> String) -> Result<(), TelemetryError> {
    let mut merged: BTreeMap<(Option<usize>, [u8; 3]), Mesh> = BTreeMap::new();
    for RigidPart { link, material, mesh } in hand_mesh::parts(hand, COARSE_STEPS) {
        let known = merged.entry((link, material_color(material))).or_default();
        *known = std::mem::take(known).merged(mesh);
    }
    for (n, ((link, color), mesh)) in merged.iter().enumerate() {
        rec.log_static(format!("{}/part_{n}", path(*link)), &colored_mesh(mesh, *color, 255))?;
    }
    Ok(())
}

/// Colour and opacity (alpha, of 255) of a reference model.
const REFERENCE_COLOR: ([u8; 3], u8) = ([60, 220, 255], 70);

/// Logs the reference model of hand and arm as static data: a tinted shell of each link.
pub(crate) fn log_reference_model(rec: &RecordingStream, robot: &RobotModel) -> Result<(), TelemetryError> {
    let RobotModel { hand, arm, .. } = robot;
    let (color, alpha) = REFERENCE_COLOR;
    for (k, link) in arm_parts(arm)[1..].iter().enumerate() {
        rec.log_static(entities::reference_arm_link(k), &colored_mesh(link, color, alpha))?;
    }
    let mut merged: BTreeMap<Option<usize>, Mesh> = BTreeMap::new();
    for RigidPart { link, mesh, .. } in hand_mesh::parts(hand, COARSE_STEPS) {
        let known = merged.entry(link).or_default();
        *known = std::mem::take(known).merged(mesh);
    }
    for (link, mesh) in &merged {
        let path = link.map_or_else(
            || format!("{}/palm", entities::REFERENCE_HAND),
            |link| entities::reference_hand_link(&hand.tree.joints[link].name),
        );
        rec.log_static(path, &colored_mesh(mesh, color, alpha))?;
    }
    Ok(())
}

/// Logs the hand alone below `root`, with its joints at `angles` (rad), as static data.
pub(crate) fn log_hand_at(
    rec: &RecordingStream,
    root: &str,
    hand: &Hand,
    angles: &[f64],
) -> Result<(), TelemetryError> {
    let links = hand.tree.forward(angles);
    let path = |link: Option<usize>| link.map_or(root.to_owned(), |n| format!("{root}/{}", hand.tree.joints[n].name));
    for (link, pose) in links.iter().enumerate() {
        rec.log_static(path(Some(link)), &transform(pose))?;
    }
    log_parts(rec, hand, path)?;
    rec.log_static(format!("{root}/cables"), &cable_lines(&hand_mesh::cables(hand, &links), &[0; 5]))?;
    for pad in &hand.pads {
        let mesh = colored_mesh(&hand_mesh::pad_sheet(pad), link_color(hand, pad.link), 255);
        let pose = transform(&pad.link_from_pad);
        let both: [&dyn AsComponents; 2] = [&mesh, &pose];
        rec.log_static(format!("{}/{}", path(pad.link), pad.name), &both)?;
    }
    Ok(())
}

fn log_hand(rec: &RecordingStream, hand: &Hand) -> Result<(), TelemetryError> {
    let name = |link: usize| hand.tree.joints[link].name.as_str();
    log_parts(rec, hand, |link| link.map_or(entities::HAND.to_owned(), |link| entities::hand_link(name(link))))?;
    for pad in &hand.pads {
        let mesh = colored_mesh(&hand_mesh::pad_sheet(pad), [255; 3], 255);
        let pose = transform(&pad.link_from_pad);
        let both: [&dyn AsComponents; 2] = [&mesh, &pose];
        rec.log_static(entities::pad(pad.link.map(name), &pad.name), &both)?;
    }
    Ok(())
}

/// Returns both runs of each cable (palm frame), coloured by tension steps.
pub fn cable_lines(runs: &[Vec<Point3<f64>>], steps: &[u8]) -> LineStrips3D {
    let strip =
        |run: &Vec<Point3<f64>>| run.iter().map(|p| <[f32; 3]>::from(p.coords.cast::<f32>())).collect::<Vec<_>>();
    LineStrips3D::new(runs.iter().map(strip)).with_radii([CABLE_RADIUS]).with_colors(colors_of_runs(steps))
}

/// Returns an update of the cables' colours only.
pub fn cable_colors(steps: &[u8]) -> LineStrips3D {
    LineStrips3D::update_fields().with_colors(colors_of_runs(steps))
}

fn colors_of_runs(steps: &[u8]) -> Vec<[u8; 3]> {
    steps.iter().flat_map(|step| [tension_color(f64::from(*step) / f64::from(TENSION_SCALE.1 - 1)); 2]).collect()
}

/// Quantizes a tension (N) to the steps of the colour scale.
pub fn tension_step(tension: f64) -> u8 {
    ((tension / TENSION_SCALE.0).clamp(0.0, 1.0) * f64::from(TENSION_SCALE.1 - 1)).round() as u8
}

/// Returns the colour of a tension, given as a share of the scale: blue without tension, over white to red.
pub fn tension_color(share: f64) -> [u8; 3] {
    const COLOR_SCALE: [[f64; 3]; 3] = [[70.0, 130.0, 230.0], [238.0, 232.0, 222.0], [230.0, 50.0, 40.0]];
    let x = 2.0 * share.clamp(0.0, 1.0);
    let below = (x as usize).min(1);
    let part = x - below as f64;
    std::array::from_fn(|i| (COLOR_SCALE[below][i] * (1.0 - part) + COLOR_SCALE[below + 1][i] * part) as u8)
}

/// Returns an update of the colours (RGBA) of a pad's sheet.
pub(crate) fn pad_colors(colors: Vec<u32>) -> Mesh3D {
    Mesh3D::update_fields().with_vertex_colors(colors)
}

/// Returns contact forces (N) as arrows at their points (m, world frame): on the hand, and between objects.
pub fn force_arrows(
    points: &[Point3<f64>],
    forces: &[Vector3<f64>],
    between: &[(Point3<f64>, Vector3<f64>)],
) -> Arrows3D {
    let on_hand = points.iter().zip(forces).map(|(point, force)| (*point, *force, FORCE_COLOR));
    let all = on_hand.chain(between.iter().map(|(point, force)| (*point, *force, OBJECT_FORCE_COLOR)));
    let all: Vec<_> = all.collect();
    Arrows3D::from_vectors(all.iter().map(|(_, f, _)| <[f32; 3]>::from((f * METRES_PER_NEWTON).cast::<f32>())))
        .with_origins(all.iter().map(|(p, ..)| <[f32; 3]>::from(p.coords.cast::<f32>())))
        .with_radii([0.0012f32])
        .with_colors(all.iter().map(|(.., color)| *color))
}
