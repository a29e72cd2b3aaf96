//! The gel around a contact: the soft-body approximation of the paper and of Taxim.
//!
//! Inside the contact the gel touches the object; outside it leaves the object gradually. The indentation is smoothed
//! repeatedly with ever narrower kernels ("pyramid Gaussian kernels"). After each pass the depth is raised to at least
//! the object's own, so that the gel never enters the object. Each kernel is three box filters in a row: a B-spline of
//! support 3 r to each side and standard deviation `sqrt(r (r + 1))` pixels. It is close to a Gaussian, exactly zero
//! beyond its support, and equally cheap at any width.

use hand_model::pads::{IMAGE_SIZE, PadCamera};
use serde::{Deserialize, Serialize};

use crate::indentation::{IndentationMap, Rectangle};
use crate::raster::Raster;
use crate::wide::{transpose, widest};

/// The smoothing of the gel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Elastomer {
    /// Standard deviations of the kernels (m), widest first.
    pub kernels: Vec<f64>,
    /// Thickness (m) of the layer between the object and the surface that the camera sees; the object is dilated by it.
    #[serde(default)]
    pub coating: f64,
}

impl Default for Elastomer {
    /// Returns kernels of about a third, a sixth, ... of the gel's 2.5 mm: the bulge decays within one or two gel
    /// thicknesses.
    fn default() -> Self {
        Self { kernels: vec![0.8e-3, 0.4e-3, 0.2e-3, 0.1e-3], coating: 0.0 }
    }
}

/// The deformed gel over a rectangle of pixels; beyond it the gel is flat.
#[derive(Debug, Clone, PartialEq)]
pub struct DeformedGel {
    /// The rectangle of pixels.
    pub rectangle: Rectangle,
    /// Depth below the undeformed surface (m), row-major over the rectangle.
    pub depth: Vec<f32>,
}

impl DeformedGel {
    /// Returns the depth of a pixel of the image, m.
    pub fn depth(&self, column: usize, row: usize) -> f32 {
        let r = &self.rectangle;
        if (r.left..r.right).contains(&column) && (r.top..r.bottom).contains(&row) {
            self.depth[(row - r.top) * r.width() + column - r.left]
        } else {
            0.0
        }
    }
}

impl Elastomer {
    /// Computes the deformed gel of an indentation map; `None` for an untouched pad.
    pub fn deform(&self, camera: &PadCamera, map: &IndentationMap) -> Option<DeformedGel> {
        self.deform_over(camera, map, 0.0)
    }

    /// Like [`Self::deform`], over a rectangle that reaches at least `reach` (m) beyond the contact.
    pub fn deform_over(&self, camera: &PadCamera, map: &IndentationMap, reach: f64) -> Option<DeformedGel> {
        let rectangle = self.rectangle(camera, map, reach)?;
        let pixel = Raster::with_side(camera, map.side()).pixel_size();
        let depth = self.smooth(map.crop(&rectangle), rectangle.width(), rectangle.height(), pixel);
        Some(DeformedGel { rectangle, depth })
    }

    /// Computes the rectangle over which [`Self::deform_over`] computes the gel; `None` for an untouched pad.
    pub(crate) fn rectangle(&self, camera: &PadCamera, map: &IndentationMap, reach: f64) -> Option<Rectangle> {
        let (dx, dy) = Raster::with_side(camera, map.side()).pixel_size();
        let least = ((reach / dx).ceil() as usize, (reach / dy).ceil() as usize);
        let margin = self.margin((dx, dy));
        Some(map.contact()?.grown(margin.0.max(least.0), margin.1.max(least.1), map.side()).even(map.side()))
    }

    /// Computes the reach of the smoothing beyond a contact, in columns and rows of pixels of this size (m).
    fn margin(&self, pixel: (f64, f64)) -> (usize, usize) {
        self.radii(pixel).iter().fold((1, 1), |(x, y), &(rx, ry)| (x + 3 * rx, y + 3 * ry))
    }

    /// Computes the box radii (columns, rows) of each kernel on pixels of this size (m).
    pub(crate) fn radii(&self, (dx, dy): (f64, f64)) -> Vec<(usize, usize)> {
        self.kernels.iter().map(|&deviation| (box_radius(deviation / dx), box_radius(deviation / dy))).collect()
    }

    /// Computes the gel's depth from the object's own depth (m, row-major, 0 outside it), on pixels of this size (m).
    pub fn smooth(&self, own: Vec<f32>, width: usize, height: usize, pixel: (f64, f64)) -> Vec<f32> {
        widest(
            #[inline(always)]
            || self.smoothing_passes(own, width, height, pixel),
        )
    }

