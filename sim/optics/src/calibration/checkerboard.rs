//! The inner corners of a checkerboard in an image.
//!
//! At an inner corner, four squares meet and brightness is a saddle: it rises along one diagonal and falls along the
//! other, so the Hessian's determinant is strongly negative. On a ring around a true corner brightness crosses its mean
//! four times, in the directions of the two lines that cross there. Each corner therefore indicates its neighbours'
//! directions, and the board is traversed from corner to corner. A corner is refined to the point towards which all
//! edges nearby point: the image gradient at any point nearby is perpendicular to the line from the corner to that
//! point (Foerstner).

use std::collections::{HashMap, VecDeque};

use nalgebra::{Matrix2, Vector2};
use serde::Deserialize;

use crate::calibration::photo::Photo;

/// A board, by its inner corners: one fewer than squares each way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkerboard {
    /// Inner corners along one side.
    pub columns: usize,
    /// Inner corners along the other.
    pub rows: usize,
}

/// Standard deviation of the smoothing before corners are looked for, pixels.
const BLUR_SIGMA: f64 = 1.5;
/// Radius of the ring on which a corner's four edges are found, pixels, and the number of samples on it.
const RING_RADIUS: f64 = 5.0;
const RING_SAMPLES: usize = 48;
/// Smallest distance between two corners, pixels.
const MIN_CORNER_DISTANCE: isize = 5;
/// Threshold relative to the board's typical corner below which a saddle is ignored.
const MIN_SADDLE_RATIO: f32 = 0.12;
/// Largest angle between an edge and the direction to the neighbour it leads to, rad.
const MAX_EDGE_ANGLE: f64 = 0.22;

/// A corner with the directions of its four edges (rad, ascending, rows down).
#[derive(Debug, Clone, Copy)]
struct Corner {
    place: Vector2<f64>,
    edges: [f64; 4],
}

impl Checkerboard {
    /// Finds the corners (column and row in pixels), line by line of the board. The first corner and the direction of
    /// the lines are arbitrary, because a board looks the same rotated by half a turn. The error says what was found
    /// instead.
    pub fn find(&self, photo: &Photo) -> Result<Vec<[f64; 2]>, String> {
        let grey = SmoothedImage::new(photo);
        let corners = corners(&grey, self.columns * self.rows);
        let mut largest: HashMap<(i32, i32), usize> = HashMap::new();
        let mut seen = vec![false; corners.len()];
        for seed in 0..corners.len() {
            if !seen[seed] {
                let grid = index_corners(&corners, seed);
                grid.values().for_each(|&corner| seen[corner] = true);
                if grid.len() > largest.len() {
                    largest = grid;
                }
            }
        }
        // Clutter beside the board may look like another corner: the board is the only position at which all corners exist.
        let [mut left, mut top] = [i32::MAX; 2];
        let [mut right, mut bottom] = [i32::MIN; 2];
        for &(i, j) in largest.keys() {
            (left, right, top, bottom) = (left.min(i), right.max(i), top.min(j), bottom.max(j));
        }
        let mut boards = Vec::new();
        for upright in [true, false] {
            let line = |i: i32, j: i32| {
                move |at: (i32, i32)| if upright { (i + at.0, j + at.1) } else { (i + at.1, j + at.0) }
            };
            for j in top..=bottom {
                for i in left..=right {
                    let all =
                        (0..self.rows as i32).flat_map(|row| (0..self.columns as i32).map(move |column| (column, row)));
                    let board: Option<Vec<usize>> = all.map(line(i, j)).map(|at| largest.get(&at).copied()).collect();
                    boards.extend(board);
                }
            }
            if self.columns == self.rows {
                break;
            }
        }
        let [board] = boards.as_slice() else {
            return Err(format!(
                "found {} corners of a checkerboard; expected {} x {} inner corners",
                largest.len(),
                self.columns,
                self.rows
            ));
        };
        let places = board.iter().map(|&corner| grey.refine(corners[corner].place).into()).collect();
        Ok(places)
    }
}

/// Smoothed brightness.
struct SmoothedImage {
    width: usize,
    height: usize,
    value: Vec<f32>,
}

