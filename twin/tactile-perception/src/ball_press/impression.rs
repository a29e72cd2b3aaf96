//! The gel's surface under a ball, over the pad's flat middle and its rounded edges alike.
//!
//! Inside the contact the gel lies on the ball. Beyond it the gel leaves the ball gradually: the indentation is
//! smoothed with ever narrower kernels, and after each one it is raised to the depth of the ball again.

use std::ops::Range;

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE as N;
use nalgebra::Point3;

use crate::PIXELS;

/// Standard deviations of the kernels, as shares of the gel's thickness.
const KERNEL_WIDTHS: [f64; 4] = [0.32, 0.16, 0.08, 0.04];
/// Truncation radius of a kernel, in standard deviations.
const TRUNCATION_SIGMAS: f64 = 3.0;

/// A ball in a pad's frame, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PressedBall {
    pub center: Point3<f64>,
    pub radius: f64,
}

/// The gel under a ball.
pub(super) struct Impression {
    /// Indentation of the gel's surface, m, [`PIXELS`] values.
    pub indentation: Vec<f32>,
    /// True if the image's border clips the contact.
    pub clipped: bool,
}

/// Computes the gel's surface under a ball as seen by camera number `camera`.
pub(super) fn impression(hand: &Hand, camera: usize, ball: &PressedBall) -> Impression {
    let view = &hand.cameras[camera];
    let pad = &hand.pads[view.pad];
    let (dx, dy) = view.pixel_size();
    let widest = TRUNCATION_SIGMAS * KERNEL_WIDTHS[0] * hand.gel().thickness;
    // No contact is wider than the circle in which the ball passes through the pad's plane.
    let low = ball.center.z.clamp(0.0, ball.radius);
    let reach = (ball.radius * ball.radius - low * low).sqrt() + widest;
    let (left, top) = view.pixel_center(0, 0);
    let columns = span((ball.center.x - left) / dx, reach / dx);
    let rows = span((top - ball.center.y) / dy, reach / dy);
    let mut indentation = vec![0.0; PIXELS];
    let mut clipped = columns.is_empty() || rows.is_empty();
    if clipped {
        return Impression { indentation, clipped };
    }
    let mut own = Vec::with_capacity(columns.len() * rows.len());
    for row in rows.clone() {
        for column in columns.clone() {
            let (x, y) = view.pixel_center(column, row);
            let below = ball.radius.powi(2) - (x - ball.center.x).powi(2) - (y - ball.center.y).powi(2);
            let depth = pad.surface_height(x, y) - ball.center.z + below.max(0.0).sqrt();
            let depth = if below > 0.0 { depth.clamp(0.0, hand.gel().thickness) } else { 0.0 };
            clipped |= depth > 0.0 && (column == 0 || column + 1 == N || row == 0 || row + 1 == N);
            own.push(depth as f32);
        }
    }
    let mut depth = own.clone();
    for share in KERNEL_WIDTHS {
        let deviation = share * hand.gel().thickness;
        depth = along_columns(&along_rows(&depth, columns.len(), deviation / dx), columns.len(), deviation / dy);
        depth.iter_mut().zip(&own).for_each(|(depth, own)| *depth = depth.max(*own));
    }
    for (row, line) in rows.zip(depth.chunks_exact(columns.len())) {
        indentation[row * N + columns.start..row * N + columns.end].copy_from_slice(line);
    }
    Impression { indentation, clipped }
}

/// Pixels of a line within `reach` of `middle`.
fn span(middle: f64, reach: f64) -> Range<usize> {
    let end = |at: f64| at.clamp(0.0, N as f64) as usize;
    end((middle - reach).ceil())..end((middle + reach).floor() + 1.0)
}

/// Weights of a Gaussian with a standard deviation in pixels, from its centre outwards.
fn weights(deviation: f64) -> Vec<f32> {
    let reach = (TRUNCATION_SIGMAS * deviation).ceil() as usize;
    let half: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / deviation).powi(2)).exp()).collect();
    let sum = 2.0 * half.iter().sum::<f64>() - half[0];
    half.into_iter().map(|weight| (weight / sum) as f32).collect()
}

/// Smooths each row of `width` values; the end values continue beyond its ends.
fn along_rows(from: &[f32], width: usize, deviation: f64) -> Vec<f32> {
    let weights = weights(deviation);
    let reach = weights.len() - 1;
    let mut to = vec![0.0; from.len()];
    let mut padded = vec![0.0; width + 2 * reach];
    for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
        padded[..reach].fill(from[0]);
        padded[reach..reach + width].copy_from_slice(from);
        padded[reach + width..].fill(from[width - 1]);
        for at in 0..=2 * reach {
            let weight = weights[at.abs_diff(reach)];
            to.iter_mut().zip(&padded[at..]).for_each(|(to, from)| *to += weight * from);
        }
    }
    to
}

/// Smooths across rows of `width` values; the first and the last row continue beyond the ends.
fn along_columns(from: &[f32], width: usize, deviation: f64) -> Vec<f32> {
    let weights = weights(deviation);
    let (reach, last) = (weights.len() - 1, from.len() / width - 1);
    let mut to = vec![0.0; from.len()];
    for (row, to) in to.chunks_exact_mut(width).enumerate() {
        for at in 0..=2 * reach {
            let weight = weights[at.abs_diff(reach)];
            let other = (row + at).saturating_sub(reach).min(last);
            let from = &from[other * width..(other + 1) * width];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    }
    to
}
