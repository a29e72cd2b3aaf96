//! Recording of one held object as perceived by touch: the contact points on the hand, the object at its estimated and
//! at its true pose, and beside them a sheet of raw images, normals and heights.

use hand_model::Hand;
use image::{ExtendedColorType, ImageEncoder, RgbImage, codecs::png::PngEncoder};
use nalgebra::{Isometry3, Point3, Vector3};
use rerun::log::ChunkBatcherConfig;
use rerun::{Arrows3D, EncodedImage, Points3D, TextDocument};

use crate::blueprint::{self, CameraViewpoint};
use crate::entities;
use crate::error::TelemetryError;
use crate::mesh::DrawnObject;
use crate::pose_estimate::ghost;
use crate::recorder::RecorderSettings;
use crate::scene::{colored_mesh, link_color, log_hand_at, transform};
use crate::sink::{OpenRecording, RecordingTarget};

/// Opacity of the true object, of 255.
const TRUTH_OPACITY: u8 = 70;
/// Drawn length of a contact normal, m.
const NORMAL_LENGTH: f32 = 0.006;

/// Content of the recording, palm frame.
#[derive(Debug, Clone)]
pub struct EstimatedScene {
    /// Description, Markdown.
    pub text: String,
    /// Estimated joint angles, rad.
    pub joints: Vec<f64>,
    pub object: DrawnObject,
    /// Estimated pose, `palm_from_object`.
    pub estimate: Isometry3<f64>,
    /// True pose, `palm_from_object`.
    pub truth: Isometry3<f64>,
    /// Perceived surface points with the object's outward normals, each with the link of its pad (`None`: the palm).
    pub points: Vec<(Option<usize>, Point3<f64>, Vector3<f64>)>,
    /// Sheet of images, normals and heights of the touched pads.
    pub sheet: RgbImage,
}

/// Writes a scene to `targets`.
pub fn write(targets: &[RecordingTarget], hand: &Hand, scene: &EstimatedScene) -> Result<(), TelemetryError> {
    let opened = OpenRecording::new(targets, ChunkBatcherConfig::DEFAULT)?;
    let rec = &opened.rec;
    let target = scene.estimate.translation.vector;
    let eye = target + Vector3::new(0.13, 0.06, -0.2);
    blueprint::send_estimated_scene(
        rec,
        CameraViewpoint { position: eye.cast::<f32>().into(), target: target.cast::<f32>().into() },
    )?;
    rec.log_static(entities::GALLERY, &rerun::ViewCoordinates::RIGHT_HAND_Y_UP())?;
    log_hand_at(rec, &format!("{}/hand", entities::GALLERY), hand, &scene.joints)?;
    for (name, pose, mesh) in [
        ("estimated", &scene.estimate, ghost(&scene.object, 0)),
        ("true", &scene.truth, colored_mesh(&scene.object.mesh(), scene.object.color, TRUTH_OPACITY)),
    ] {
        let path = format!("{}/{name}", entities::GALLERY);
        rec.log_static(path.as_str(), &transform(pose))?;
        rec.log_static(path.as_str(), &mesh)?;
    }
    let at = |p: &Point3<f64>| <[f32; 3]>::from(p.coords.cast::<f32>());
    let places = || scene.points.iter().map(|(_, point, _)| at(point));
    let colors = || scene.points.iter().map(|(link, _, _)| link_color(hand, *link));
    let cloud = Points3D::new(places()).with_radii([0.0011f32]).with_colors(colors());
    rec.log_static(format!("{}/felt", entities::GALLERY), &cloud)?;
    let normals = scene.points.iter().map(|(_, _, normal)| <[f32; 3]>::from(normal.cast::<f32>() * NORMAL_LENGTH));
    let arrows = Arrows3D::from_vectors(normals).with_origins(places()).with_colors(colors());
    rec.log_static(format!("{}/normals", entities::GALLERY), &arrows.with_radii([0.0003f32]))?;
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(scene.sheet.as_raw(), scene.sheet.width(), scene.sheet.height(), ExtendedColorType::Rgb8)
        .map_err(|error| TelemetryError::Image { what: "the sheet".into(), reason: error.to_string() })?;
    rec.log_static(entities::IMAGE_SHEET, &EncodedImage::new(png).with_media_type(rerun::MediaType::PNG))?;
    rec.log_static(entities::GALLERY_TEXT, &TextDocument::from_markdown(scene.text.clone()))?;
    opened.close(RecorderSettings::default().flush_timeout)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_becomes_a_file() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("felt.rrd");
        let hand = Hand::ftac();
        let scene = EstimatedScene {
            text: "felt".into(),
            joints: vec![0.3; hand.tree.len()],
            object: DrawnObject { name: "thing".into(), ..DrawnObject::default() },
            estimate: Isometry3::identity(),
            truth: Isometry3::translation(0.001, 0.0, 0.0),
            points: vec![(Some(2), Point3::origin(), Vector3::z())],
            sheet: RgbImage::new(48, 16),
        };
        write(&[RecordingTarget::File(file.clone())], &hand, &scene).expect("written");
        assert!(std::fs::metadata(&file).expect("there").len() > 10_000);
    }
}
