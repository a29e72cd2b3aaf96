//! Gallery of grasps: hands in rows, each with the object it holds, its contact points and their friction cones.

use hand_model::Hand;
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use rerun::log::ChunkBatcherConfig;
use rerun::{Arrows3D, Points3D, RecordingStream, TextDocument};

use crate::blueprint::{self, CameraViewpoint};
use crate::entities;
use crate::error::TelemetryError;
use crate::mesh::{DrawnObject, Mesh};
use crate::recorder::RecorderSettings;
use crate::scene::{colored_mesh, link_color, log_hand_at, transform};
use crate::sink::{OpenRecording, RecordingTarget};

/// Distance between neighbours, m.
const GRASP_PITCH: f64 = 0.26;
/// Height of a friction cone, m.
const CONE_HEIGHT: f64 = 0.012;
/// Sides of a cone.
const CONE_SIDES: u32 = 20;
/// Opacity of objects and of cones, of 255.
const OPACITIES: (u8, u8) = (150, 120);
/// Colour of a hand other than the gallery's own.
const OTHER_HAND_COLOR: [u8; 3] = [176, 182, 192];
const ARROW_COLOR: [u8; 3] = [255, 214, 10];
/// Length of the arrow of a force of 1 N, m.
const METRES_PER_NEWTON: f64 = 0.004;

/// A contact to be drawn, palm frame.
#[derive(Debug, Clone, Copy)]
pub struct GalleryContact {
    /// Link of the hand; `None` is the palm.
    pub link: Option<usize>,
    /// Contact point, m.
    pub point: Point3<f64>,
    /// Contact normal, into the object.
    pub normal: UnitVector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// A hand to be drawn.
#[derive(Debug, Clone)]
pub enum GalleryHand {
    /// The gallery's own hand, given by its joint angles, rad.
    Own(Vec<f64>),
    /// Another hand as a mesh in its posture, palm frame.
    Other(Mesh),
}

/// A grasp to be drawn.
#[derive(Debug, Clone)]
pub struct GalleryGrasp {
    /// Short name; also part of the entity path.
    pub name: String,
    /// Description, Markdown.
    pub text: String,
    pub hand: GalleryHand,
    /// Pose of the object in the palm frame.
    pub palm_from_object: Isometry3<f64>,
    pub contacts: Vec<GalleryContact>,
}

/// Returns the friction cone at a contact for friction coefficient `mu`: its apex is at the contact, and it opens along
/// the normal.
pub fn friction_cone(contact: &GalleryContact, mu: f64) -> Mesh {
    let axis = contact.normal.into_inner();
    let x = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    let y = axis.cross(&x);
    let mut mesh = Mesh::default();
    for side in 0..CONE_SIDES {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / f64::from(CONE_SIDES)).sin_cos();
        let out = x * cos + y * sin;
        let rim = contact.point.coords + (axis + out * mu) * CONE_HEIGHT;
        let normal = (out - axis * mu).normalize();
        for (place, normal) in [(contact.point.coords, normal), (rim, normal)] {
            mesh.vertices.push(place.cast::<f32>().into());
            mesh.normals.push(normal.cast::<f32>().into());
        }
        let next = (side + 1) % CONE_SIDES;
        mesh.triangles.push([2 * side, 2 * next + 1, 2 * side + 1]);
    }
    mesh
}

/// Writes `grasps` of one object to `targets`. `mu` is the friction coefficient of the drawn cones.
pub fn write(
    targets: &[RecordingTarget],
    hand: &Hand,
    object: &DrawnObject,
    mu: f64,
    grasps: &[GalleryGrasp],
) -> Result<(), TelemetryError> {
    let opened = OpenRecording::new(targets, ChunkBatcherConfig::DEFAULT)?;
    let rec = &opened.rec;
    let columns = (grasps.len() as f64).sqrt().ceil().max(1.0) as usize;
    let rows = grasps.len().div_ceil(columns);
    let center = Vector3::new(
        0.5 * GRASP_PITCH * (columns - 1) as f64,
        -0.5 * GRASP_PITCH * rows.saturating_sub(1) as f64,
        -0.02,
    );
    let away = 0.25 + 0.9 * GRASP_PITCH * columns.max(rows) as f64;
    let eye = center + Vector3::new(0.2, 0.15, -1.0).normalize() * away;
    let eye = CameraViewpoint { position: eye.cast::<f32>().into(), target: center.cast::<f32>().into() };
    blueprint::send_gallery(rec, eye)?;
    rec.log_static(entities::GALLERY, &rerun::ViewCoordinates::RIGHT_HAND_Y_UP())?;
    let gallery = Gallery { rec, hand, object, mu };
    let mut trace = format!("# {}: {} grasps\n", object.name, grasps.len());
    for (n, grasp) in grasps.iter().enumerate() {
        let place =
            Isometry3::translation(GRASP_PITCH * (n % columns) as f64, -GRASP_PITCH * (n / columns) as f64, 0.0);
        let root = entities::gallery(n, &grasp.name);
        gallery.show(&root, &place, grasp)?;
        trace += &format!("\n## {}. {}\n\n{}\n", n + 1, grasp.name, grasp.text);
    }
    rec.log_static(entities::GALLERY_TEXT, &TextDocument::from_markdown(trace))?;
    opened.close(RecorderSettings::default().flush_timeout)
}