impl SmoothedImage {
    fn new(photo: &Photo) -> Self {
        let value: Vec<f32> =
            photo.rgb.chunks_exact(3).map(|rgb| rgb.iter().map(|&v| f32::from(v)).sum::<f32>() / 3.0).collect();
        let (width, height) = (photo.width, photo.height);
        let reach = (3.0 * BLUR_SIGMA).ceil() as isize;
        let weights: Vec<f32> =
            (-reach..=reach).map(|i| (-0.5 * (i as f64 / BLUR_SIGMA).powi(2)).exp() as f32).collect();
        let total: f32 = weights.iter().sum();
        let pass = |from: &[f32], across: bool| -> Vec<f32> {
            (0..from.len())
                .map(|at| {
                    let (column, row) = ((at % width) as isize, (at / width) as isize);
                    let near = |i: isize| {
                        let (c, r) = if across { (column + i, row) } else { (column, row + i) };
                        from[r.clamp(0, height as isize - 1) as usize * width + c.clamp(0, width as isize - 1) as usize]
                    };
                    weights.iter().zip(-reach..).map(|(weight, i)| weight * near(i)).sum::<f32>() / total
                })
                .collect()
        };
        let once: Vec<f32> = pass(&value, true);
        Self { width, height, value: pass(&once, false) }
    }

    fn get(&self, column: isize, row: isize) -> f32 {
        let (c, r) = (column.clamp(0, self.width as isize - 1), row.clamp(0, self.height as isize - 1));
        self.value[r as usize * self.width + c as usize]
    }

    fn interpolate_at(&self, place: Vector2<f64>) -> f64 {
        let (c, r) = (place.x.floor(), place.y.floor());
        let (u, v, c, r) = (place.x - c, place.y - r, c as isize, r as isize);
        let line = |row: isize| (1.0 - u) * f64::from(self.get(c, row)) + u * f64::from(self.get(c + 1, row));
        (1.0 - v) * line(r) + v * line(r + 1)
    }

    /// Computes minus the determinant of the Hessian at every pixel: large at saddles.
    fn saddles(&self) -> Vec<f32> {
        (0..self.value.len())
            .map(|at| {
                let (c, r) = ((at % self.width) as isize, (at / self.width) as isize);
                let g = |dc, dr| self.get(c + dc, r + dr);
                let (xx, yy) = (g(1, 0) + g(-1, 0) - 2.0 * g(0, 0), g(0, 1) + g(0, -1) - 2.0 * g(0, 0));
                let xy = 0.25 * (g(1, 1) + g(-1, -1) - g(1, -1) - g(-1, 1));
                xy * xy - xx * yy
            })
            .collect()
    }

    /// Finds the directions in which brightness crosses its mean on a ring: four around a corner.
    fn edges(&self, place: Vector2<f64>) -> Option<[f64; 4]> {
        let angle = |i: usize| i as f64 * std::f64::consts::TAU / RING_SAMPLES as f64;
        let values: Vec<f64> = (0..RING_SAMPLES)
            .map(|i| self.interpolate_at(place + RING_RADIUS * Vector2::new(angle(i).cos(), angle(i).sin())))
            .collect();
        let mean = values.iter().sum::<f64>() / RING_SAMPLES as f64;
        let crossings: Vec<f64> = (0..RING_SAMPLES)
            .filter_map(|i| {
                let (here, next) = (values[i] - mean, values[(i + 1) % RING_SAMPLES] - mean);
                ((here < 0.0) != (next < 0.0)).then(|| angle(i) + (angle(1)) * here / (here - next))
            })
            .collect();
        crossings.try_into().ok()
    }

    /// Finds the point near `start` with the least squared distance to the lines along all edges nearby.
    fn refine(&self, start: Vector2<f64>) -> Vector2<f64> {
        const REFINEMENT_RADIUS: isize = 5;
        let mut place = start;
        for _ in 0..20 {
            let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
            for down in -REFINEMENT_RADIUS..=REFINEMENT_RADIUS {
                for across in -REFINEMENT_RADIUS..=REFINEMENT_RADIUS {
                    let away = Vector2::new(across as f64, down as f64);
                    let at = place + away;
                    let (dx, dy) = (Vector2::new(0.5, 0.0), Vector2::new(0.0, 0.5));
                    let slope = Vector2::new(
                        self.interpolate_at(at + dx) - self.interpolate_at(at - dx),
                        self.interpolate_at(at + dy) - self.interpolate_at(at - dy),
                    );
                    let weight = (-away.norm_squared() / (0.5 * (REFINEMENT_RADIUS * REFINEMENT_RADIUS) as f64)).exp();
                    let outer = weight * slope * slope.transpose();
                    matrix += outer;
                    right += outer * at;
                }
            }
            let Some(next) = matrix.try_inverse().map(|inverse| inverse * right) else { return start };
            let step = (next - place).norm();
            place = next;
            if step < 1e-3 {
                break;
            }
        }
        if (place - start).norm() < 2.0 { place } else { start }
    }
}

