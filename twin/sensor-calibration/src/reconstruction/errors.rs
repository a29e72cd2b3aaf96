//! Errors of reconstructed surfaces of balls with known size and contact.
//!
//! The circle of a ball determines the gel's shape well inside it. Towards the rim the gel leaves the ball smoothly,
//! and the depth to which the surrounding gel sinks is unknown. Heights are therefore compared over the inner
//! [`INNER_SHARE`] of the contact's radius, relative to their mean at that radius; normals are compared over the whole
//! contact, as usual.

use hand_model::pads::IMAGE_SIZE as N;
use tactile_perception::AngularError;

use super::accuracy::{Accuracy, SLOPE_CLASS_COUNT, slope_class};
use super::known_ball::{KnownBall, KnownPresses};
use super::surface::{GridSurface, Reconstructor};
use crate::grid::PadGrid;

/// Share of the contact's radius within which the gel surely lies on the ball.
pub const INNER_SHARE: f64 = 0.7;
/// Share of the contact's radius within which the central height is averaged.
const MIDDLE_SHARE: f64 = 0.15;

/// Estimated and true surface of one press.
pub struct BallError {
    /// Estimated and true depth of the inner part, m.
    pub depth: [f64; 2],
    /// Ratio of estimated to true slope inside the contact.
    pub slope_ratio: f64,
    /// Share of the slopes that is inconsistent with any surface, and share of the contact outside the range of the
    /// training presses.
    pub misfit: f64,
    pub beyond: f64,
}

/// Accumulated errors of single presses and pixels.
#[derive(Default)]
pub struct ReconstructionErrors {
    pub rows: Vec<BallError>,
    /// Angular errors of normals inside the contact, degrees, and the sum of those of level normals.
    angles: Vec<f64>,
    level: f64,
    /// Sums of estimated times true slopes, and of squared true slopes.
    slopes: [f64; 2],
    /// Sum of squared angular errors, and count, by class of the estimated slope.
    classes: [[f64; 2]; SLOPE_CLASS_COUNT],
    overlap: f64,
    /// Sum of squared errors of the height over the inner part, and count.
    heights: [f64; 2],
}

/// Returns the contact threshold, a share of the peak height above which the gel counts as lying on a ball, for which
/// estimated and true contacts overlap best.
pub fn contact_share(reader: &Reconstructor, known: &KnownPresses, grid: PadGrid, pixel: f64) -> f32 {
    let surfaces: Vec<Option<GridSurface>> = known.presses.iter().map(|press| reader.on_grid(&press.image)).collect();
    let overlap = |share: f32| {
        let each = surfaces.iter().zip(&known.balls).flat_map(|(found, ball)| Some((found.as_ref()?, ball)));
        each.map(|(found, ball)| shared_area(found, share, |i| ball.at(ball.offset(grid, pixel, i)).is_some()))
            .sum::<f64>()
    };
    let shares = (1..=14).map(|k| 0.05 * k as f32);
    shares.map(|share| (overlap(share), share)).fold((-1.0, 0.35), |a, b| if b.0 > a.0 { b } else { a }).1
}

/// Averages the height along the edge of a ball's inner part, m.
fn edge_height(found: &GridSurface, ball: &KnownBall, grid: PadGrid, pixel: f64) -> f64 {
    let (dx, dy) = grid.pixel(pixel);
    mean_height(found, |i| {
        let [x, y] = ball.offset(grid, pixel, i);
        (x.hypot(y) - INNER_SHARE * ball.contact).abs() < 0.5 * dx.max(dy)
    })
}

/// Averages the height around a ball's centre, m.
fn middle_height(found: &GridSurface, ball: &KnownBall, grid: PadGrid, pixel: f64) -> f64 {
    mean_height(found, |i| {
        let [x, y] = ball.offset(grid, pixel, i);
        x.hypot(y) < MIDDLE_SHARE * ball.contact
    })
}

fn mean_height(found: &GridSurface, chosen: impl Fn(usize) -> bool) -> f64 {
    let all = found.height.iter().enumerate().filter(|(i, _)| chosen(*i));
    let (sum, count) = all.fold((0.0, 0.0), |(sum, count), (_, height)| (sum + f64::from(*height), count + 1.0));
    sum / f64::max(count, 1.0)
}

fn shared_area(found: &GridSurface, share: f32, inside: impl Fn(usize) -> bool) -> f64 {
    let limit = share * found.peak() as f32;
    let (mut both, mut either) = (0usize, 0usize);
    for (i, height) in found.height.iter().enumerate() {
        let (a, b) = (*height > limit, inside(i));
        both += usize::from(a && b);
        either += usize::from(a || b);
    }
    both as f64 / either.max(1) as f64
}

impl ReconstructionErrors {
    /// Compares the reconstructed surfaces of presses with the balls. A press without a detected touch counts as level.
    pub fn add(&mut self, reader: &Reconstructor, known: &KnownPresses, (grid, pixel): (PadGrid, f64), share: f32) {
        for (press, ball) in known.presses.iter().zip(&known.balls) {
            let found = reader.on_grid(&press.image);
            self.add_press(found.as_ref(), ball, (grid, pixel), share);
        }
    }

