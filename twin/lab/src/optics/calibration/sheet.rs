//! The presses with their circles, on one sheet.

use anyhow::{Context, Result};
use image::{Rgb, RgbImage};
use optics::calibration::{BallPress, Photo};
use report::picture::{text, tile};

const USED: [u8; 3] = [255, 255, 255];
const LEFT_OUT: [u8; 3] = [255, 40, 40];
/// Tiles in a row.
const COLUMNS: usize = 6;

/// A press, or an image without one, and what is to be said of it.
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
}

/// Draws the sheet.
pub fn draw(tiles: &[Tile]) -> Result<RgbImage> {
    let pictures: Result<Vec<RgbImage>> = tiles.iter().map(picture).collect();
    Ok(tile(&pictures?, COLUMNS))
}

fn picture(tile: &Tile) -> Result<RgbImage> {
    let (width, height) = (tile.photo.width as u32, tile.photo.height as u32);
    let mut image = RgbImage::from_raw(width, height, tile.photo.rgb.clone()).context("an image's size")?;
    let color = if tile.used { USED } else { LEFT_OUT };
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
    text(&mut image, 4, 4, &tile.name, color);
    text(&mut image, 4, i64::from(height) - 16, &tile.note, color);
    Ok(image)
}
