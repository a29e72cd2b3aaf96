//! Contact sheet of twenty known shapes pressed into a pad, each with its name above it.

use anyhow::{Context, Result};
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use image::RgbImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use report::lettering::{self, LINE_HEIGHT};
use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{Sensor, press};

use super::sensor_serial;

/// Shapes per row, and pixels between them.
const COLUMNS: usize = 5;
const TILE_GAP: usize = 4;
/// Height of the line with a shape's name, and the colour of its letters, on black.
const NAME_HEIGHT: usize = LINE_HEIGHT as usize + 4;
const NAME_COLOR: [u8; 3] = [235; 3];

/// A shape on the sheet.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct PressedShape {
    pub shape: &'static str,
    /// Normal force, N.
    pub force: f64,
    pub deepest_mm: f64,
}

/// Presses every shape into pad number `pad` of hand `unit` with `force` (N).
pub fn shape_sheet(hand: &Hand, pad: usize, force: f64, unit: u64, seed: u64) -> Result<(RgbImage, Vec<PressedShape>)> {
    let pad = &hand.pads[pad];
    let camera = &hand.cameras[pad.cameras[0]];
    let sensor = Sensor::unit(pad, camera, sensor_serial(hand, unit, camera));
    let [width, height] = [IMAGE_SIZE + TILE_GAP, NAME_HEIGHT + IMAGE_SIZE + TILE_GAP];
    let rows = TEST_SHAPES.len().div_ceil(COLUMNS);
    let mut sheet = RgbImage::new((COLUMNS * width) as u32, (rows * height) as u32);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut list = Vec::new();
    for (n, (name, shape)) in TEST_SHAPES.iter().enumerate() {
        let pressed = press(pad, &[camera], &hand.gel(), force, |x, y| shape(x, y - camera.center_y))?;
        let rgb = sensor.render(&pressed.maps[0], &mut rng).rgb;
        let picture = RgbImage::from_raw(IMAGE_SIZE as u32, IMAGE_SIZE as u32, rgb).context("an image's size")?;
        let [x, y] = [(n % COLUMNS * width) as i64, (n / COLUMNS * height) as i64];
        lettering::text(&mut sheet, (x + 4, y + 2), name, NAME_COLOR);
        image::imageops::replace(&mut sheet, &picture, x, y + NAME_HEIGHT as i64);
        let deepest_mm = 1e3 * f64::from(pressed.maps[0].max_depth());
        list.push(PressedShape { shape: name, force: pressed.force, deepest_mm });
    }
    Ok((sheet, list))
}
