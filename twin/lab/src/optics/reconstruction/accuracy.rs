//! How far reconstructed surfaces are from balls whose size and contact are known.
//!
//! A ball's circle tells the gel's shape well inside it. Towards the rim the gel leaves the ball, smoothly, and how far the gel
//! around it sinks is not known. Heights are therefore compared over the inner [`INNER`] of the contact's radius, less their mean
//! at that radius; normals over the whole contact, as is usual.

use hand_model::pads::IMAGE_SIZE as N;
use serde::{Deserialize, Serialize};
use touch::AngularError;

use super::known_ball::{KnownBall, KnownPresses};
use super::surface::{GridSurface, Reconstructor};
use crate::optics::grid::Grid;

/// Width of a class of slopes in which errors of normals are counted, degrees.
const CLASS_DEG: f64 = 10.0;
/// Share of the contact's radius within which the gel surely lies on the ball.
pub const INNER: f64 = 0.7;
/// Share of the contact's radius over which the height in the middle is averaged.
const MIDDLE: f64 = 0.15;
/// Number of those classes.
const CLASSES: usize = 8;

/// Errors on presses that nothing was learned from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    pub presses: usize,
    /// Angle between found and true normals inside the contact, degrees.
    pub normals_deg: AngularError,
    /// Mean of found over true depth of a ball's inner part.
    pub depth_ratio: f64,
    /// Root mean square error of that depth over the depth.
    pub depth_relative: f64,
    /// Root mean square error of the height over the inner part, m.
    pub height: f64,
    /// Mean of the area that found and true contact share, over the area of both together.
    pub contact_overlap: f64,
    /// Root mean square error (degrees) of normals that were found at slopes of 0 to 10, 10 to 20, ... degrees; 0 where none was.
    pub by_slope_deg: [f64; CLASSES],
}

/// Found and true surface of one press.
pub struct BallError {
    /// Found and true depth of the inner part, m.
    pub depth: [f64; 2],
    /// Mean angle between found and true normals inside the contact, degrees.
    pub normals_deg: f64,
    /// Root mean square error of the height over the inner part, m.
    pub height: f64,
}

impl Accuracy {
    /// Expected error of a normal that was found with these slopes, degrees.
    pub fn normal_error(&self, [gx, gy]: [f32; 2]) -> f32 {
        self.by_slope_deg[class(f64::from(gx.hypot(gy)))] as f32
    }

    /// Expected error of a depth, m.
    pub fn depth_error(&self, depth: f64) -> f64 {
        self.depth_relative * depth
    }
}

fn class(slope: f64) -> usize {
    ((slope.atan().to_degrees() / CLASS_DEG) as usize).min(CLASSES - 1)
}

/// The share of the peak height above which the gel lies on a ball, such that found contacts overlap true ones best.
pub fn contact_share(reader: &Reconstructor, known: &KnownPresses, grid: Grid, pixel: f64) -> f32 {
    let surfaces: Vec<Option<GridSurface>> = known.presses.iter().map(|press| reader.on_grid(&press.image)).collect();
    let overlap = |share: f32| {
        let each = surfaces.iter().zip(&known.balls).flat_map(|(found, ball)| Some((found.as_ref()?, ball)));
        each.map(|(found, ball)| shared_area(found, share, |i| ball.at(ball.offset(grid, pixel, i)).is_some()))
            .sum::<f64>()
    };
    let shares = (1..=14).map(|k| 0.05 * k as f32);
    shares.map(|share| (overlap(share), share)).fold((-1.0, 0.35), |a, b| if b.0 > a.0 { b } else { a }).1
}

/// Mean height along the edge of a ball's inner part, m.
fn edge_height(found: &GridSurface, ball: &KnownBall, grid: Grid, pixel: f64) -> f64 {
    let (dx, dy) = grid.pixel(pixel);
    mean_height(found, |i| {
        let [x, y] = ball.offset(grid, pixel, i);
        (x.hypot(y) - INNER * ball.contact).abs() < 0.5 * dx.max(dy)
    })
}

