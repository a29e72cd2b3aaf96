//! Cast shadows: how much of each lamp a place on the deformed gel sees.
//!
//! Seen from the lamp, the gel is a height field. Along a line away from the lamp, a place at depth h and distance D
//! appears at the tangent `m = (h - lamp's depth) / D`, and what comes later is hidden where its m is below the largest m so far. That running
//! maximum, and where it was met, is handed from cell to cell outwards from the lamp, mixed from the two cells that the line runs
//! between: a few operations a cell, however long the shadow. Lamps have a size, so that shadows have soft borders
//! ([`Lamp::share_above`]). Cells are 2 x 2 pixels; shadows are smooth enough for that.
//!
//! The paper's way, hidden-point removal (Katz et al.), is what the tests compare with.

use crate::lamps::Lamp;

/// Pixels along a cell's side.
const CELL: usize = 2;
/// A lamp whose share is nowhere below this casts no shadow.
const UNSHADED: f32 = 0.995;

/// A height field: pixel (column, row) is at `x0 + column dx`, `y0 - row dy` (m) and `depth` (m) behind the untouched gel. Beyond
/// its border the gel is untouched.
#[derive(Debug, Clone, Copy)]
pub struct HeightField<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The first pixel's centre.
    pub first: (f64, f64),
    /// Size of a pixel.
    pub pixel: (f64, f64),
    /// Row-major.
    pub depth: &'a [f32],
}

/// How much of a lamp each pixel sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Shadow {
    width: usize,
    height: usize,
    share: Vec<f32>,
}

/// What is handed on along a line from the lamp: the largest tangent so far, and its distance from the lamp.
#[derive(Debug, Clone, Copy)]
struct Edge {
    tangent: f32,
    distance: f32,
}

impl HeightField<'_> {
    /// The shadow of this lamp; `None` where it casts none.
    pub fn shadow(&self, lamp: &Lamp) -> Option<Shadow> {
        let (cells, (width, height)) = self.cells();
        let size = ((CELL as f64 * self.pixel.0) as f32, (CELL as f64 * self.pixel.1) as f32);
        let middle = 0.5 * (CELL - 1) as f64;
        let first = (self.first.0 + middle * self.pixel.0, self.first.1 - middle * self.pixel.1);
        // The lamp's place, in cells.
        let lamp_x = ((lamp.position.x - first.0) as f32) / size.0;
        let lamp_y = ((first.1 - lamp.position.y) as f32) / size.1;
        let lamp_depth = -lamp.position.z as f32;
        let soft = 1.0 / lamp.size.max(1e-6) as f32;
        let mut edges = vec![Edge { tangent: 0.0, distance: 0.0 }; width * height];
        let mut share = vec![1.0f32; width * height];
        let mut darkest = 1.0f32;
        for row in outwards(lamp_y, height) {
            for column in outwards(lamp_x, width) {
                let (across, down) = (lamp_x - column as f32, lamp_y - row as f32);
                let (x, y) = (across * size.0, down * size.1);
                let distance = (x * x + y * y).max(1e-14).sqrt();
                let at = row * width + column;
                let own = (cells[at] - lamp_depth) / distance;
                // One step of the longer side's length towards the lamp.
                let steps = across.abs().max(down.abs());
                edges[at] = Edge { tangent: own, distance };
                if steps <= 1.0 {
                    continue;
                }
                let inverse = 1.0 / steps;
                let (dx, dy) = (across * inverse, down * inverse);
                let near = distance * (1.0 - inverse);
                let look = |column: isize, row: isize| {
                    let inside = (0..width as isize).contains(&column) && (0..height as isize).contains(&row);
                    if inside {
                        edges[row as usize * width + column as usize]
                    } else {
                        Edge { tangent: -lamp_depth / near, distance: near }
                    }
                };
                let (column, row) = (column as isize, row as isize);
                let (a, b, part) = if across.abs() >= down.abs() {
                    let next = column + dx.signum() as isize;
                    // Between the lamp's own two rows, neither comes before the other: straight on.
                    let part = if down.abs() < 1.0 { 0.0 } else { dy.abs() };
                    (look(next, row), look(next, row + dy.signum() as isize), part)
                } else {
                    let next = row + dy.signum() as isize;
                    (look(column, next), look(column + dx.signum() as isize, next), dx.abs())
                };
                let tangent = a.tangent + part * (b.tangent - a.tangent);
                let met = (a.distance + part * (b.distance - a.distance)).min(near);
                // `over` is (own - tangent) distance met / (distance - met) / size, and only matters below 1.
                let (reach, gap) = ((own - tangent) * distance * met * soft, distance - met);
                if reach < gap {
                    let seen = 0.5 * ((reach / gap).max(-1.0) + 1.0);
                    let seen = seen * seen * (3.0 - 2.0 * seen);
                    share[at] = seen;
                    darkest = darkest.min(seen);
                }
                if own < tangent {
                    edges[at] = Edge { tangent, distance: met };
                }
            }
        }
        (darkest < UNSHADED).then_some(Shadow { width, height, share })
    }

    /// Mean depth of each cell.
    fn cells(&self) -> (Vec<f32>, (usize, usize)) {
        let (width, height) = (self.width.div_ceil(CELL), self.height.div_ceil(CELL));
        let mut cells = Vec::with_capacity(width * height);
        for row in 0..height {
            let rows = [CELL * row, (CELL * row + 1).min(self.height - 1)];
            let lines = rows.map(|row| &self.depth[row * self.width..(row + 1) * self.width]);
            for column in 0..width {
                let (left, right) = (CELL * column, (CELL * column + 1).min(self.width - 1));
                cells.push(0.25 * lines.iter().map(|line| line[left] + line[right]).sum::<f32>());
            }
        }
        (cells, (width, height))
    }
}