/// Finds the corners at the strongest saddles; the number `expected` sets the scale of what counts as strong.
fn corners(grey: &SmoothedImage, expected: usize) -> Vec<Corner> {
    let saddles = grey.saddles();
    let (w, h) = (grey.width as isize, grey.height as isize);
    let margin = RING_RADIUS.ceil() as isize + 1;
    let mut peaks: Vec<(f32, Vector2<f64>)> = Vec::new();
    for row in margin..h - margin {
        for column in margin..w - margin {
            let here = saddles[(row * w + column) as usize];
            let near = (-MIN_CORNER_DISTANCE..=MIN_CORNER_DISTANCE)
                .flat_map(|dr| (-MIN_CORNER_DISTANCE..=MIN_CORNER_DISTANCE).map(move |dc| (dc, dr)));
            let first = |(dc, dr): (isize, isize)| {
                let (c, r) = ((column + dc).clamp(0, w - 1), (row + dr).clamp(0, h - 1));
                let other = saddles[(r * w + c) as usize];
                // Of two equal saddles the first is kept.
                if (dr, dc) < (0, 0) { other < here } else { other <= here }
            };
            if here > 0.0 && near.filter(|&d| d != (0, 0)).all(first) {
                peaks.push((here, Vector2::new(column as f64, row as f64)));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let typical = peaks.get(expected.min(peaks.len()) / 2).map_or(0.0, |peak| peak.0);
    let strong = peaks.into_iter().filter(|peak| peak.0 >= MIN_SADDLE_RATIO * typical);
    strong.filter_map(|(_, place)| grey.edges(place).map(|edges| Corner { place, edges })).collect()
}

/// Computes the angle between two directions, rad.
fn angle_between(a: f64, b: f64) -> f64 {
    let off = (a - b).rem_euclid(std::f64::consts::TAU);
    off.min(std::f64::consts::TAU - off)
}

/// Finds the corner to which an edge leads.
fn neighbour(corners: &[Corner], from: usize, edge: f64) -> Option<usize> {
    let mut best: Option<(f64, usize)> = None;
    for (at, other) in corners.iter().enumerate().filter(|(at, _)| *at != from) {
        let way = other.place - corners[from].place;
        let distance = way.norm();
        if angle_between(way.y.atan2(way.x), edge) < MAX_EDGE_ANGLE && best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, at));
        }
    }
    best.map(|(_, at)| at)
}