/// Mean height around a ball's middle, m.
fn middle_height(found: &GridSurface, ball: &KnownBall, grid: Grid, pixel: f64) -> f64 {
    mean_height(found, |i| {
        let [x, y] = ball.offset(grid, pixel, i);
        x.hypot(y) < MIDDLE * ball.contact
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

/// Compares surfaces of presses with the balls; also returns each press's errors. A press that shows nothing counts as level.
pub fn measure(
    reader: &Reconstructor,
    known: &KnownPresses,
    (grid, pixel): (Grid, f64),
    share: f32,
) -> (Accuracy, Vec<BallError>) {
    let (mut angles, mut rows) = (Vec::new(), Vec::new());
    let (mut squares, mut counts) = ([0.0; CLASSES], [0.0; CLASSES]);
    let (mut overlap, mut height_squares, mut pixels) = (0.0, 0.0, 0.0);
    for (press, ball) in known.presses.iter().zip(&known.balls) {
        let found = reader.on_grid(&press.image);
        let edge = found.as_ref().map_or(0.0, |found| edge_height(found, ball, grid, pixel));
        let inner = INNER * ball.contact;
        // A disc's mean square radius is half of its radius squared.
        let middle = MIDDLE * ball.contact * f64::sqrt(0.5);
        let (Some((true_middle, _)), Some((true_edge, _))) = (ball.at([middle, 0.0]), ball.at([inner, 0.0])) else {
            continue;
        };
        let (mut own, mut own_squares, mut inside) = (Vec::new(), 0.0, 0.0);
        for i in 0..N * N {
            let place = ball.offset(grid, pixel, i);
            let Some((height, [tx, ty])) = ball.at(place) else { continue };
            let (depth, [gx, gy]) = found.as_ref().map_or((0.0, [0.0; 2]), |found| {
                (
                    f64::from(found.height[i]) - edge,
                    [f64::from(found.gradients.gx[i]), f64::from(found.gradients.gy[i])],
                )
            });
            let cross = ((ty - gy).powi(2) + (gx - tx).powi(2) + (tx * gy - ty * gx).powi(2)).sqrt();
            let angle = cross.atan2(tx * gx + ty * gy + 1.0).to_degrees();
            own.push(angle);
            if place[0].hypot(place[1]) < inner {
                own_squares += (depth - (height - true_edge)).powi(2);
                inside += 1.0;
            }
            squares[class(gx.hypot(gy))] += angle * angle;
            counts[class(gx.hypot(gy))] += 1.0;
        }
        if inside == 0.0 {
            continue;
        }
        let count = own.len() as f64;
        rows.push(BallError {
            depth: [
                found.as_ref().map_or(0.0, |found| middle_height(found, ball, grid, pixel)) - edge,
                true_middle - true_edge,
            ],
            normals_deg: own.iter().sum::<f64>() / count,
            height: (own_squares / inside).sqrt(),
        });
        let in_contact = |i: usize| ball.at(ball.offset(grid, pixel, i)).is_some();
        overlap += found.as_ref().map_or(0.0, |found| shared_area(found, share, in_contact));
        height_squares += own_squares;
        pixels += inside;
        angles.append(&mut own);
    }
    let presses = rows.len();
    let mean = |value: &dyn Fn(&BallError) -> f64| rows.iter().map(value).sum::<f64>() / presses.max(1) as f64;
    let accuracy = Accuracy {
        presses,
        normals_deg: AngularError::of(angles),
        depth_ratio: mean(&|row| row.depth[0] / row.depth[1]),
        depth_relative: mean(&|row| (row.depth[0] / row.depth[1] - 1.0).powi(2)).sqrt(),
        height: (height_squares / f64::max(pixels, 1.0)).sqrt(),
        contact_overlap: overlap / presses.max(1) as f64,
        by_slope_deg: std::array::from_fn(|k| if counts[k] > 0.0 { (squares[k] / counts[k]).sqrt() } else { 0.0 }),
    };
    (accuracy, rows)
}
