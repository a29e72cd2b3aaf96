//! From the shape above a pad and the normal force to an indentation map.
//!
//! The penetration of a pixel is `Pad::surface_height(x, y) - z_object(x, y)`, pad frame, metres: positive where the
//! object, at its given height, would lie below the undeformed surface. The height that a rigid-body engine gives is not
//! physical, so the object is moved along the pad's z by the [`Press::shift`] at which the gel, a [`Foundation`], bears
//! the given force: the sum of the pressures under `penetration + shift`, times the pixels' area. The hand's own gel is a
//! Winkler foundation.

use hand_model::pads::{Camera, IMAGE_SIZE, Pad};
use hand_model::parameters::Gel;

use crate::error::{OpticsError, check_force, positive};
use crate::foundation::Foundation;

pub const PIXELS: usize = IMAGE_SIZE * IMAGE_SIZE;
/// Spacing of the coarse pass of [`press`], pixels.
const BLOCK: usize = 4;
const BLOCKS: usize = IMAGE_SIZE / BLOCK;

/// A rectangle of pixels, half open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rectangle {
    pub left: usize,
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl Rectangle {
    /// The rectangle extended by `columns` and `rows` on each side, clipped to the image.
    pub fn grown(&self, columns: usize, rows: usize) -> Self {
        Self {
            left: self.left.saturating_sub(columns),
            top: self.top.saturating_sub(rows),
            right: (self.right + columns).min(IMAGE_SIZE),
            bottom: (self.bottom + rows).min(IMAGE_SIZE),
        }
    }

    /// The rectangle extended to even columns and rows, so that cells of 2 x 2 pixels are aligned in all rectangles.
    pub(crate) fn even(&self) -> Self {
        let up = |end: usize| end.next_multiple_of(2).min(IMAGE_SIZE);
        Self { left: self.left & !1, top: self.top & !1, right: up(self.right), bottom: up(self.bottom) }
    }

    pub fn width(&self) -> usize {
        self.right - self.left
    }

    pub fn height(&self) -> usize {
        self.bottom - self.top
    }
}

/// How far the object lies below a camera's undeformed surface, pixel by pixel (row-major, m, positive is inside the gel,
/// negative infinity where there is no object).
#[derive(Debug, Clone, PartialEq)]
pub struct GapMap {
    pixel_area: f64,
    penetration: Vec<f32>,
}

impl GapMap {
    /// Evaluates every pixel. `z_object(x, y)` is the lowest point (m, pad frame) of the object along the pad's z.
    pub fn sample(
        pad: &Pad,
        camera: &Camera,
        mut z_object: impl FnMut(f64, f64) -> Option<f64>,
    ) -> Result<Self, OpticsError> {
        let mut penetration = Vec::with_capacity(PIXELS);
        for row in 0..IMAGE_SIZE {
            for column in 0..IMAGE_SIZE {
                let (x, y) = camera.pixel_center(column, row);
                penetration.push(penetration_at(pad, x, y, &mut z_object)?);
            }
        }
        Self::from_penetration(camera, penetration)
    }

    /// A map of given values, row-major, m.
    pub fn from_penetration(camera: &Camera, penetration: Vec<f32>) -> Result<Self, OpticsError> {
        check(&penetration, "a number below infinity", |value| value < f32::INFINITY)?;
        Ok(Self { pixel_area: pixel_area(camera)?, penetration })
    }

    /// Row-major, m.
    pub fn penetration(&self) -> &[f32] {
        &self.penetration
    }
}

/// How deep the gel is pressed in, pixel by pixel, from zero to the gel's thickness (m), inside the contact only.
#[derive(Debug, Clone, PartialEq)]
pub struct IndentationMap {
    depth: Vec<f32>,
    contact: Option<Rectangle>,
}

impl IndentationMap {
    /// The map of an untouched pad.
    pub fn idle() -> Self {
        Self { depth: Vec::new(), contact: None }
    }

