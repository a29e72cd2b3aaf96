//! Output files of a reconstructed surface.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use ftac_platform::file::write_atomically;
use image::{ImageBuffer, ImageFormat, Luma, Rgb};
use schemars::JsonSchema;
use serde::Serialize;

use super::ply;
use super::surface::ReconstructedSurface;
use crate::{exr, npy};

/// Indentation per level of the 16-bit height image, m.
pub const HEIGHT_PER_LEVEL: f32 = 1e-7;

/// Grey level, in the mask of known pixels, of a pixel in contact whose colours or slopes are outside the range of the
/// calibration's presses; 255 means known, 0 no contact.
pub const OUT_OF_RANGE_GREY: u8 = 128;

/// Writes the surface of the image `name` into `folder`, and returns the files: height (NPY, EXR: m; PNG: 16 bits of
/// [`HEIGHT_PER_LEVEL`]), normals (NPY, EXR, PNG) with their expected error (NPY, degrees), contact mask (PNG), mask of
/// known pixels (PNG) and the points in contact (PLY). Heights outside the contact are unknown: NaN, or 0 in the PNG.
pub fn write(surface: &ReconstructedSurface, folder: &Path, name: &str) -> Result<Vec<PathBuf>> {
    let (width, height) = (surface.width, surface.height);
    let mut files = Vec::new();
    let mut at = |ending: &str| {
        let path = folder.join(format!("{name}.{ending}"));
        files.push(path.clone());
        path
    };
    let normals: Vec<f32> = (0..width * height).flat_map(|i| surface.normal(i)).collect();
    let channel = |c: usize| normals.iter().skip(c).step_by(3).copied().collect::<Vec<f32>>();
    npy::write(&at("height.npy"), &surface.depth, &[height, width])?;
    exr::write(&at("height.exr"), width, &[("Y", surface.depth.clone())])?;
    npy::write(&at("normals.npy"), &normals, &[height, width, 3])?;
    exr::write(&at("normals.exr"), width, &[("R", channel(0)), ("G", channel(1)), ("B", channel(2))])?;
    npy::write(&at("normals-error.npy"), &surface.normal_error, &[height, width])?;
    let levels =
        surface.depth.iter().map(|depth| (depth / HEIGHT_PER_LEVEL).round().clamp(0.0, 65535.0) as u16).collect();
    save(&at("height.png"), ImageBuffer::<Luma<u16>, Vec<u16>>::from_raw(width as u32, height as u32, levels))?;
    let colors = normals.iter().map(|part| (127.5 * (1.0 + part)).round() as u8).collect();
    save(&at("normals.png"), ImageBuffer::<Rgb<u8>, Vec<u8>>::from_raw(width as u32, height as u32, colors))?;
    let mask = surface.contact.iter().map(|inside| if *inside { 255 } else { 0 }).collect();
    save(&at("contact.png"), ImageBuffer::<Luma<u8>, Vec<u8>>::from_raw(width as u32, height as u32, mask))?;
    let known = surface.contact.iter().zip(&surface.beyond).map(|(inside, beyond)| match (inside, beyond) {
        (false, _) => 0,
        (true, true) => OUT_OF_RANGE_GREY,
        (true, false) => 255,
    });
    save(&at("known.png"), ImageBuffer::<Luma<u8>, Vec<u8>>::from_raw(width as u32, height as u32, known.collect()))?;
    let cloud = at("ply");
    write_atomically(&cloud, &ply::contact_points(surface)).with_context(|| cloud.display().to_string())?;
    Ok(files)
}

fn save<P>(path: &Path, image: Option<ImageBuffer<P, Vec<P::Subpixel>>>) -> Result<()>
where
    P: image::PixelWithColorType,
    [P::Subpixel]: image::EncodableLayout,
{
    let image = image.context("an image of the wrong size")?;
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).with_context(|| path.display().to_string())?;
    write_atomically(path, bytes.get_ref()).with_context(|| path.display().to_string())
}

/// Results for one image.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ImageFigures {
    /// Name of the image, or of the frame of a video.
    image: String,
    /// True if something presses the gel.
    touched: bool,
    #[serde(flatten)]
    surface: Option<SurfaceFigures>,
    wall_ms: f64,
}

/// Results for one surface.
#[derive(Debug, Serialize, JsonSchema)]
struct SurfaceFigures {
    /// Largest indentation, mm.
    depth_mm: Option<f64>,
    /// Expected error of the largest indentation, mm.
    depth_error_mm: Option<f64>,
    /// Share of the contact whose colours or slopes are outside the range of the calibration's presses.
    beyond_calibration: f64,
    /// Faults of the image or the surface.
    notes: Vec<String>,
    /// Contact area, mm2.
    contact_mm2: f64,
    /// Expected angular error of the normals in the contact (root mean square), degrees.
    normal_error_deg: f64,
}

impl ImageFigures {
    /// Creates the results of the image `name`, which took `wall_ms`. Without a surface the gel is untouched.
    pub fn new(name: &str, surface: Option<&ReconstructedSurface>, wall_ms: f64) -> Self {
        let figures = |surface: &ReconstructedSurface| SurfaceFigures {
            depth_mm: surface.deepest.map(|depth| 1e3 * depth),
            depth_error_mm: surface.depth_error.map(|error| 1e3 * error),
            beyond_calibration: surface.beyond_share(),
            notes: surface.notes.clone(),
            contact_mm2: 1e6 * surface.area(),
            normal_error_deg: mean_error(surface),
        };
        Self { image: name.to_owned(), touched: surface.is_some(), surface: surface.map(figures), wall_ms }
    }
}

/// Computes the root mean square of the normals' expected errors inside the contact, degrees.
pub fn mean_error(surface: &ReconstructedSurface) -> f64 {
    let inside = surface.normal_error.iter().zip(&surface.contact).filter(|(_, inside)| **inside);
    let (sum, count) =
        inside.fold((0.0, 0.0), |(sum, count), (error, _)| (sum + f64::from(*error).powi(2), count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}
