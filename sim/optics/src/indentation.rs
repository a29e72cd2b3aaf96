//! Computation of an indentation map from the shape above a pad and the normal force.
//!
//! The penetration of a pixel is `Pad::surface_height(x, y) - z_object(x, y)`, pad frame, metres: positive where the
//! object, at its given height, would lie below the undeformed surface. The height that a rigid-body engine gives is not
//! physical, so the object is moved along the pad's z by the [`PressResult::shift`] at which the gel, a [`GelFoundation`], bears
//! the given force: the sum of the pressures under `penetration + shift`, times the pixels' area. The hand's own gel is a
//! Winkler foundation.

mod balance;

use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use hand_model::parameters::Gel;

use crate::error::{OpticsError, check_force, check_positive};
use crate::foundation::GelFoundation;
use crate::raster::Raster;
use balance::{ForceBalance, balance};

/// Number of pixels of a full-size map.
pub const PIXEL_COUNT: usize = IMAGE_SIZE * IMAGE_SIZE;
/// Largest spacing of the coarse pass of [`press`], pixels, and smallest number of blocks along a side.
const COARSE_BLOCK: (usize, usize) = (4, 32);

/// A rectangle of pixels, half open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rectangle {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl Rectangle {
    /// Returns the rectangle extended by `columns` and `rows` on each side, clipped to an image of `side` x `side`
    /// pixels.
    pub(crate) fn grown(&self, columns: usize, rows: usize, side: usize) -> Self {
        Self {
            left: self.left.saturating_sub(columns),
            top: self.top.saturating_sub(rows),
            right: (self.right + columns).min(side),
            bottom: (self.bottom + rows).min(side),
        }
    }

    /// Returns the rectangle extended to even columns and rows, so that cells of 2 x 2 pixels are aligned in all
    /// rectangles of an image of `side` x `side` pixels.
    pub(crate) fn even(&self, side: usize) -> Self {
        let up = |end: usize| end.next_multiple_of(2).min(side);
        Self { left: self.left & !1, top: self.top & !1, right: up(self.right), bottom: up(self.bottom) }
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }
}

/// Penetration of the object below a camera's undeformed surface, pixel by pixel (row-major, m; positive inside the
/// gel, negative infinity without an object).
#[derive(Debug, Clone, PartialEq)]
pub struct GapMap {
    side: usize,
    pixel_area: f64,
    penetration: Vec<f32>,
}

impl GapMap {
    /// Evaluates every pixel. `z_object(x, y)` is the lowest point (m, pad frame) of the object along the pad's z.
    pub fn sample(
        pad: &Pad,
        camera: &PadCamera,
        z_object: impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<Self, OpticsError> {
        Self::sample_on(pad, &Raster::full(camera), z_object)
    }

    fn sample_on(
        pad: &Pad,
        raster: &Raster,
        mut z_object: impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<Self, OpticsError> {
        let side = raster.side();
        let mut penetration = Vec::with_capacity(side * side);
        for row in 0..side {
            for column in 0..side {
                let (x, y) = raster.pixel_center(column, row);
                penetration.push(penetration_at(pad, x, y, &mut z_object)?);
            }
        }
        Ok(Self { side, pixel_area: pixel_area(raster)?, penetration })
    }

    /// Creates a map from given values, row-major, m.
    pub fn from_penetration(camera: &PadCamera, penetration: Vec<f32>) -> Result<Self, OpticsError> {
        check(&penetration, "a number below infinity", |value| value < f32::INFINITY)?;
        Ok(Self { side: IMAGE_SIZE, pixel_area: pixel_area(&Raster::full(camera))?, penetration })
    }

    /// Returns the values, row-major, m.
    pub fn penetration(&self) -> &[f32] {
        &self.penetration
    }
}

/// Depth of the pressed gel, pixel by pixel, from zero to the gel's thickness (m), inside the contact only.
///
/// ```
/// use tactile_optics::IndentationMap;
///
/// let mut depth = vec![0.0; 240 * 240];
/// depth[120 * 240 + 80] = 0.4e-3;
/// let map = IndentationMap::from_depth(depth)?;
/// assert_eq!((map.depth(80, 120), map.contact_pixels()), (0.4e-3, 1));
/// assert!(IndentationMap::from_depth(vec![f32::NAN; 240 * 240]).is_err());
/// # Ok::<(), tactile_optics::OpticsError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct IndentationMap {
    side: usize,
    depth: Vec<f32>,
    contact: Option<Rectangle>,
}

impl IndentationMap {
    /// Returns the map of an untouched pad.
    pub fn idle() -> Self {
        Self { side: IMAGE_SIZE, depth: Vec::new(), contact: None }
    }

