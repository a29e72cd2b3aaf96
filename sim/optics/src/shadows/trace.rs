//! Propagation of the horizon from cell to cell, outwards from a lamp.
//!
//! A cell takes the horizon one step of its longer axis towards the lamp, interpolated between the two cells there,
//! which are nearer to the lamp. Cells are visited line by line outwards, so that both have been visited. The cells of
//! a line whose longer axis leads across the lines do not depend on each other and are vectorised. Lines are rows, or
//! columns if the lamp is beside the grid and more cells can be vectorised that way. The arithmetic of a cell is the
//! same either way.

use std::ops::Range;

use crate::wide::{transpose, widest};

/// Number of cells along an axis, the lamp's position on it (in cells), and a cell's size (m).
pub(super) type Axis = (usize, f32, f32);

/// The lines are stacked along `outer`; a line's cells lie along `inner`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axes {
    pub(super) outer: Axis,
    pub(super) inner: Axis,
}

/// Cells with rows as lines, and a lamp.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Depth of the lamp behind the untouched gel, m.
    pub(super) lamp_depth: f32,
    /// One over the lamp's half extent, 1/m.
    pub(super) soft: f32,
    pub(super) rows: Axes,
}

/// The horizon on a line from the lamp: the largest tangent so far, and its distance from the lamp.
#[derive(Debug, Clone, Copy)]
struct Edge {
    tangent: f32,
    distance: f32,
}

/// Depths of all cells, row by row and column by column.
#[derive(Debug)]
pub(super) struct Depths {
    pub(super) rows: Vec<f32>,
    columns: Vec<f32>,
}

impl Depths {
    /// Creates it from rows of `width` cells.
    pub(super) fn new(rows: Vec<f32>, width: usize) -> Self {
        let columns = transpose_rows(&rows, width);
        Self { rows, columns }
    }
}

/// Horizons of all cells: workspace shared by the lamps in turn.
#[derive(Debug, Default)]
pub(super) struct Horizons {
    tangent: Vec<f32>,
    distance: Vec<f32>,
}

/// All horizons and visible shares, line by line.
struct Field<'a> {
    grid: &'a Grid,
    axes: Axes,
    /// True if lines are columns.
    columns: bool,
    depth: &'a [f32],
    tangent: &'a mut [f32],
    distance: &'a mut [f32],
    share: Vec<f32>,
}

/// Computes the visible share of the lamp for each cell, row-major.
pub(super) fn trace(grid: &Grid, depths: &Depths, horizons: &mut Horizons) -> Vec<f32> {
    let Axes { outer: (height, lamp_y, _), inner: (width, lamp_x, _) } = grid.rows;
    let beside = lamp_x <= 0.0 || lamp_x > (width - 1) as f32;
    let (across, down) = (lamp_x - 0.5 * width as f32, lamp_y - 0.5 * height as f32);
    if beside && across.abs() > down.abs() {
        let axes = Axes { outer: grid.rows.inner, inner: grid.rows.outer };
        return transpose_rows(&Field::new(grid, axes, true, &depths.columns, horizons).trace(), height);
    }
    Field::new(grid, grid.rows, false, &depths.rows, horizons).trace()
}

/// Transposes rows of `width` values.
fn transpose_rows(values: &[f32], width: usize) -> Vec<f32> {
    let mut turned = vec![0.0; values.len()];
    transpose(values, &mut turned, width, values.len() / width);
    turned
}

/// Finds the first element of `range` for which `holds` is true, given that it is true for all after it; the range's
/// end if there is none.
fn first_of(mut range: Range<usize>, holds: impl Fn(usize) -> bool) -> usize {
    while !range.is_empty() {
        let middle = range.start.midpoint(range.end);
        if holds(middle) { range.end = middle } else { range.start = middle + 1 }
    }
    range.end
}

/// Iterates over indices outwards from a position: first those below it from high to low, then those above it.
fn outwards(place: f32, count: usize) -> impl Iterator<Item = usize> {
    let start = (place.max(0.0).ceil() as usize).min(count);
    (0..start).rev().chain(start..count)
}

impl<'a> Field<'a> {
    fn new(grid: &'a Grid, axes: Axes, columns: bool, depth: &'a [f32], horizons: &'a mut Horizons) -> Self {
        let count = depth.len();
        // Every cell's horizon is written before another cell reads it.
        horizons.tangent.resize(count, 0.0);
        horizons.distance.resize(count, 0.0);
        let Horizons { tangent, distance } = horizons;
        Self { grid, axes, columns, depth, tangent, distance, share: vec![1.0; count] }
    }