    fn add_press(&mut self, found: Option<&GridSurface>, ball: &KnownBall, (grid, pixel): (PadGrid, f64), share: f32) {
        let edge = found.map_or(0.0, |found| edge_height(found, ball, grid, pixel));
        let inner = INNER_SHARE * ball.contact;
        // The mean square radius of a disc is half of its radius squared.
        let middle = MIDDLE_SHARE * ball.contact * f64::sqrt(0.5);
        let (Some((true_middle, _)), Some((true_edge, _))) = (ball.at([middle, 0.0]), ball.at([inner, 0.0])) else {
            return;
        };
        let (mut slopes, mut inside) = ([0.0; 2], 0.0);
        for i in 0..N * N {
            let place = ball.offset(grid, pixel, i);
            let Some((height, [tx, ty])) = ball.at(place) else { continue };
            let (depth, [gx, gy]) = found.map_or((0.0, [0.0; 2]), |found| {
                (
                    f64::from(found.height[i]) - edge,
                    [f64::from(found.gradients.gx[i]), f64::from(found.gradients.gy[i])],
                )
            });
            let cross = ((ty - gy).powi(2) + (gx - tx).powi(2) + (tx * gy - ty * gx).powi(2)).sqrt();
            let angle = cross.atan2(tx * gx + ty * gy + 1.0).to_degrees();
            self.angles.push(angle);
            self.level += tx.hypot(ty).atan().to_degrees();
            slopes[0] += gx * tx + gy * ty;
            slopes[1] += tx * tx + ty * ty;
            if place[0].hypot(place[1]) < inner {
                self.heights[0] += (depth - (height - true_edge)).powi(2);
                inside += 1.0;
            }
            let class = &mut self.classes[slope_class(gx.hypot(gy))];
            class[0] += angle * angle;
            class[1] += 1.0;
        }
        self.heights[1] += inside;
        self.slopes[0] += slopes[0];
        self.slopes[1] += slopes[1];
        let in_contact = |i: usize| ball.at(ball.offset(grid, pixel, i)).is_some();
        self.overlap += found.map_or(0.0, |found| shared_area(found, share, in_contact));
        let (misfit, found_beyond) = (found.map_or(0.0, |found| found.misfit), found.map(|found| &found.beyond));
        let middle = found.map_or(0.0, |found| middle_height(found, ball, grid, pixel)) - edge;
        let depth = [middle, true_middle - true_edge];
        let slope_ratio = slopes[0] / slopes[1].max(f64::MIN_POSITIVE);
        let (mut beyond, mut contact) = (0.0, 0.0);
        for i in (0..N * N).filter(|&i| in_contact(i)) {
            contact += 1.0;
            beyond += f64::from(u8::from(found_beyond.is_some_and(|beyond| beyond[i])));
        }
        self.rows.push(BallError { depth, slope_ratio, misfit, beyond: beyond / f64::max(contact, 1.0) });
    }

    /// Adds the errors of other presses.
    pub fn merge(&mut self, other: Self) {
        self.rows.extend(other.rows);
        self.angles.extend(other.angles);
        self.level += other.level;
        self.overlap += other.overlap;
        let pairs = self
            .classes
            .iter_mut()
            .zip(other.classes)
            .chain([(&mut self.slopes, other.slopes), (&mut self.heights, other.heights)]);
        for (sum, other) in pairs {
            sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
        }
    }

    /// Summarizes the errors.
    pub fn accuracy(&self) -> Accuracy {
        let presses = self.rows.len();
        let mean = |value: &dyn Fn(&BallError) -> f64| self.rows.iter().map(value).sum::<f64>() / presses.max(1) as f64;
        let mut by_slope_deg = [0.0; SLOPE_CLASS_COUNT];
        let mut known = 0.0;
        for (error, [sum, count]) in by_slope_deg.iter_mut().zip(self.classes) {
            if count > 0.0 {
                known = f64::sqrt(sum / count);
            }
            *error = known;
        }
        let wrong = |row: &&BallError| row.depth[0] <= 0.0 || row.slope_ratio <= 0.0;
        Accuracy {
            presses,
            normals_deg: AngularError::from_angles(self.angles.clone()),
            level_deg: self.level / (self.angles.len().max(1)) as f64,
            slope_ratio: self.slopes[0] / self.slopes[1].max(f64::MIN_POSITIVE),
            depth_ratio: mean(&|row| row.depth[0] / row.depth[1]),
            depth_relative: mean(&|row| (row.depth[0] / row.depth[1] - 1.0).powi(2)).sqrt(),
            wrong_sign: self.rows.iter().filter(wrong).count(),
            height: (self.heights[0] / f64::max(self.heights[1], 1.0)).sqrt(),
            contact_overlap: self.overlap / presses.max(1) as f64,
            misfit: self.rows.iter().map(|row| row.misfit).fold(0.0, f64::max),
            beyond: mean(&|row| row.beyond),
            by_slope_deg,
        }
    }
}