    /// Creates a map from 240 x 240 depths (row-major, m), each finite and not negative.
    pub fn from_depth(depth: Vec<f32>) -> Result<Self, OpticsError> {
        check(&depth, "a finite depth of at least 0 m", |value| value >= 0.0 && value.is_finite())?;
        Ok(Self::of_depth(IMAGE_SIZE, depth))
    }

    fn of_depth(side: usize, depth: Vec<f32>) -> Self {
        let mut contact: Option<Rectangle> = None;
        for (row, line) in depth.chunks_exact(side).enumerate() {
            let Some(left) = line.iter().position(|&depth| depth > 0.0) else { continue };
            let right = line.iter().rposition(|&depth| depth > 0.0).unwrap_or(left) + 1;
            let old = contact.unwrap_or(Rectangle { left, top: row, right, bottom: row });
            contact = Some(Rectangle {
                left: old.left.min(left),
                top: old.top,
                right: old.right.max(right),
                bottom: row + 1,
            });
        }
        if contact.is_none() { Self::idle() } else { Self { side, depth, contact } }
    }

    /// Returns the number of pixels along a side of the map; an untouched pad's map fits any.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Returns the smallest rectangle that contains the contact; `None` for an untouched pad.
    pub fn contact(&self) -> Option<Rectangle> {
        self.contact
    }

    /// Combines two maps of the same side by their larger depth at every pixel, as for bodies that press side by side.
    #[must_use]
    pub fn pixelwise_max(&self, other: &Self) -> Self {
        let (Some(a), Some(b)) = (self.contact, other.contact) else {
            return if self.contact.is_some() { self.clone() } else { other.clone() };
        };
        let contact = Rectangle {
            left: a.left.min(b.left),
            top: a.top.min(b.top),
            right: a.right.max(b.right),
            bottom: a.bottom.max(b.bottom),
        };
        let depth = self.depth.iter().zip(&other.depth).map(|(a, b)| a.max(*b)).collect();
        Self { side: self.side, depth, contact: Some(contact) }
    }

    /// Returns the depth of a pixel, m.
    pub fn depth(&self, column: usize, row: usize) -> f32 {
        self.depth.get(row * self.side + column).copied().unwrap_or(0.0)
    }

    /// Copies the depths of a rectangle, row-major.
    pub(crate) fn crop(&self, rectangle: &Rectangle) -> Vec<f32> {
        if self.depth.is_empty() {
            return vec![0.0; rectangle.width() * rectangle.height()];
        }
        let mut cut = Vec::with_capacity(rectangle.width() * rectangle.height());
        self.rows(rectangle).for_each(|row| cut.extend_from_slice(row));
        cut
    }

    /// Iterates over the rows of a rectangle of a touched map.
    fn rows(&self, rectangle: &Rectangle) -> impl Iterator<Item = &[f32]> {
        let (left, right) = (rectangle.left, rectangle.right);
        self.depth.chunks_exact(self.side).take(rectangle.bottom).skip(rectangle.top).map(move |row| &row[left..right])
    }

    /// Returns the largest depth, m.
    pub fn max_depth(&self) -> f32 {
        let contact = self.contact.iter().flat_map(|contact| self.rows(contact));
        contact.flatten().copied().fold(0.0, f32::max)
    }

    /// Counts the pixels deeper than zero.
    pub fn contact_pixels(&self) -> usize {
        self.depth.iter().filter(|&&depth| depth > 0.0).count()
    }