    #[inline(always)]
    fn smoothing_passes(&self, own: Vec<f32>, width: usize, height: usize, pixel: (f64, f64)) -> Vec<f32> {
        let mut depth = own.clone();
        let mut other = vec![0.0; depth.len()];
        for (rx, ry) in self.radii(pixel) {
            for _ in 0..3 {
                box_filter(&depth, &mut other, width, height, ry);
                std::mem::swap(&mut depth, &mut other);
            }
            if rx > 0 {
                transpose(&depth, &mut other, width, height);
                for _ in 0..3 {
                    box_filter(&other, &mut depth, height, width, rx);
                    std::mem::swap(&mut depth, &mut other);
                }
                transpose(&other, &mut depth, height, width);
            }
            for (value, &own) in depth.iter_mut().zip(&own) {
                *value = value.max(own);
            }
        }
        depth
    }

    /// Dilates an object by the coating: its penetration (m, negative above the surface, negative infinity without an object)
    /// becomes that of its offset surface, moved back by the coating's thickness.
    pub fn dilate_by_coating(&self, penetration: &[f32], width: usize, height: usize, pixel: (f64, f64)) -> Vec<f32> {
        let t = self.coating;
        if t <= 0.0 {
            return penetration.to_vec();
        }
        let reach = ((t / pixel.0) as isize, (t / pixel.1) as isize);
        let mut cap = Vec::new();
        for down in -reach.1..=reach.1 {
            for across in -reach.0..=reach.0 {
                let left = t * t - (across as f64 * pixel.0).powi(2) - (down as f64 * pixel.1).powi(2);
                if left >= 0.0 {
                    cap.push((across, down, (left.sqrt() - t) as f32));
                }
            }
        }
        widest(
            #[inline(always)]
            || max_filter(penetration, width, height, &cap, -(t as f32)),
        )
    }
}

/// Computes the maximum of the values around each pixel, each lowered according to `cap` (column offset, row offset,
/// reduction). Values of at most `least` are left out, because they touch nothing even when dilated.
#[inline(always)]
fn max_filter(values: &[f32], width: usize, height: usize, cap: &[(isize, isize, f32)], least: f32) -> Vec<f32> {
    let mut grown = vec![f32::NEG_INFINITY; values.len()];
    let kept: Vec<f32> = values.iter().map(|value| if *value > least { *value } else { f32::NEG_INFINITY }).collect();
    // The columns that hold a value, row by row.
    let filled = |row: usize| {
        let line = &kept[row * width..(row + 1) * width];
        let any = |value: &f32| *value > f32::NEG_INFINITY;
        line.iter().position(any).zip(line.iter().rposition(any))
    };
    for (row, (first, last)) in (0..height).filter_map(|row| Some((row, filled(row)?))) {
        for &(across, down, lower) in cap {
            let to = row as isize + down;
            let from = first.max((-across).max(0) as usize);
            let end = (last + 1).min((width as isize - across).clamp(0, width as isize) as usize);
            if !(0..height as isize).contains(&to) || from >= end {
                continue;
            }
            let start = to as usize * width + from.wrapping_add_signed(across);
            let slots = &mut grown[start..start + end - from];
            for (slot, own) in slots.iter_mut().zip(&kept[row * width + from..row * width + end]) {
                *slot = slot.max(own + lower);
            }
        }
    }
    grown
}

/// Computes the radius (pixels) of the box filter that, applied three times, has about the standard deviation
/// `deviation` (pixels).
fn box_radius(deviation: f64) -> usize {
    let radius = (deviation * deviation + 0.25).sqrt() - 0.5;
    if radius.is_finite() { (radius.round().max(0.0) as usize).min(IMAGE_SIZE) } else { 0 }
}

/// Averages over `2 radius + 1` rows; beyond the border the border's row is repeated.
#[inline(always)]
fn box_filter(from: &[f32], to: &mut [f32], width: usize, height: usize, radius: usize) {
    if radius == 0 {
        to.copy_from_slice(from);
        return;
    }
    let row = |index: isize| {
        let index = index.clamp(0, height as isize - 1) as usize;
        &from[index * width..(index + 1) * width]
    };
    let radius = radius as isize;
    let scale = 1.0 / (2 * radius + 1) as f32;
    let mut sum = vec![0.0f32; width];
    for index in -radius..=radius {
        sum.iter_mut().zip(row(index)).for_each(|(sum, value)| *sum += value);
    }
    for (index, line) in to.chunks_exact_mut(width).enumerate() {
        let index = index as isize;
        let (enters, leaves) = (row(index + radius + 1), row(index - radius));
        for (((out, sum), enters), leaves) in line.iter_mut().zip(&mut sum).zip(enters).zip(leaves) {
            *out = *sum * scale;
            *sum += enters - leaves;
        }
    }
}
