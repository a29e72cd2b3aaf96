//! Detection of a ball's press in an image without a label.
//!
//! The image differs most from the background where the ball presses. The pixels' differences, summed over channels and
//! smoothed, are thresholded at 0.4 of their peak. The circle enclosing the largest connected patch is the initial
//! estimate; it is then moved and scaled to where the change falls off most steeply around its rim.

use crate::calibration::photo::Photo;

/// A circle in an image, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Column and row, pixels.
    pub center: [f64; 2],
    /// Radius, pixels.
    pub radius: f64,
}

/// Reason why no circle was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CircleNotFound {
    /// Hardly anything differs from the background.
    #[error(
        "no contact found: the image differs from the background by {found:.1} grey levels at most; expected at least {expected:.1}"
    )]
    NoContact {
        /// Largest smoothed difference, grey levels.
        found: f64,
        /// Smallest difference that a press would cause, grey levels.
        expected: f64,
    },
    /// The changed area is not round.
    #[error("no ball found: the changed area covers {found:.2} of its circle; expected at least {expected:.2}")]
    NotRound {
        /// Share of the circle that the area covers.
        found: f64,
        /// Smallest share that a ball would cover.
        expected: f64,
    },
}

/// Smallest smoothed difference of a press, summed over channels, grey levels.
const MIN_DIFFERENCE: f64 = 20.0;
/// Fraction of the peak above which a pixel counts as changed.
const CHANGE_LEVEL: f64 = 0.4;
/// Smallest share of the circle that a ball's changed area covers.
const MIN_COVERAGE: f64 = 0.4;

/// Finds the one press in an image of the background's size.
pub fn find_circle(photo: &Photo, background: &Photo) -> Result<Circle, CircleNotFound> {
    let (w, h) = (photo.width, photo.height);
    let change = smoothed_change(photo, background, (w.min(h) / 100).max(1));
    let mut sorted = change.clone();
    sorted.sort_by(f64::total_cmp);
    let peak = sorted[sorted.len() - 1 - sorted.len() / 200];
    if peak < MIN_DIFFERENCE {
        return Err(CircleNotFound::NoContact { found: peak, expected: MIN_DIFFERENCE });
    }
    let patch = largest_patch(&change, w, h, CHANGE_LEVEL * peak);
    let start = enclosing_circle(&patch, w);
    let circle = refine_circle(&change, w, h, start);
    let covered = patch.iter().filter(|&&at| {
        let (x, y) = ((at % w) as f64 - circle.center[0], (at / w) as f64 - circle.center[1]);
        x.hypot(y) <= circle.radius
    });
    // A ball's level centre may not change colour, so only the outer ring is tested.
    let inside = (0..w * h).filter(|at| {
        let (x, y) = ((at % w) as f64 - circle.center[0], (at / w) as f64 - circle.center[1]);
        (0.6 * circle.radius..circle.radius).contains(&x.hypot(y))
    });
    let outer: Vec<usize> = inside.collect();
    let in_ring = covered.filter(|at| outer.binary_search(at).is_ok()).count();
    let found = in_ring as f64 / outer.len().max(1) as f64;
    if found < MIN_COVERAGE {
        return Err(CircleNotFound::NotRound { found, expected: MIN_COVERAGE });
    }
    Ok(circle)
}

/// Computes the absolute difference from the background, less its median, summed over channels and averaged over a
/// square of side `2 radius + 1`.
fn smoothed_change(photo: &Photo, background: &Photo, radius: usize) -> Vec<f64> {
    let (w, h) = (photo.width, photo.height);
    let mut change = vec![0.0; w * h];
    for channel in 0..3 {
        let difference =
            |at: usize| i16::from(photo.rgb[3 * at + channel]) - i16::from(background.rgb[3 * at + channel]);
        let mut sorted: Vec<i16> = (0..w * h).map(difference).collect();
        let middle = sorted.len() / 2;
        let drift = *sorted.select_nth_unstable(middle).1;
        change.iter_mut().enumerate().for_each(|(at, sum)| *sum += f64::from((difference(at) - drift).abs()));
    }
    // Integral image, preceded by a row and a column of zeros.
    let mut integral = vec![0.0; (w + 1) * (h + 1)];
    for row in 0..h {
        let mut line = 0.0;
        for column in 0..w {
            line += change[row * w + column];
            integral[(row + 1) * (w + 1) + column + 1] = integral[row * (w + 1) + column + 1] + line;
        }
    }
    for row in 0..h {
        for column in 0..w {
            let (top, bottom) = (row.saturating_sub(radius), (row + radius + 1).min(h));
            let (left, right) = (column.saturating_sub(radius), (column + radius + 1).min(w));
            let at = |r: usize, c: usize| integral[r * (w + 1) + c];
            let sum = at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left);
            change[row * w + column] = sum / ((bottom - top) * (right - left)) as f64;
        }
    }
    change
}