/// Data common to all grasps of a gallery.
struct Gallery<'a> {
    rec: &'a RecordingStream,
    hand: &'a Hand,
    object: &'a DrawnObject,
    /// Friction coefficient of the drawn cones.
    mu: f64,
}

impl Gallery<'_> {
    /// Logs a grasp below `root`, with the hand's palm at `place`.
    fn show(&self, root: &str, place: &Isometry3<f64>, grasp: &GalleryGrasp) -> Result<(), TelemetryError> {
        let &Self { rec, hand, object, mu } = self;
        rec.log_static(root, &transform(place))?;
        let path = format!("{root}/hand");
        match &grasp.hand {
            GalleryHand::Own(joints) => log_hand_at(rec, &path, hand, joints)?,
            GalleryHand::Other(mesh) => rec.log_static(path, &colored_mesh(mesh, OTHER_HAND_COLOR, 255))?,
        }
        let name = format!("{root}/object");
        rec.log_static(name.as_str(), &transform(&grasp.palm_from_object))?;
        rec.log_static(name.as_str(), &colored_mesh(&object.mesh(), object.color, OPACITIES.0))?;
        let at = |contact: &GalleryContact| <[f32; 3]>::from(contact.point.coords.cast::<f32>());
        let color = |contact: &GalleryContact| link_color(hand, contact.link);
        let points = Points3D::new(grasp.contacts.iter().map(at)).with_radii([0.0018f32]);
        rec.log_static(format!("{root}/contacts"), &points.with_colors(grasp.contacts.iter().map(color)))?;
        let forces = grasp.contacts.iter().map(|contact| {
            <[f32; 3]>::from((contact.normal.into_inner() * contact.force * METRES_PER_NEWTON).cast::<f32>())
        });
        let arrows = Arrows3D::from_vectors(forces).with_origins(grasp.contacts.iter().map(at));
        rec.log_static(format!("{root}/forces"), &arrows.with_radii([0.0008f32]).with_colors([ARROW_COLOR]))?;
        for (n, contact) in grasp.contacts.iter().enumerate() {
            let cone = colored_mesh(&friction_cone(contact, mu), color(contact), OPACITIES.1);
            rec.log_static(format!("{root}/cones/{n}"), &cone)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every edge of a cone makes the friction angle with the normal, and its apex is at the contact.
    #[test]
    fn cones_open_by_the_friction_angle() {
        let normal = UnitVector3::new_normalize(Vector3::new(0.3, -0.5, 0.8));
        let contact = GalleryContact { link: None, point: Point3::new(0.01, 0.02, 0.03), normal, force: 1.0 };
        let cone = friction_cone(&contact, 0.6);
        for pair in cone.vertices.chunks(2) {
            let [tip, rim] = [pair[0], pair[1]].map(|v| Vector3::from(v).cast::<f64>());
            assert!((tip - contact.point.coords).norm() < 1e-6);
            assert!(((rim - tip).angle(&normal) - 0.6f64.atan()).abs() < 1e-4);
        }
        assert_eq!(cone.triangles.len(), CONE_SIDES as usize);
    }

    #[test]
    fn a_gallery_becomes_a_file() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("grasps.rrd");
        let hand = Hand::ftac();
        let object = DrawnObject { name: "thing".into(), ..DrawnObject::default() };
        let contact = GalleryContact { link: Some(2), point: Point3::origin(), normal: Vector3::z_axis(), force: 2.0 };
        let grasp = GalleryGrasp {
            name: "one".into(),
            text: "holds".into(),
            hand: GalleryHand::Own(vec![0.3; hand.tree.len()]),
            palm_from_object: Isometry3::identity(),
            contacts: vec![contact],
        };
        write(&[RecordingTarget::File(file.clone())], &hand, &object, 0.6, &[grasp.clone(), grasp]).expect("written");
        assert!(std::fs::metadata(&file).expect("there").len() > 10_000);
    }
}