/// Traverses the corners from `seed`; returns the index of the corner at each position of the board, relative to the
/// seed's.
fn index_corners(corners: &[Corner], seed: usize) -> HashMap<(i32, i32), usize> {
    const GRID_STEPS: [(i32, i32); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
    let mut grid = HashMap::from([((0, 0), seed)]);
    let mut known = vec![false; corners.len()];
    known[seed] = true;
    // A corner, its position, and the index of its edge in the direction of the first step.
    let mut queue = VecDeque::from([(seed, (0, 0), 0usize)]);
    while let Some((corner, (i, j), first)) = queue.pop_front() {
        for (step, (di, dj)) in GRID_STEPS.iter().enumerate() {
            let edge = corners[corner].edges[(first + step) % 4];
            let Some(next) = neighbour(corners, corner, edge) else { continue };
            let place = (i + di, j + dj);
            if known[next] || grid.contains_key(&place) {
                continue;
            }
            // Its edge in the same direction; the opposite one must lead back here.
            let off = |k: usize| angle_between(corners[next].edges[k], edge);
            let Some(on) = (0..4).min_by(|&a, &b| off(a).total_cmp(&off(b))) else { continue };
            if off(on) > 2.0 * MAX_EDGE_ANGLE
                || neighbour(corners, next, corners[next].edges[(on + 2) % 4]) != Some(corner)
            {
                continue;
            }
            known[next] = true;
            grid.insert(place, next);
            queue.push_back((next, place, (on + 4 - step) % 4));
        }
    }
    grid
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::calibration::lens::Lens;

    /// Renders a board of unit squares with a white border through this lens; its centre is at the pose's origin.
    pub(crate) fn picture(board: Checkerboard, lens: &Lens, pose: &Isometry3<f64>, size: [usize; 2]) -> Photo {
        const PARTS: usize = 4;
        let [width, height] = size;
        let (right, down) = (pose * Vector3::x(), pose * Vector3::y());
        let normal = right.cross(&down);
        let origin = pose.translation.vector;
        let squares = [board.columns + 1, board.rows + 1].map(|n| n as f64);
        let shade = |column: f64, row: f64| {
            let [u, v] = lens.rectify_point([column, row]);
            let ray = Vector3::new((u - lens.center[0]) / lens.focal[0], (v - lens.center[1]) / lens.focal[1], 1.0);
            let point = ray * (normal.dot(&origin) / normal.dot(&ray)) - origin;
            let (x, y) = (point.dot(&right) + 0.5 * squares[0], point.dot(&down) + 0.5 * squares[1]);
            if !(0.0..squares[0]).contains(&x) || !(0.0..squares[1]).contains(&y) {
                200.0
            } else if (x as usize + y as usize).is_multiple_of(2) {
                40.0
            } else {
                200.0
            }
        };
        let mut rgb = Vec::with_capacity(3 * width * height);
        for at in 0..width * height {
            let sum: f64 = (0..PARTS * PARTS)
                .map(|part| {
                    let inside = |k: usize| (k as f64 + 0.5) / PARTS as f64 - 0.5;
                    shade((at % width) as f64 + inside(part % PARTS), (at / width) as f64 + inside(part / PARTS))
                })
                .sum();
            rgb.extend([(sum / (PARTS * PARTS) as f64).round() as u8; 3]);
        }
        Photo { width, height, rgb }
    }

    pub(crate) const BOARD: Checkerboard = Checkerboard { columns: 7, rows: 5 };
    pub(crate) const LENS: Lens =
        Lens { focal: [262.0, 258.0], center: [163.0, 117.0], radial: [-0.22, 0.05, 0.0], tangential: [0.002, -0.001] };

    #[test]
    fn corners_are_found_to_a_tenth_of_a_pixel() {
        let pose = Isometry3::new(Vector3::new(0.2, -0.1, 9.5), Vector3::new(0.35, -0.3, 0.5));
        let photo = picture(BOARD, &LENS, &pose, [320, 240]);
        let found = BOARD.find(&photo).unwrap();
        let mut worst = 0.0f64;
        for j in 0..BOARD.rows {
            for i in 0..BOARD.columns {
                let place = |k: usize, n: usize| k as f64 - 0.5 * (n as f64 - 1.0);
                let at = pose.rotation * Vector3::new(place(i, BOARD.columns), place(j, BOARD.rows), 0.0)
                    + pose.translation.vector;
                let flat = [0, 1].map(|axis| LENS.center[axis] + LENS.focal[axis] * at[axis] / at.z);
                let [u, v] = LENS.distort_point(flat);
                let nearest = found.iter().map(|[x, y]| (x - u).hypot(y - v)).fold(f64::INFINITY, f64::min);
                worst = worst.max(nearest);
            }
        }
        assert!(worst < 0.1, "{worst} px");
        // Neighbours in the list are neighbours on the board.
        let step = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        assert!(found.chunks_exact(BOARD.columns).all(|line| line.windows(2).all(|w| step(w[0], w[1]) < 40.0)));
    }

    #[test]
    fn another_board_and_no_board_are_errors() {
        let pose = Isometry3::new(Vector3::new(0.0, 0.0, 9.5), Vector3::new(0.2, 0.1, 0.0));
        let photo = picture(BOARD, &LENS, &pose, [320, 240]);
        let text = Checkerboard { columns: 8, rows: 5 }.find(&photo).unwrap_err();
        assert!(text.contains("found 35 corners") && text.contains("8 x 5"), "{text}");
        // A smaller board fits at several positions.
        assert!(Checkerboard { columns: 6, rows: 5 }.find(&photo).unwrap_err().contains("found 35 corners"));
        let nothing = Photo { width: 60, height: 40, rgb: vec![90; 7200] };
        assert!(BOARD.find(&nothing).unwrap_err().contains("found 0 corners"));
    }
}
