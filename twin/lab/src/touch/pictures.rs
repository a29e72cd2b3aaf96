//! Pictures of a held object as perceived by touch: a recording, and a sheet of the touched pads' images, normals and
//! heights.

use std::path::Path;

use anyhow::{Context, Result};
use bench::recording::drawn_object;
use bench::trial::{Bench, HeldGrasp};
use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE as N, PadCamera};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use report::lettering::text;
use tactile_perception::{ContactPatch, HeightMap, PadTouch};
use telemetry::RecordingTarget;
use telemetry::estimated_scene::EstimatedScene;

use super::images::CameraUnit;
use super::normals::normal_picture;
use super::poses::pose_difference;

/// Side of a picture on the sheet, and room for its name, pixels.
const PICTURE_SIDE: u32 = 150;
const NAME_HEIGHT: u32 = 14;
/// Cameras per row of the sheet.
const CAMERAS_PER_ROW: usize = 2;
/// Height that is drawn white, m.
const WHITE_HEIGHT: f32 = 1e-3;
const TEXT_COLOR: [u8; 3] = [235, 235, 235];
const PATCH_COLOR: [u8; 3] = [90, 230, 255];

/// Writes a recording and a sheet of the first grasp of each object into `folder`. Returns the number of objects.
pub fn write(bench: &Bench, detector: &CameraUnit, grasps: &[HeldGrasp], folder: &Path) -> Result<usize> {
    std::fs::create_dir_all(folder).with_context(|| format!("--out {}", folder.display()))?;
    let mut shown: Vec<&str> = Vec::new();
    for (n, grasp) in grasps.iter().enumerate() {
        if shown.contains(&grasp.object.as_str()) {
            continue;
        }
        shown.push(&grasp.object);
        let known = &bench.known_objects[&grasp.object];
        let frames = detector.render_images(grasp, &known.model.shape, bench.seed ^ (n as u64) << 20);
        let touches = bench.pipeline.perceive_frames(&frames, &[])?.touches;
        let estimate = bench.pipeline.estimate_pose(&touches, grasp.readings(&grasp.servos()), &grasp.prior, known)?;
        let hand = &bench.world.cell.robot.hand;
        let raw = |camera: usize| frames.iter().find(|frame| frame.camera == camera).map(|frame| &frame.image.rgb);
        let sheet = sheet(hand, &touches, raw);
        let path = |kind: &str| folder.join(format!("felt_{}.{kind}", grasp.object));
        sheet.save(path("png")).with_context(|| path("png").display().to_string())?;
        let [mm, deg] = pose_difference(&known.model, &estimate.palm_from_object, &grasp.truth);
        let [plan_mm, plan_deg] = pose_difference(&known.model, &grasp.prior.palm_from_object, &grasp.truth);
        let (sigma, turn) = estimate.sigma();
        let scene = EstimatedScene {
            text: format!(
                "# {}\nCombination {}, trial {}. Blue: pose estimate from touch; own colour: true pose.\n\n\
                 - touch: error {mm:.2} mm and {deg:.1} deg, stated standard deviation {:.2} mm and {:.1} deg\n\
                 - planned pose: error {plan_mm:.2} mm and {plan_deg:.1} deg\n- {} patches; {} other poses fit about as well; \
                 {} axes of rotation undetermined\n",
                grasp.object,
                grasp.combination,
                grasp.trial,
                1e3 * sigma,
                turn.to_degrees(),
                estimate.patches,
                estimate.alternatives.len(),
                estimate.unobservable.len()
            ),
            joints: estimate.q.to_vec(),
            object: drawn_object(&known.model, &grasp.object),
            estimate: estimate.palm_from_object,
            truth: grasp.truth,
            points: points(hand, &touches, &estimate.q),
            sheet,
        };
        telemetry::estimated_scene::write(&[RecordingTarget::File(path("rrd"))], hand, &scene)?;
    }
    Ok(shown.len())
}

type ContactPoints = Vec<(Option<usize>, nalgebra::Point3<f64>, nalgebra::Vector3<f64>)>;