/// Indices outwards from a place: first those below it from high to low, then those above it.
fn outwards(place: f32, count: usize) -> impl Iterator<Item = usize> {
    let start = (place.max(0.0).ceil() as usize).min(count);
    (0..start).rev().chain(start..count)
}

impl Shadow {
    /// Share of the lamp that a row's pixels see, from column `first` on, linear between the cells' middles.
    pub fn row(&self, row: usize, first: usize, out: &mut [f32]) {
        let place = |pixel: usize, count: usize| {
            let at = ((pixel as f32 - 0.5 * (CELL - 1) as f32) / CELL as f32).clamp(0.0, (count - 1) as f32);
            let cell = (at as usize).min(count.max(2) - 2);
            (cell, (cell + 1).min(count - 1), at - cell as f32)
        };
        let (above, below, down) = place(row, self.height);
        let line = |row: usize| &self.share[row * self.width..(row + 1) * self.width];
        let (above, below) = (line(above), line(below));
        for (i, out) in out.iter_mut().enumerate() {
            let (left, right, across) = place(first + i, self.width);
            let top = above[left] + across * (above[right] - above[left]);
            let bottom = below[left] + across * (below[right] - below[left]);
            *out = top + down * (bottom - top);
        }
    }

    /// First and last column of a row that see notably less than the whole lamp.
    pub fn extent(&self, row: usize) -> Option<(usize, usize)> {
        // A pixel is mixed from the cells around it.
        let cell = (row / CELL).min(self.height - 1);
        let rows = cell.saturating_sub(1)..(cell + 2).min(self.height);
        let shaded = |column: &usize| rows.clone().any(|row| self.share[row * self.width + column] < UNSHADED);
        let (first, last) = ((0..self.width).find(shaded)?, (0..self.width).rfind(shaded)?);
        Some((CELL * first.saturating_sub(1), CELL * (last + 1) + CELL - 1))
    }

    /// Share of the lamp that a place sees, in columns and rows of pixels.
    pub fn at(&self, column: f64, row: f64) -> f64 {
        let place = |pixel: f64, count: usize| {
            let at = ((pixel - 0.5 * (CELL - 1) as f64) / CELL as f64).clamp(0.0, (count - 1) as f64);
            let cell = (at as usize).min(count.max(2) - 2);
            (cell, (cell + 1).min(count - 1), at - cell as f64)
        };
        let ((left, right, across), (above, below, down)) = (place(column, self.width), place(row, self.height));
        let share = |row: usize, column: usize| f64::from(self.share[row * self.width + column]);
        let top = share(above, left) + across * (share(above, right) - share(above, left));
        let bottom = share(below, left) + across * (share(below, right) - share(below, left));
        top + down * (bottom - top)
    }
}