/// Returns the pixels of the largest connected area above a level.
fn largest_patch(change: &[f64], w: usize, h: usize, level: f64) -> Vec<usize> {
    let mut seen = vec![false; w * h];
    let mut best = Vec::new();
    for start in 0..w * h {
        if seen[start] || change[start] <= level {
            continue;
        }
        seen[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            let (column, row) = (at % w, at / w);
            let neighbours = [
                (column > 0).then(|| at - 1),
                (column + 1 < w).then_some(at + 1),
                (row > 0).then(|| at - w),
                (row + 1 < h).then_some(at + w),
            ];
            for at in neighbours.into_iter().flatten() {
                if !seen[at] && change[at] > level {
                    seen[at] = true;
                    patch.push(at);
                }
            }
        }
        if patch.len() > best.len() {
            best = patch;
        }
    }
    best
}

/// Computes the circle with the centre and half the mean size of a patch's bounding box.
fn enclosing_circle(patch: &[usize], w: usize) -> Circle {
    let fold = |value: fn(usize, usize) -> usize| {
        let all = || patch.iter().map(|&at| value(at, w) as f64);
        (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max))
    };
    let (x, y) = (fold(|at, w| at % w), fold(|at, w| at / w));
    Circle { center: [0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1)], radius: 0.25 * (x.1 - x.0 + y.1 - y.0 + 2.0) }
}

/// Moves a circle to where the change falls off most steeply outwards, all around.
fn refine_circle(change: &[f64], w: usize, h: usize, start: Circle) -> Circle {
    let value = |x: f64, y: f64| {
        let (column, row) = (x.round(), y.round());
        let inside = column >= 0.0 && row >= 0.0 && column < w as f64 && row < h as f64;
        inside.then(|| change[row as usize * w + column as usize])
    };
    let score = |c: &Circle| {
        let width = 0.12 * c.radius;
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..90 {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 90.0).sin_cos();
            let at = |r: f64| value(c.center[0] + r * cos, c.center[1] + r * sin);
            if let (Some(inner), Some(outer)) = (at(c.radius - width), at(c.radius + width)) {
                sum += inner - outer;
                count += 1.0;
            }
        }
        // A circle mostly outside the image would be scored by a few rays.
        if count < 30.0 { f64::NEG_INFINITY } else { sum / count }
    };
    let mut best = (score(&start), start);
    let mut step = 0.25 * start.radius;
    while step > 0.2 {
        let around = best.1;
        let mut moved = false;
        for (dx, dy, dr) in
            [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, -0.5)]
        {
            let center = [around.center[0] + step * dx, around.center[1] + step * dy];
            let trial = Circle { center, radius: (around.radius + step * dr).max(2.0) };
            let found = score(&trial);
            if found > best.0 {
                best = (found, trial);
                moved = true;
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Renders a press with the given circle, tinted by slope, and a grey background, both with a little noise.
    fn pair(circle: &Circle, strength: f64) -> (Photo, Photo) {
        let (w, h) = (320, 240);
        let mut state = 7u32;
        let mut noise = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 24) / 64.0 - 2.0
        };
        let mut photo = |strength: f64| {
            let mut rgb = Vec::new();
            for at in 0..w * h {
                let (x, y) = ((at % w) as f64 - circle.center[0], (at / w) as f64 - circle.center[1]);
                let r = x.hypot(y) / circle.radius;
                let tint = if r < 1.0 { strength } else { strength * 0.3 * (-(r - 1.0) * 4.0).exp() };
                let angle = y.atan2(x);
                for c in 0..3 {
                    let value = 120.0 + tint * r.min(1.0) * (angle - 2.1 * f64::from(c)).cos() + noise();
                    rgb.push(value.round() as u8);
                }
            }
            Photo { width: w, height: h, rgb }
        };
        (photo(strength), photo(0.0))
    }

    #[test]
    fn finds_the_circle() {
        for circle in [
            Circle { center: [150.0, 110.0], radius: 31.0 },
            Circle { center: [60.5, 180.2], radius: 40.0 },
            Circle { center: [300.0, 120.0], radius: 35.0 }, // cut by the border
        ] {
            let (press, background) = pair(&circle, 60.0);
            let found = find_circle(&press, &background).unwrap();
            let off = (found.center[0] - circle.center[0]).hypot(found.center[1] - circle.center[1]);
            assert!(off < 2.0 && (found.radius / circle.radius - 1.0).abs() < 0.12, "{found:?} for {circle:?}");
        }
    }

    #[test]
    fn no_press_is_an_error() {
        let (press, background) = pair(&Circle { center: [150.0, 110.0], radius: 31.0 }, 0.0);
        assert!(matches!(find_circle(&press, &background), Err(CircleNotFound::NoContact { .. })));
    }
}
