//! Render of a mesh pressed into a calibrated real sensor.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tactile_optics::calibration::CalibratedSensor;
use world::geometry::Mesh;

use super::views::{Views, normals};
use super::{MeshPose, RAY_START, describe_contact};

/// True if the file is a sensor's calibration of `optics calibrate`, and not a pad's.
pub fn is_sensor(path: &Path) -> Result<bool> {
    /// The field that only a sensor's calibration has.
    #[derive(Deserialize)]
    struct Known {
        background: Option<toml::Value>,
    }
    let name = || format!("--sensor {}", path.display());
    let text = std::fs::read_to_string(path).with_context(name)?;
    let found: Known = toml::from_str(&text).with_context(name)?;
    Ok(found.background.is_some())
}

/// Render of a real sensor.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SensorRender {
    /// Image file (PNG).
    image: PathBuf,
    columns: usize,
    rows: usize,
    /// Number of pixels in contact.
    contact_pixels: usize,
    /// Depth of the mesh's lowest point below the untouched gel, mm.
    pub depth_mm: f64,
    /// Largest indentation, mm.
    deepest_mm: f64,
    /// True if the gel was compressed to its base before the requested depth was reached.
    pub bottomed_out: bool,
    /// Time of the render, ms.
    pub render_ms: f64,
}

impl SensorRender {
    /// Describes the written files in a line.
    pub fn text(&self) -> String {
        format!("{}: {}", self.image.display(), describe_contact(self.contact_pixels, self.deepest_mm))
    }
}

/// Presses a mesh into the sensor, its lowest point `depth` (m) below the untouched gel, and writes `out` with its
/// accompanying files. A gel of known `thickness` (m) is not pressed beyond its base. Returns a description of the
/// render.
pub fn render(
    sensor: &CalibratedSensor,
    (mesh, pose): (&Mesh, &MeshPose),
    depth: f64,
    thickness: Option<f64>,
    out: &Path,
) -> Result<SensorRender> {
    let (width, height) = sensor.size();
    let mesh_from_pad = pose.pad_from_mesh(mesh).inverse();
    let up = Unit::new_unchecked(mesh_from_pad * Vector3::z());
    let pressed = thickness.map_or(depth, |thickness| depth.min(thickness));
    let penetration: Vec<f32> = (0..width * height)
        .into_par_iter()
        .with_min_len(256)
        .map(|at| {
            let (x, y) = sensor.pixel_center((at % width) as f64, (at / width) as f64);
            let distance = mesh.ray(&(mesh_from_pad * Point3::new(x, y, -RAY_START)), &up);
            distance.map_or(f32::NEG_INFINITY, |distance| (pressed + RAY_START - distance) as f32)
        })
        .collect();
    let contact = penetration.iter().filter(|below| **below > 0.0).count();
    if contact == 0 {
        bail!("--pose: nothing touches the sensor; expected the mesh over it and a depth above 0");
    }
    let started = Instant::now();
    let image = sensor.render_raw(&penetration)?;
    let render_ms = 1e3 * started.elapsed().as_secs_f64();
    let gel = sensor.gel_depth(&penetration)?;
    let deepest = gel.iter().copied().fold(0.0, f32::max);
    let pixel = 1e-3 * sensor.calibration().pixel_mm;
    let normals = normals(&gel, [width, height], (pixel, pixel));
    Views { size: [width, height], image: image.rgb, depths: gel, normals }.write(deepest, out)?;
    Ok(SensorRender {
        image: out.to_owned(),
        columns: width,
        rows: height,
        contact_pixels: contact,
        depth_mm: 1e3 * pressed,
        deepest_mm: 1e3 * f64::from(deepest),
        bottomed_out: pressed < depth,
        render_ms,
    })
}