    /// A map from 240 x 240 depths (row-major, m), each finite and not negative.
    pub fn from_depth(depth: Vec<f32>) -> Result<Self, OpticsError> {
        check(&depth, "a finite depth of at least 0 m", |value| value >= 0.0 && value.is_finite())?;
        let mut contact: Option<Rectangle> = None;
        for (row, line) in depth.chunks_exact(IMAGE_SIZE).enumerate() {
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
        Ok(if contact.is_none() { Self::idle() } else { Self { depth, contact } })
    }

    /// Smallest rectangle that holds the contact; `None` on an untouched pad.
    pub fn contact(&self) -> Option<Rectangle> {
        self.contact
    }

    /// The deeper of two maps at every pixel: what bodies that press side by side leave together.
    #[must_use]
    pub fn deeper(&self, other: &Self) -> Self {
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
        Self { depth, contact: Some(contact) }
    }

    /// Depth of a pixel, m.
    pub fn depth(&self, column: usize, row: usize) -> f32 {
        self.depth.get(row * IMAGE_SIZE + column).copied().unwrap_or(0.0)
    }

    /// The depths of a rectangle, row-major.
    pub(crate) fn cut(&self, rectangle: &Rectangle) -> Vec<f32> {
        if self.depth.is_empty() {
            return vec![0.0; rectangle.width() * rectangle.height()];
        }
        let rows = self.depth.chunks_exact(IMAGE_SIZE).take(rectangle.bottom).skip(rectangle.top);
        rows.flat_map(|row| &row[rectangle.left..rectangle.right]).copied().collect()
    }

    /// Largest depth, m.
    pub fn deepest(&self) -> f32 {
        self.depth.iter().copied().fold(0.0, f32::max)
    }

    pub fn contact_pixels(&self) -> usize {
        self.depth.iter().filter(|&&depth| depth > 0.0).count()
    }

    /// 240 x 240 values, row-major, m.
    pub fn to_depths(&self) -> Vec<f32> {
        if self.depth.is_empty() { vec![0.0; PIXELS] } else { self.depth.clone() }
    }
}

/// An object pressed into a pad.
#[derive(Debug, Clone, PartialEq)]
pub struct Press {
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
    cameras: &[&Camera],
    gel: &Gel,
    force: f64,
    z_object: impl FnMut(f64, f64) -> Option<f64>,
) -> Result<Press, OpticsError> {
    press_on(pad, cameras, &Foundation::winkler(gel), force, z_object)
}

/// As [`press`], on a gel with any pressure law.
pub fn press_on(
    pad: &Pad,
    cameras: &[&Camera],
    gel: &Foundation,
    force: f64,
    mut z_object: impl FnMut(f64, f64) -> Option<f64>,
) -> Result<Press, OpticsError> {
    check_force(force)?;
    if force == 0.0 {
        return Ok(Press { shift: 0.0, force: 0.0, maps: vec![IndentationMap::idle(); cameras.len()] });
    }
    let mut coarse = Vec::with_capacity(cameras.len());
    for camera in cameras {
        let ((x0, y0), (dx, dy)) = (camera.pixel_center(0, 0), camera.pixel_size());
        let middle = 0.5 * (BLOCK - 1) as f64;
        let mut map = Vec::with_capacity(BLOCKS * BLOCKS);
        for block in 0..BLOCKS * BLOCKS {
            let (column, row) = ((block % BLOCKS * BLOCK) as f64 + middle, (block / BLOCKS * BLOCK) as f64 + middle);
            map.push(penetration_at(pad, x0 + column * dx, y0 - row * dy, &mut z_object)?);
        }
        coarse.push((map, pixel_area(camera)? * (BLOCK * BLOCK) as f64));
    }
    let Some(estimate) = balance(coarse.iter().map(|(map, area)| (map.as_slice(), *area)), gel, force)? else {
        let gaps: Result<Vec<_>, _> = cameras.iter().map(|camera| GapMap::sample(pad, camera, &mut z_object)).collect();
        return press_gaps_on(&gaps?, gel, force);
    };
    let mut gaps: Vec<GapMap> = coarse
        .iter()
        .map(|(_, area)| GapMap {
            pixel_area: area / (BLOCK * BLOCK) as f64,
            penetration: vec![f32::NEG_INFINITY; PIXELS],
        })
        .collect();
    let mut seen = vec![false; BLOCKS * BLOCKS * cameras.len()];
    let mut reach = estimate.shift + 1e-5;
    loop {
        for ((index, camera), (map, _)) in cameras.iter().enumerate().zip(&coarse) {
            for block in 0..BLOCKS * BLOCKS {
                let flag = index * BLOCKS * BLOCKS + block;
                if seen[flag] || !near(map, block, -reach as f32) {
                    continue;
                }
                seen[flag] = true;
                for pixel in 0..BLOCK * BLOCK {
                    let (column, row) =
                        (block % BLOCKS * BLOCK + pixel % BLOCK, block / BLOCKS * BLOCK + pixel / BLOCK);
                    let (x, y) = camera.pixel_center(column, row);
                    gaps[index].penetration[row * IMAGE_SIZE + column] = penetration_at(pad, x, y, &mut z_object)?;
                }
            }
        }
        let found = balance(gaps.iter().map(|gap| (gap.penetration.as_slice(), gap.pixel_area)), gel, force)?;
        match found {
            Some(found) if found.shift > reach => reach = found.shift + 1e-5,
            Some(found) => return finish(&gaps, gel, found),
            None => return press_gaps_on(&gaps, gel, force),
        }
    }
}

/// As [`press`], from gap maps, one per camera of the pad.
pub fn press_gaps(gaps: &[GapMap], gel: &Gel, force: f64) -> Result<Press, OpticsError> {
    press_gaps_on(gaps, &Foundation::winkler(gel), force)
}

/// As [`press_gaps`], on a gel with any pressure law.
pub fn press_gaps_on(gaps: &[GapMap], gel: &Foundation, force: f64) -> Result<Press, OpticsError> {
    check_force(force)?;
    let found = balance(gaps.iter().map(|gap| (gap.penetration.as_slice(), gap.pixel_area)), gel, force)?;
    match found {
        Some(balanced) if force > 0.0 => finish(gaps, gel, balanced),
        _ => Ok(Press { shift: 0.0, force: 0.0, maps: vec![IndentationMap::idle(); gaps.len()] }),
    }
}

fn finish(gaps: &[GapMap], gel: &Foundation, balanced: Balanced) -> Result<Press, OpticsError> {
    let (shift, limit) = (balanced.shift as f32, gel.thickness as f32);
    let maps: Result<Vec<_>, _> = gaps
        .iter()
        .map(|gap| IndentationMap::from_depth(gap.penetration.iter().map(|p| (p + shift).clamp(0.0, limit)).collect()))
        .collect();
    Ok(Press { shift: balanced.shift, force: balanced.force, maps: maps? })
}

/// Whether a block or one of its eight neighbours penetrates by more than `threshold`.
fn near(map: &[f32], block: usize, threshold: f32) -> bool {
    let (column, row) = (block % BLOCKS, block / BLOCKS);
    (row.saturating_sub(1)..(row + 2).min(BLOCKS))
        .any(|r| (column.saturating_sub(1)..(column + 2).min(BLOCKS)).any(|c| map[r * BLOCKS + c] > threshold))
}

/// Step (m) of the finite difference for the slope of a pressure law.
const NUDGE: f64 = 1e-8;

struct Balanced {
    shift: f64,
    force: f64,
}

/// Solves the force balance by bracketed Newton iteration; `None` where nothing is above the pad.
fn balance<'a>(
    maps: impl Iterator<Item = (&'a [f32], f64)>,
    gel: &Foundation,
    force: f64,
) -> Result<Option<Balanced>, OpticsError> {
    gel.check()?;
    let winkler = gel.exponent == 1.0 && gel.hardening == 0.0;
    let stiffness = gel.modulus / gel.thickness;
    let maps: Vec<(Vec<f32>, f64)> =
        maps.map(|(map, area)| (map.iter().copied().filter(|p| p.is_finite()).collect(), area)).collect();
    let all = || maps.iter().flat_map(|(map, _)| map);
    let (deepest, shallowest) =
        all().fold((f32::NEG_INFINITY, f32::INFINITY), |(most, least), &p| (most.max(p), least.min(p)));
    if !deepest.is_finite() {
        return Ok(None);
    }
    let limit = gel.thickness as f32;
    let evaluate = |shift: f64| {
        let shift = shift as f32;
        maps.iter().fold((0.0, 0.0), |(force, slope), (map, area)| {
            if !winkler {
                let bears = |shift: f64| area * map.iter().map(|&p| gel.pressure(f64::from(p) + shift)).sum::<f64>();
                let found = bears(f64::from(shift));
                return (force + found, slope + (bears(f64::from(shift) + NUDGE) - found) / NUDGE);
            }
            let weight = area * stiffness;
            let (mut sum, mut active) = (0.0f64, 0u32);
            for p in map {
                let depth = p + shift;
                sum += f64::from(depth.clamp(0.0, limit));
                active += u32::from(depth > 0.0 && depth < limit);
            }
            (force + weight * sum, slope + weight * f64::from(active))
        })
    };
    let (mut low, mut high) = (-f64::from(deepest), gel.thickness - f64::from(deepest));
    if evaluate(high).0 < force {
        low = high;
        high = gel.thickness - f64::from(shallowest) + 1e-6;
        let (most, _) = evaluate(high);
        if most <= force {
            return Ok(Some(Balanced { shift: high, force: most }));
        }
    }
    let mut shift = 0.5 * (low + high);
    for _ in 0..60 {
        let (found, slope) = evaluate(shift);
        if found > force {
            high = shift
        } else {
            low = shift
        }
        let newton = shift - (found - force) / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let step = (next - shift).abs();
        shift = next;
        if step < 1e-9 {
            break;
        }
    }
    Ok(Some(Balanced { shift, force: evaluate(shift).0 }))
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
        // Reported in the caller's coordinates: the pixel is not known here.
        return Err(OpticsError::Surface { x, y, z });
    }
    Ok(penetration)
}

fn check(map: &[f32], expected: &'static str, good: impl Fn(f32) -> bool) -> Result<(), OpticsError> {
    if map.len() != PIXELS {
        return Err(OpticsError::MapSize { found: map.len(), expected: PIXELS });
    }
    match map.iter().position(|&value| !good(value)) {
        None => Ok(()),
        Some(at) => {
            Err(OpticsError::MapValue { column: at % IMAGE_SIZE, row: at / IMAGE_SIZE, value: map[at], expected })
        }
    }
}

fn pixel_area(camera: &Camera) -> Result<f64, OpticsError> {
    positive("camera width", camera.w)?;
    positive("camera height", camera.h)?;
    let (dx, dy) = camera.pixel_size();
    Ok(dx * dy)
}
