//! Contact sheet of the presses with their circles.

use anyhow::{Context, Result};
use image::{Rgb, RgbImage};
use report::lettering::{LINE_HEIGHT, text, wrapped};
use report::picture::tile;
use tactile_optics::calibration::{BallPress, Photo, SkippedImage};

const USED_COLOR: [u8; 3] = [255, 255, 255];
const REJECTED_COLOR: [u8; 3] = [255, 40, 40];
/// Tiles per row.
const COLUMNS: usize = 6;
/// Distance of the text from the left edge, pixels.
const MARGIN: i64 = 4;

/// A press, or an image without one, with a note.
pub struct Tile {
    pub name: String,
    pub photo: Photo,
    /// Centre and radius, pixels.
    pub circle: Option<([f64; 2], f64)>,
    pub note: String,
    pub used: bool,
}

impl Tile {
    pub fn press(press: &BallPress, note: String, used: bool) -> Self {
        let circle = Some((press.center, press.radius));
        Self { name: press.name.clone(), photo: press.photo.clone(), circle, note, used }
    }

    /// Returns the tile of a rejected image; `None` if there is no image of the background's size.
    pub fn left_out(image: &SkippedImage) -> Option<Self> {
        let photo = image.photo.clone()?;
        let note = format!("left out: {}", image.reason);
        Some(Self { name: image.name.clone(), photo, circle: image.circle, note, used: false })
    }
}

/// Draws the sheet.
pub fn draw(tiles: &[Tile]) -> Result<RgbImage> {
    let pictures: Result<Vec<RgbImage>> = tiles.iter().map(picture).collect();
    Ok(tile(&pictures?, COLUMNS))
}

fn picture(tile: &Tile) -> Result<RgbImage> {
    let (width, height) = (tile.photo.width as u32, tile.photo.height as u32);
    let mut image = RgbImage::from_raw(width, height, tile.photo.rgb.clone()).context("an image's size")?;
    let color = if tile.used { USED_COLOR } else { REJECTED_COLOR };
    if let Some((center, radius)) = tile.circle {
        let steps = (8.0 * radius).ceil().max(16.0) as usize;
        for k in 0..steps {
            let (sin, cos) = (k as f64 / steps as f64 * std::f64::consts::TAU).sin_cos();
            let (x, y) = ((center[0] + radius * cos).round(), (center[1] + radius * sin).round());
            if (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y) {
                image.put_pixel(x as u32, y as u32, Rgb(color));
            }
        }
    }
    text(&mut image, (MARGIN, 2), &tile.name, color);
    let limit = (i64::from(width) - 2 * MARGIN) as f32;
    for (line, part) in wrapped(&tile.note, LINE_HEIGHT as f32, limit).iter().rev().enumerate() {
        text(&mut image, (MARGIN, i64::from(height) - LINE_HEIGHT * (line as i64 + 1)), part, color);
    }
    Ok(image)
}
