//! Contact sheet of twenty known shapes pressed into a pad.

use anyhow::{Context, Result};
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use image::RgbImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::Serialize;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{Sensor, press};

use super::sensor_serial;

/// Shapes per row, and pixels between them.
const COLUMNS: usize = 5;
const TILE_GAP: usize = 4;

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
    let cell = IMAGE_SIZE + TILE_GAP;
    let rows = TEST_SHAPES.len().div_ceil(COLUMNS);
    let mut sheet = RgbImage::new((COLUMNS * cell) as u32, (rows * cell) as u32);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut list = Vec::new();
    for (n, (name, shape)) in TEST_SHAPES.iter().enumerate() {
        let pressed = press(pad, &[camera], &hand.gel(), force, |x, y| shape(x, y - camera.center_y))?;
        let rgb = sensor.render(&pressed.maps[0], &mut rng).rgb;
        let picture = RgbImage::from_raw(IMAGE_SIZE as u32, IMAGE_SIZE as u32, rgb).context("an image's size")?;
        image::imageops::replace(&mut sheet, &picture, (n % COLUMNS * cell) as i64, (n / COLUMNS * cell) as i64);
        let deepest_mm = 1e3 * f64::from(pressed.maps[0].max_depth());
        list.push(PressedShape { shape: name, force: pressed.force, deepest_mm });
    }
    Ok((sheet, list))
}
