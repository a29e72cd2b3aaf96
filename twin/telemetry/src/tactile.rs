//! Tactile images, their changes and height maps, laid out as the opened hand: every camera in its place, enlarged
//! while its pad is touched.
//!
//! Recorded images are for display: JPEG, at half size, and an idle pad is logged once. Measurements must use the
//! original images.

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use hand_model::{Digit, Hand};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, RgbImage, imageops};
use rerun::{AsComponents, Boxes2D, EncodedImage, RecordingStream, Transform3D};

use crate::entities;
use crate::error::TelemetryError;
use crate::scene::{DIGIT_COLORS, link_color};

/// Spacing of neighbouring cells, across and down, in the units of the 2D views.
pub const CELL_SPACING: [f32; 2] = [200.0, 196.0];
/// Side of an image: of a touched pad, and of an untouched one.
pub const IMAGE_SIDES: [f32; 2] = [164.0, 84.0];
/// Room for the digits' names above the picture.
pub const HEADER_HEIGHT: f32 = 52.0;
/// Entity roots of the maps that share this layout.
const MAP_ROOTS: [&str; 3] = [entities::TACTILE, entities::CHANGES, entities::HEIGHTS];
/// Columns and rows of the picture.
pub const GRID_SIZE: [f32; 2] = [5.0, 4.0];
/// Change threshold of a channel value, in levels of 255; camera noise stays below it.
const CHANGE_THRESHOLD: u8 = 14;
/// Share of changed values from which an image counts as changed.
const CHANGED_SHARE: f64 = 5e-4;
/// Longest side of a drawn height map, pixels.
const MAX_HEIGHT_SIDE: usize = 80;

/// Returns column and row of a camera: fingers upwards, thumb on the left, palm below.
pub fn cell(hand: &Hand, camera: usize) -> Option<[f32; 2]> {
    let view = hand.cameras.get(camera)?;
    let pad = hand.pads.get(view.pad)?;
    Some(match pad.link {
        // The thumb is shorter and starts lower.
        Some(link) if link < 3 => [0.0, 3.0 - link as f32],
        Some(link) => [(link / 3) as f32, 2.0 - (link % 3) as f32],
        None if pad.cameras.len() == 1 => [1.0, 3.0],
        // The palm's large pad: its upper part first.
        None => [if view.center_y > 0.0 { 3.0 } else { 4.0 }, 3.0],
    })
}

/// Returns the upper left corner and the side of a camera's image.
fn image_place(hand: &Hand, camera: usize, active: bool) -> Option<[f32; 3]> {
    let [column, row] = cell(hand, camera)?;
    let side = IMAGE_SIDES[usize::from(!active)];
    Some([
        column * CELL_SPACING[0] + 0.5 * (CELL_SPACING[0] - side),
        row * CELL_SPACING[1] + HEADER_HEIGHT + 0.5 * (IMAGE_SIDES[0] - side),
        side,
    ])
}

/// Logs the names of the digits above their columns, once.
pub fn log_static(rec: &RecordingStream, hand: &Hand) -> Result<(), TelemetryError> {
    let columns = [0.0, 1.0, 2.0, 3.0, 4.0].map(|column| (column + 0.5) * CELL_SPACING[0]);
    let names = Digit::ALL.map(Digit::name);
    // The thumb starts lower.
    let rows = (0..hand.cameras.len()).filter_map(|camera| cell(hand, camera)).filter(|[column, _]| *column == 0.0);
    let top = rows.map(|[_, row]| row * CELL_SPACING[1]).fold(f32::INFINITY, f32::min);
    let points = columns.iter().enumerate().map(|(n, x)| [*x, if n == 0 && top.is_finite() { top } else { 0.0 }]);
    let heads = rerun::Points2D::new(points)
        .with_labels(names)
        .with_show_labels(true)
        .with_colors(DIGIT_COLORS)
        .with_radii([0.5f32]);
    for root in MAP_ROOTS {
        rec.log_static(format!("{root}/digits"), &heads)?;
    }
    Ok(())
}

