//! Output files of a render.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use nalgebra::Vector3;

use crate::{exr, npy};

/// Views of one camera, row-major.
pub(super) struct Views {
    /// Numbers of columns and rows.
    pub size: [usize; 2],
    /// RGB image.
    pub image: Vec<u8>,
    /// Indentation of the gel along the cover's normals, m.
    pub depths: Vec<f32>,
    /// Unit normals out of the gel, pad frame: x, y, z of each pixel.
    pub normals: Vec<f32>,
}

impl Views {
    /// Writes image, indentation and normals as PNG, NPY and EXR. `white` is the indentation (m) shown white in the
    /// PNG.
    pub(super) fn write(&self, white: f32, out: &Path) -> Result<()> {
        let [width, height] = self.size;
        let (columns, rows) = (width as u32, height as u32);
        let beside = |ending: &str| -> PathBuf { out.with_extension(ending) };
        let save = |path: &Path, bytes: &[u8], color| {
            image::save_buffer(path, bytes, columns, rows, color).with_context(|| format!("--out {}", path.display()))
        };
        save(out, &self.image, image::ColorType::Rgb8)?;
        let greys: Vec<f32> = self.image.iter().map(|&value| f32::from(value) / 255.0).collect();
        npy::write(&beside("height.npy"), &self.depths, &[height, width])?;
        npy::write(&beside("normals.npy"), &self.normals, &[height, width, 3])?;
        npy::write(&beside("npy"), &greys, &[height, width, 3])?;
        let channel = |values: &[f32], c: usize| values.iter().skip(c).step_by(3).copied().collect::<Vec<f32>>();
        let colors = |values: &[f32]| [("R", channel(values, 0)), ("G", channel(values, 1)), ("B", channel(values, 2))];
        exr::write(&beside("exr"), width, &colors(&greys))?;
        exr::write(&beside("normals.exr"), width, &colors(&self.normals))?;
        exr::write(&beside("height.exr"), width, &[("Y", self.depths.clone())])?;
        let grey: Vec<u8> = self.depths.iter().map(|depth| (255.0 * depth / white).clamp(0.0, 255.0) as u8).collect();
        save(&beside("height.png"), &grey, image::ColorType::L8)?;
        let color: Vec<u8> = self.normals.iter().map(|value| (127.5 * (value + 1.0)) as u8).collect();
        save(&beside("normals.png"), &color, image::ColorType::Rgb8)
    }
}

/// Computes the normals of a surface at z = -`depth` (m) by central differences; `pixel` is the pixel size (dx, dy; m).
pub(super) fn normals(depth: &[f32], [width, height]: [usize; 2], pixel: (f64, f64)) -> Vec<f32> {
    let depth = |column: usize, row: usize| depth[row * width + column];
    let normal = |at: usize| {
        let (column, row) = (at % width, at / width);
        let (left, right) = (column.saturating_sub(1), (column + 1).min(width - 1));
        let (above, below) = (row.saturating_sub(1), (row + 1).min(height - 1));
        // Rows run against y; the normal points out of the gel.
        let across = (right - left).max(1) as f32 * pixel.0 as f32;
        let down = (below - above).max(1) as f32 * pixel.1 as f32;
        let zx = (depth(left, row) - depth(right, row)) / across;
        let zy = (depth(column, below) - depth(column, above)) / down;
        let normal = Vector3::new(-zx, -zy, 1.0).normalize();
        [normal.x, normal.y, normal.z]
    };
    (0..width * height).flat_map(normal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane whose depth grows by 0.1 to the right and by 0.2 upwards.
    #[test]
    fn a_tilted_plane_has_one_normal() {
        let pixel = (1e-4, 2e-4);
        let depth: Vec<f32> =
            (0..320 * 240).map(|at| (0.1 * 1e-4 * (at % 320) as f64 - 0.2 * 2e-4 * (at / 320) as f64) as f32).collect();
        let expected = Vector3::new(0.1f32, 0.2, 1.0).normalize();
        for found in normals(&depth, [320, 240], pixel).chunks_exact(3) {
            assert!((Vector3::from_column_slice(found) - expected).norm() < 1e-3, "{found:?}");
        }
    }
}