/// Returns all contact points with normals, palm frame, at joint angles `q` (rad).
fn points(hand: &Hand, touches: &[PadTouch], q: &[f64]) -> ContactPoints {
    let places = hand.pad_poses(&hand.tree.forward(q));
    let of = |touch: &PadTouch| {
        let (link, place) = (hand.pads[touch.pad].link, places[touch.pad]);
        let points: Vec<_> = touch.patches.iter().flat_map(|patch| &patch.points).copied().collect();
        points.into_iter().map(move |p| (link, place * p.point, place * p.normal))
    };
    touches.iter().flat_map(of).collect()
}

/// Draws image, normals, and height with patches for every touched camera.
fn sheet<'a>(hand: &Hand, touches: &[PadTouch], raw: impl Fn(usize) -> Option<&'a Vec<u8>>) -> RgbImage {
    let felt: Vec<(&HeightMap, Vec<&ContactPatch>)> = touches
        .iter()
        .flat_map(|touch| touch.heights.iter().map(move |map| (touch, map)))
        .map(|(touch, map)| (&**map, touch.patches.iter().filter(|patch| patch.camera == map.camera).collect()))
        .collect();
    let rows = felt.len().div_ceil(CAMERAS_PER_ROW).max(1) as u32;
    let mut sheet = RgbImage::from_pixel(
        CAMERAS_PER_ROW as u32 * (3 * PICTURE_SIDE + 8),
        rows * (PICTURE_SIDE + NAME_HEIGHT + 4),
        Rgb([24, 26, 30]),
    );
    for (n, (map, patches)) in felt.iter().enumerate() {
        let (x, y) = (
            (n % CAMERAS_PER_ROW) as u32 * (3 * PICTURE_SIDE + 8),
            (n / CAMERAS_PER_ROW) as u32 * (PICTURE_SIDE + NAME_HEIGHT + 4),
        );
        let camera = &hand.cameras[map.camera];
        let force: f64 = patches.iter().map(|patch| patch.force).sum();
        let title = format!("{}  {} patches, {force:.1} N", camera.name, patches.len());
        text(&mut sheet, (i64::from(x) + 2, i64::from(y) + 1), &title, TEXT_COLOR);
        let pictures = [
            raw(map.camera).map(|rgb| rgb.to_vec()),
            Some(normal_picture(&map.gradients).to_vec()),
            Some(height_picture(camera, map, patches)),
        ];
        for (k, rgb) in pictures.into_iter().enumerate() {
            let Some(full) = rgb.and_then(|rgb| RgbImage::from_raw(N as u32, N as u32, rgb)) else { continue };
            let small = imageops::resize(&full, PICTURE_SIDE - 2, PICTURE_SIDE - 2, FilterType::Triangle);
            imageops::replace(&mut sheet, &small, i64::from(x + k as u32 * PICTURE_SIDE), i64::from(y + NAME_HEIGHT));
        }
    }
    sheet
}

/// Draws heights in grey, with an ellipse of two standard deviations around each patch.
fn height_picture(camera: &PadCamera, map: &HeightMap, patches: &[&ContactPatch]) -> Vec<u8> {
    let mut rgb: Vec<u8> =
        map.height.iter().flat_map(|height| [(255.0 * (height / WHITE_HEIGHT).clamp(0.0, 1.0)) as u8; 3]).collect();
    let ((x0, y0), (dx, dy)) = (camera.pixel_center(0, 0), camera.pixel_size());
    for patch in patches {
        for step in 0..720 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / 720.0).sin_cos();
            let out = 2.0 * (patch.axes[0] * (patch.extent[0] * cos) + patch.axes[1] * (patch.extent[1] * sin));
            let column = ((patch.centroid.x + out.x - x0) / dx).round();
            let row = ((y0 - patch.centroid.y - out.y) / dy).round();
            if (0.0..N as f64).contains(&column) && (0.0..N as f64).contains(&row) {
                let at = 3 * (row as usize * N + column as usize);
                rgb[at..at + 3].copy_from_slice(&PATCH_COLOR);
            }
        }
    }
    rgb
}