    /// Returns 240 x 240 values, row-major, m.
    pub fn to_depths(&self) -> Vec<f32> {
        if self.depth.is_empty() { vec![0.0; PIXEL_COUNT] } else { self.depth.clone() }
    }
}

/// An object pressed into a pad.
#[derive(Debug, Clone, PartialEq)]
pub struct PressResult {
    /// Displacement of the object into the pad, m; negative if it was moved out.
    pub shift: f64,
    /// Force that the gel bears, N: the requested one, unless nothing is above the pad (0) or the gel is fully compressed.
    pub force: f64,
    /// One map per camera.
    pub maps: Vec<IndentationMap>,
}

/// Presses the object under `force` (N, along the pad's z) into a pad seen by `cameras` (all of the pad's, in order).
///
/// Evaluates `z_object` (see [`GapMap::sample`]) on every fourth pixel first and then only around the contact, so the
/// cost grows with the contact's area. Isolated parts of an object that are narrower than 4 pixels may be missed.
pub fn press(
    pad: &Pad,
    cameras: &[&PadCamera],
    gel: &Gel,
    force: f64,
    z_object: impl FnMut(f64, f64) -> Option<f64>,
) -> Result<PressResult, OpticsError> {
    press_on(pad, cameras, &GelFoundation::winkler(gel), force, z_object)
}

/// Like [`press`], on a gel with any pressure law.
pub fn press_on(
    pad: &Pad,
    cameras: &[&PadCamera],
    gel: &GelFoundation,
    force: f64,
    z_object: impl FnMut(f64, f64) -> Option<f64>,
) -> Result<PressResult, OpticsError> {
    let rasters: Vec<Raster> = cameras.iter().map(|camera| Raster::full(camera)).collect();
    press_rasters(pad, &rasters, gel, force, z_object)
}

/// Like [`press_on`], with maps on other pixels than the cameras' own. On coarser ones, the border of the contact and
/// the force are less accurate too.
pub fn press_rasters(
    pad: &Pad,
    rasters: &[Raster],
    gel: &GelFoundation,
    force: f64,
    mut z_object: impl FnMut(f64, f64) -> Option<f64>,
) -> Result<PressResult, OpticsError> {
    check_force(force)?;
    if force == 0.0 {
        return Ok(PressResult { shift: 0.0, force: 0.0, maps: vec![IndentationMap::idle(); rasters.len()] });
    }
    let mut coarse = Vec::with_capacity(rasters.len());
    for raster in rasters {
        coarse.push(Blocks::sample(pad, raster, &mut z_object)?);
    }
    let areas = coarse.iter().map(|blocks| (blocks.penetration.as_slice(), blocks.area));
    let Some(estimate) = balance(areas, gel, force)? else {
        let gaps: Result<Vec<_>, _> =
            rasters.iter().map(|raster| GapMap::sample_on(pad, raster, &mut z_object)).collect();
        return press_gaps_on(&gaps?, gel, force);
    };
    let empty = |raster: &Raster| {
        let side = raster.side();
        Ok(GapMap { side, pixel_area: pixel_area(raster)?, penetration: vec![f32::NEG_INFINITY; side * side] })
    };
    let mut gaps: Vec<GapMap> = rasters.iter().map(empty).collect::<Result<_, OpticsError>>()?;
    let mut reach = estimate.shift + 1e-5;
    loop {
        for ((raster, blocks), gap) in rasters.iter().zip(&mut coarse).zip(&mut gaps) {
            for block in 0..blocks.penetration.len() {
                if blocks.sampled[block] || !blocks.is_near_contact(block, -reach as f32) {
                    continue;
                }
                blocks.sampled[block] = true;
                for (column, row) in blocks.pixels(block) {
                    let (x, y) = raster.pixel_center(column, row);
                    gap.penetration[row * raster.side() + column] = penetration_at(pad, x, y, &mut z_object)?;
                }
            }
        }
        let found = balance(gaps.iter().map(|gap| (gap.penetration.as_slice(), gap.pixel_area)), gel, force)?;
        match found {
            Some(found) if found.shift > reach => reach = found.shift + 1e-5,
            Some(found) => return Ok(press_result(&gaps, gel, found)),
            None => return press_gaps_on(&gaps, gel, force),
        }
    }
}

/// Square blocks of pixels, each sampled at its centre.
struct Blocks {
    /// Number of pixels along a side of the image, and of a block.
    side: usize,
    block: usize,
    /// Number of blocks along a side.
    count: usize,
    /// Area of a block, m2.
    area: f64,
    /// Penetration at the blocks' centres, like that of a [`GapMap`], row-major.
    penetration: Vec<f32>,
    /// True for blocks whose pixels were sampled.
    sampled: Vec<bool>,
}

impl Blocks {
    fn sample(
        pad: &Pad,
        raster: &Raster,
        z_object: &mut impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<Self, OpticsError> {
        let (side, ((x0, y0), (dx, dy))) = (raster.side(), (raster.pixel_center(0, 0), raster.pixel_size()));
        let block = (side / COARSE_BLOCK.1).clamp(1, COARSE_BLOCK.0);
        let (count, middle) = (side.div_ceil(block), 0.5 * (block - 1) as f64);
        let mut penetration = Vec::with_capacity(count * count);
        for at in 0..count * count {
            let (column, row) = ((at % count * block) as f64 + middle, (at / count * block) as f64 + middle);
            penetration.push(penetration_at(pad, x0 + column * dx, y0 - row * dy, z_object)?);
        }
        let area = pixel_area(raster)? * (block * block) as f64;
        Ok(Self { side, block, count, area, penetration, sampled: vec![false; count * count] })
    }

    /// True if a block or one of its eight neighbours penetrates by more than `threshold`.
    fn is_near_contact(&self, block: usize, threshold: f32) -> bool {
        let (column, row) = (block % self.count, block / self.count);
        let around = |at: usize| at.saturating_sub(1)..(at + 2).min(self.count);
        around(row).any(|r| around(column).any(|c| self.penetration[r * self.count + c] > threshold))
    }

    /// Iterates over the columns and rows of a block's pixels.
    fn pixels(&self, block: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (left, top) = (block % self.count * self.block, block / self.count * self.block);
        let (right, bottom) = ((left + self.block).min(self.side), (top + self.block).min(self.side));
        (top..bottom).flat_map(move |row| (left..right).map(move |column| (column, row)))
    }
}

/// Like [`press`], from gap maps, one per camera of the pad.
pub fn press_gaps(gaps: &[GapMap], gel: &Gel, force: f64) -> Result<PressResult, OpticsError> {
    press_gaps_on(gaps, &GelFoundation::winkler(gel), force)
}

/// Like [`press_gaps`], on a gel with any pressure law.
pub fn press_gaps_on(gaps: &[GapMap], gel: &GelFoundation, force: f64) -> Result<PressResult, OpticsError> {
    check_force(force)?;
    let found = balance(gaps.iter().map(|gap| (gap.penetration.as_slice(), gap.pixel_area)), gel, force)?;
    match found {
        Some(balanced) if force > 0.0 => Ok(press_result(gaps, gel, balanced)),
        _ => Ok(PressResult { shift: 0.0, force: 0.0, maps: vec![IndentationMap::idle(); gaps.len()] }),
    }
}

fn press_result(gaps: &[GapMap], gel: &GelFoundation, balanced: ForceBalance) -> PressResult {
    let (shift, limit) = (balanced.shift as f32, gel.thickness as f32);
    let map = |gap: &GapMap| {
        let depth = gap.penetration.iter().map(|p| (p + shift).clamp(0.0, limit)).collect();
        IndentationMap::of_depth(gap.side, depth)
    };
    PressResult { shift: balanced.shift, force: balanced.force, maps: gaps.iter().map(map).collect() }
}

fn penetration_at(
    pad: &Pad,
    x: f64,
    y: f64,
    z_object: &mut impl FnMut(f64, f64) -> Option<f64>,
) -> Result<f32, OpticsError> {
    let Some(z) = z_object(x, y) else { return Ok(f32::NEG_INFINITY) };
    let penetration = (pad.surface_height(x, y) - z) as f32;
    if penetration.is_nan() || penetration == f32::INFINITY {
        // Report in the caller's coordinates: the pixel is not known here.
        return Err(OpticsError::Surface { x, y, z });
    }
    Ok(penetration)
}

fn check(map: &[f32], expected: &'static str, good: impl Fn(f32) -> bool) -> Result<(), OpticsError> {
    if map.len() != PIXEL_COUNT {
        return Err(OpticsError::MapSize { found: map.len(), expected: PIXEL_COUNT });
    }
    match map.iter().position(|&value| !good(value)) {
        None => Ok(()),
        Some(at) => {
            Err(OpticsError::MapValue { column: at % IMAGE_SIZE, row: at / IMAGE_SIZE, value: map[at], expected })
        }
    }
}

fn pixel_area(raster: &Raster) -> Result<f64, OpticsError> {
    let (dx, dy) = raster.pixel_size();
    check_positive("camera width", dx)?;
    check_positive("camera height", dy)?;
    Ok(dx * dy)
}