    fn trace(mut self) -> Vec<f32> {
        let (lines, lamp, _) = self.axes.outer;
        let count = self.axes.inner.0;
        // For each cell of a line: its own tangent, distance, and the inverse of the number of steps to the lamp.
        let mut own = [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
        for line in outwards(lamp, lines) {
            widest(
                #[inline(always)]
                || self.line_tangents(line, &mut own),
            );
            self.line(line, &own);
        }
        self.share
    }

    #[inline(always)]
    fn line_tangents(&self, line: usize, own: &mut [Vec<f32>; 3]) {
        let ((_, lamp_u, size_u), (count, lamp_v, size_v)) = (self.axes.outer, self.axes.inner);
        let u = lamp_u - line as f32;
        let square = (u * size_u) * (u * size_u);
        let depth = &self.depth[line * count..(line + 1) * count];
        let [tangent, distance, inverse] = own;
        let slots = tangent.iter_mut().zip(distance.iter_mut()).zip(inverse.iter_mut());
        for (i, (((tangent, distance), inverse), depth)) in slots.zip(depth).enumerate() {
            let v = lamp_v - i as f32;
            let away = (v * size_v * (v * size_v) + square).max(1e-14).sqrt();
            *tangent = (depth - self.grid.lamp_depth) / away;
            *distance = away;
            *inverse = 1.0 / u.abs().max(v.abs());
        }
    }

    /// Visits a line's cells: those that step across the lines vectorised, the others one by one outwards from the lamp.
    fn line(&mut self, line: usize, own: &[Vec<f32>; 3]) {
        let ((lines, lamp_u, _), (count, lamp_v, _)) = (self.axes.outer, self.axes.inner);
        let u = lamp_u - line as f32;
        let next = line as isize + u.signum() as isize;
        if !(0..lines as isize).contains(&next) || u.abs() <= 1.0 {
            outwards(lamp_v, count).for_each(|i| self.cell(line, i, own));
            return;
        }
        let looks_across = |i: usize| {
            let v = (lamp_v - i as f32).abs();
            if self.columns { u.abs() >= v } else { u.abs() > v }
        };
        let start = (lamp_v.max(0.0).ceil() as usize).min(count);
        let nearest = lamp_v.round().clamp(0.0, (count - 1) as f32) as usize;
        let (first, last) = if looks_across(nearest) {
            (first_of(0..nearest, looks_across), first_of(nearest..count, |i| !looks_across(i)))
        } else {
            (start, start)
        };
        // Cells before the lamp interpolate with the next one, cells beyond it with the previous one; the border has
        // none.
        let turn = ((lamp_v.floor() + 1.0).clamp(first as f32, last as f32)) as usize;
        let next = next as usize;
        widest(
            #[inline(always)]
            || {
                self.across(line, next, first..turn.min(count - 1), 1, own);
                self.across(line, next, turn.max(1)..last, -1, own);
            },
        );
        if turn == count && turn > first {
            self.cell(line, count - 1, own);
        }
        if turn == 0 && last > 0 {
            self.cell(line, 0, own);
        }
        if first == count {
            self.cell(line, count - 1, own);
        }
        if last == 0 {
            self.cell(line, 0, own);
        }
        self.along(line, next, (0..first.min(count - 1)).rev(), 1, own);
        self.along(line, next, last.max(1)..count, -1, own);
    }

    /// Updates cells of a line that take the horizon from the one at `side` in their own line, and its neighbour in the
    /// line `next`.
    fn along(
        &mut self,
        line: usize,
        next: usize,
        cells: impl Iterator<Item = usize>,
        side: isize,
        own: &[Vec<f32>; 3],
    ) {
        let ((_, lamp_u, _), (count, _, _)) = (self.axes.outer, self.axes.inner);
        let (u, soft) = (lamp_u - line as f32, self.grid.soft);
        let (tangent_from, tangent) = two_lines(self.tangent, next, line, count);
        let (distance_from, distance) = two_lines(self.distance, next, line, count);
        let share = &mut self.share[line * count..][..count];
        let [own, away, inverse] = own.each_ref().map(|line| &line[..count]);
        for i in cells {
            let nearer = i.wrapping_add_signed(side);
            let part = (u * inverse[i]).abs();
            let highest = tangent[nearer] + part * (tangent_from[nearer] - tangent[nearer]);
            let near = away[i] * (1.0 - inverse[i]);
            let met = (distance[nearer] + part * (distance_from[nearer] - distance[nearer])).min(near);
            share[i] = visible_share(own[i], highest, away[i], met, soft);
            let hidden = own[i] < highest;
            tangent[i] = if hidden { highest } else { own[i] };
            distance[i] = if hidden { met } else { away[i] };
        }
    }

    /// Updates cells of a line that take the horizon from the line `next`, between their own index there and the one at
    /// `side`.
    #[inline(always)]
    fn across(&mut self, line: usize, next: usize, cells: Range<usize>, side: isize, own: &[Vec<f32>; 3]) {
        if cells.is_empty() {
            return;
        }
        let (count, lamp_v, _) = self.axes.inner;
        let (soft, columns) = (self.grid.soft, self.columns);
        let beside = cells.start.wrapping_add_signed(side)..cells.end.wrapping_add_signed(side);
        // Both lines are in one array; only one of them is written.
        let (tangent_from, tangent) = two_lines(self.tangent, next, line, count);
        let (distance_from, distance) = two_lines(self.distance, next, line, count);
        let (a_tangent, b_tangent) = (&tangent_from[cells.clone()], &tangent_from[beside.clone()]);
        let (a_distance, b_distance) = (&distance_from[cells.clone()], &distance_from[beside]);
        let (tangent, distance) = (&mut tangent[cells.clone()], &mut distance[cells.clone()]);
        let share = &mut self.share[line * count..][cells.clone()];
        let [own, away, inverse] = own.each_ref().map(|line| &line[cells.clone()]);
        let n = share.len();
        let (a_tangent, b_tangent, a_distance, b_distance) =
            (&a_tangent[..n], &b_tangent[..n], &a_distance[..n], &b_distance[..n]);
        let (tangent, distance) = (&mut tangent[..n], &mut distance[..n]);
        let (own, away, inverse) = (&own[..n], &away[..n], &inverse[..n]);
        for i in 0..n {
            let v = lamp_v - (cells.start + i) as f32;
            let part = (v * inverse[i]).abs();
            // Between the lamp's own two rows neither precedes the other: no interpolation.
            let part = if columns && v.abs() < 1.0 { 0.0 } else { part };
            let highest = a_tangent[i] + part * (b_tangent[i] - a_tangent[i]);
            let near = away[i] * (1.0 - inverse[i]);
            let met = (a_distance[i] + part * (b_distance[i] - a_distance[i])).min(near);
            share[i] = visible_share(own[i], highest, away[i], met, soft);
            let hidden = own[i] < highest;
            tangent[i] = if hidden { highest } else { own[i] };
            distance[i] = if hidden { met } else { away[i] };
        }
    }

    /// Updates a single cell.
    fn cell(&mut self, line: usize, i: usize, own: &[Vec<f32>; 3]) {
        let ((lines, lamp_u, _), (count, lamp_v, _)) = (self.axes.outer, self.axes.inner);
        let (u, v) = (lamp_u - line as f32, lamp_v - i as f32);
        let (own, away, inverse) = (own[0][i], own[1][i], own[2][i]);
        let at = line * count + i;
        (self.tangent[at], self.distance[at]) = (own, away);
        if u.abs().max(v.abs()) <= 1.0 {
            return;
        }
        let near = away * (1.0 - inverse);
        let look = |line: isize, i: isize| {
            if (0..lines as isize).contains(&line) && (0..count as isize).contains(&i) {
                let at = line as usize * count + i as usize;
                Edge { tangent: self.tangent[at], distance: self.distance[at] }
            } else {
                Edge { tangent: -self.grid.lamp_depth / near, distance: near }
            }
        };
        let (next_line, next) = (line as isize + u.signum() as isize, i as isize + v.signum() as isize);
        let (across, down) = if self.columns { (u, v) } else { (v, u) };
        let along_row = across.abs() >= down.abs();
        // Between the lamp's own two rows neither precedes the other: no interpolation.
        let part = match along_row {
            true if down.abs() < 1.0 => 0.0,
            true => (down * inverse).abs(),
            false => (across * inverse).abs(),
        };
        let looks_across = along_row == self.columns;
        let a = if looks_across { look(next_line, i as isize) } else { look(line as isize, next) };
        let b = look(next_line, next);
        let highest = a.tangent + part * (b.tangent - a.tangent);
        let met = (a.distance + part * (b.distance - a.distance)).min(near);
        self.share[at] = visible_share(own, highest, away, met, self.grid.soft);
        if own < highest {
            (self.tangent[at], self.distance[at]) = (highest, met);
        }
    }
}

/// Computes the visible share of the lamp over the highest tangent on the way, at distance `met`, for a point at
/// distance `away`.
#[inline(always)]
fn visible_share(own: f32, highest: f32, away: f32, met: f32, soft: f32) -> f32 {
    // The lamp's part over the edge is (own - highest) away met / (away - met) / size, and only matters below 1.
    let (reach, gap) = ((own - highest) * away * met * soft, away - met);
    let seen = 0.5 * ((reach / gap).max(-1.0) + 1.0);
    if reach < gap { seen * seen * (3.0 - 2.0 * seen) } else { 1.0 }
}

/// Splits off a line to read and another one to write.
#[inline(always)]
fn two_lines(all: &mut [f32], from: usize, to: usize, count: usize) -> (&[f32], &mut [f32]) {
    if from < to {
        let (low, high) = all.split_at_mut(to * count);
        (&low[from * count..(from + 1) * count], &mut high[..count])
    } else {
        let (low, high) = all.split_at_mut(from * count);
        (&high[..count], &mut low[to * count..(to + 1) * count])
    }
}