/// Logs the placement of each image with a frame around it. Images of cameras for which `active` is true are large and
/// named. `side` is the size of tactile images in pixels, `change_side` that of the maps of changes.
pub fn log_cells(
    rec: &RecordingStream,
    hand: &Hand,
    (side, change_side): (usize, usize),
    active: impl Fn(usize) -> bool,
) -> Result<(), TelemetryError> {
    let (mut centers, mut halves, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    let (mut labelled, mut labels) = (Vec::new(), Vec::new());
    for (index, camera) in hand.cameras.iter().enumerate() {
        let Some([x, y, size]) = image_place(hand, index, active(index)) else { continue };
        rec.log(entities::tactile(&camera.name), &placement(x, y, size / side as f32))?;
        rec.log(entities::change(&camera.name), &placement(x, y, size / change_side as f32))?;
        centers.push([x + 0.5 * size, y + 0.5 * size]);
        halves.push([0.5 * size + 2.0; 2]);
        colors.push(link_color(hand, hand.pads[camera.pad].link));
        if active(index) {
            // A name hangs below its point.
            labelled.push([x + 0.5 * size, y + size - 14.0]);
            labels.push(camera.name.replace('_', " "));
        }
    }
    let frame = Boxes2D::from_centers_and_half_sizes(centers, halves)
        .with_colors(colors)
        .with_radii([1.0f32])
        .with_draw_order(50.0f32);
    let names = rerun::Points2D::new(labelled)
        .with_labels(labels)
        .with_show_labels(true)
        .with_radii([0.5f32])
        .with_draw_order(60.0f32);
    for root in MAP_ROOTS {
        rec.log(format!("{root}/frames"), &frame)?;
        rec.log(format!("{root}/names"), &names)?;
    }
    Ok(())
}

fn placement(x: f32, y: f32, scale: f32) -> Transform3D {
    Transform3D::from_translation_scale([x, y, 0.0], [scale, scale, 1.0])
}

/// Encodes a tactile image as JPEG, `side` pixels wide (never wider than the original).
pub fn encode(image: &TactileImage, side: usize, quality: u8) -> Result<Vec<u8>, String> {
    let size = IMAGE_SIZE as u32;
    let full = RgbImage::from_raw(size, size, image.rgb.clone())
        .ok_or_else(|| format!("{} bytes, expected {}", image.rgb.len(), IMAGE_SIZE * IMAGE_SIZE * 3))?;
    let side = side.clamp(1, IMAGE_SIZE) as u32;
    let small = if side == size { full } else { imageops::thumbnail(&full, side, side) };
    jpeg(&small, quality)
}

fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode(image.as_raw(), image.width(), image.height(), ExtendedColorType::Rgb8)
        .map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// Wraps the bytes of a JPEG as an archetype.
pub fn archetype(bytes: Vec<u8>) -> EncodedImage {
    EncodedImage::new(bytes).with_media_type(rerun::MediaType::JPEG)
}

/// True if two images differ by more than camera noise.
pub fn differ(a: &TactileImage, b: &TactileImage) -> bool {
    if a.rgb.len() != b.rgb.len() {
        return true;
    }
    let changed = a.rgb.iter().zip(&b.rgb).filter(|(a, b)| a.abs_diff(**b) > CHANGE_THRESHOLD).count();
    changed as f64 > CHANGED_SHARE * a.rgb.len() as f64
}

/// Renders a height map (m, row-major, `w` by `h`) in colour: black at 0, over violet and orange to light yellow at
/// `range` (m). Returns the JPEG and the transform that makes it fill the cell of `camera`.
pub fn height_image(
    hand: &Hand,
    camera: usize,
    heights: &[f32],
    [w, h]: [usize; 2],
    range: f32,
    quality: u8,
) -> Result<(Vec<u8>, impl AsComponents + use<>), String> {
    if w == 0 || h == 0 || heights.len() != w * h {
        return Err(format!("{} heights, expected {w} x {h}", heights.len()));
    }
    let step = w.max(h).div_ceil(MAX_HEIGHT_SIDE);
    let (columns, rows) = (w / step, h / step);
    let picture = RgbImage::from_fn(columns as u32, rows as u32, |i, j| {
        let (i, j) = (i as usize * step, j as usize * step);
        let cells = (0..step * step).map(|k| heights[(j + k / step) * w + i + k % step]);
        color(cells.sum::<f32>() / ((step * step) as f32 * range)).into()
    });
    let [x, y, side] = image_place(hand, camera, true).unwrap_or_default();
    let scale = side / columns.max(rows) as f32;
    let place = placement(x + 0.5 * (side - columns as f32 * scale), y + 0.5 * (side - rows as f32 * scale), scale);
    Ok((jpeg(&picture, quality)?, place))
}

/// Maps 0..1 to a colour scale from black to light yellow with uniformly growing lightness ("inferno", six support
/// points).
fn color(value: f32) -> [u8; 3] {
    const COLOR_SCALE: [[f32; 3]; 6] = [
        [0.0, 0.0, 4.0],
        [66.0, 10.0, 104.0],
        [147.0, 38.0, 103.0],
        [221.0, 81.0, 58.0],
        [252.0, 165.0, 10.0],
        [252.0, 255.0, 164.0],
    ];
    let x = if value.is_finite() { value.clamp(0.0, 1.0) * 5.0 } else { 0.0 };
    let below = (x as usize).min(4);
    let part = x - below as f32;
    std::array::from_fn(|i| (COLOR_SCALE[below][i] * (1.0 - part) + COLOR_SCALE[below + 1][i] * part).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> TactileImage {
        let n = IMAGE_SIZE;
        let value = |i: usize| [(i % n) as u8, (i / n) as u8, 128];
        TactileImage { rgb: (0..n * n).flat_map(value).collect() }
    }

    #[test]
    fn jpeg_round_trip() {
        let source = gradient();
        let bytes = encode(&source, IMAGE_SIZE, 85).expect("encodes");
        assert!(bytes.len() < 12_000, "{}", bytes.len());
        let back = image::load_from_memory(&bytes).expect("decodes").to_rgb8();
        assert_eq!((back.width(), back.height()), (240, 240));
        let error: f64 = back.as_raw().iter().zip(&source.rgb).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        assert!(error / (source.rgb.len() as f64) < 2.0, "mean error {}", error / source.rgb.len() as f64);
        let half = image::load_from_memory(&encode(&source, 120, 85).expect("encodes")).expect("decodes");
        assert_eq!((half.width(), half.height()), (120, 120));
        assert!(encode(&TactileImage { rgb: vec![0; 5] }, 120, 85).is_err());
    }

    #[test]
    fn noise_is_no_change_and_a_touch_is() {
        let idle = gradient();
        let mut noisy = idle.clone();
        noisy.rgb.iter_mut().enumerate().for_each(|(i, v)| *v = v.saturating_add((i * 7919 % 9) as u8));
        assert!(!differ(&idle, &noisy));
        let mut touched = idle.clone();
        for row in 100..110 {
            let start = (row * IMAGE_SIZE + 100) * 3;
            touched.rgb[start..start + 60].iter_mut().for_each(|v| *v = v.wrapping_add(60));
        }
        assert!(differ(&idle, &touched));
    }

    #[test]
    fn every_camera_has_a_cell_of_its_own() {
        let hand = Hand::ftac();
        let mut cells: Vec<[i32; 2]> =
            (0..hand.cameras.len()).map(|c| cell(&hand, c).expect("a cell").map(|x| x as i32)).collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(cells.len(), hand.cameras.len());
    }

    #[test]
    fn heights_are_checked_and_coloured() {
        assert_eq!(color(0.0), [0, 0, 4]);
        assert_eq!(color(2.0), [252, 255, 164]);
        assert_eq!(color(f32::NAN), [0, 0, 4]);
        let hand = Hand::ftac();
        assert!(height_image(&hand, 0, &[0.0; 10], [3, 3], 1e-3, 85).is_err());
        let (bytes, _) = height_image(&hand, 0, &vec![1e-3; 240 * 120], [240, 120], 1e-3, 90).expect("encodes");
        let image = image::load_from_memory(&bytes).expect("decodes").to_rgb8();
        assert_eq!((image.width(), image.height()), (80, 40));
        assert!(image.get_pixel(40, 20)[0] > 240);
    }
}
