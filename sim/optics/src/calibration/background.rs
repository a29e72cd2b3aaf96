//! The untouched gel, estimated from the presses.
//!
//! Each pixel takes its median over the presses far from it. That has less noise than a single frame, and shows the gel
//! in the state it has while something presses elsewhere. Lamps and exposure drift between frames, and each pixel has a
//! different set of far presses. Therefore each frame is first divided by its brightness relative to the background
//! image, a polynomial in image position fitted to its untouched pixels. Otherwise the sets' borders would be edges in
//! the result. Finally the presses' mean brightness is restored.

use nalgebra::{SMatrix, SVector};

use crate::calibration::folder::{BallPress, PressFolder};
use crate::calibration::samples::UNTOUCHED_RADII;

/// Smallest number of presses that must leave a pixel untouched for their median to be its background.
const MIN_UNTOUCHED_PRESSES: usize = 3;
/// Coefficients of a brightness polynomial: 1, u, v, u^2, uv, v^2.
const TERM_COUNT: usize = 6;
/// Stride of the pixels used for a fit, along both axes.
const PIXEL_STRIDE: usize = 4;
/// Grey level below which a pixel gives no reliable ratio.
const MIN_GREY_LEVEL: u8 = 12;
/// Outlier threshold: a pixel whose ratio is farther from the polynomial than this many median deviations (a shadow, or
/// gel that moved) is left out of the second fit.
const OUTLIER_THRESHOLD: f64 = 4.0;

type Terms = SVector<f64, TERM_COUNT>;

/// Brightness of the three channels relative to the background image.
type Brightness = [Terms; 3];

/// Estimates the untouched gel (row-major RGB, grey levels). Pixels that too few presses leave untouched take the
/// background image's value, scaled to the mean brightness of the presses.
pub fn estimate_background(folder: &PressFolder) -> Vec<f32> {
    let (width, height) = (folder.background.width, folder.background.height);
    let terms = |column: usize, row: usize| terms(column, row, [width, height]);
    let brightness: Vec<Brightness> = folder.presses.iter().map(|press| brightness(folder, press)).collect();
    let mut mean = [Terms::zeros(); 3];
    for (c, mean) in mean.iter_mut().enumerate() {
        let sum: Terms = brightness.iter().map(|of_press| of_press[c]).sum();
        *mean = if brightness.is_empty() { constant_term() } else { sum / brightness.len() as f64 };
    }
    let mut background = Vec::with_capacity(folder.background.rgb.len());
    let (mut far, mut values) = (Vec::new(), Vec::new());
    for pixel in 0..width * height {
        let (column, row) = (pixel % width, pixel / width);
        let at = terms(column, row);
        far.clear();
        far.extend((0..folder.presses.len()).filter(|&n| untouched(&folder.presses[n], column, row)));
        for c in 0..3 {
            let one = f64::from(folder.background.rgb[3 * pixel + c]);
            let own = if far.len() < MIN_UNTOUCHED_PRESSES {
                one
            } else {
                let value =
                    |&n: &usize| f64::from(folder.presses[n].photo.rgb[3 * pixel + c]) / brightness[n][c].dot(&at);
                values.clear();
                values.extend(far.iter().map(value));
                median(&mut values)
            };
            background.push((own * mean[c].dot(&at)).clamp(0.0, 255.0) as f32);
        }
    }
    background
}

fn untouched(press: &BallPress, column: usize, row: usize) -> bool {
    (press.center[0] - column as f64).hypot(press.center[1] - row as f64) > UNTOUCHED_RADII * press.radius
}

fn terms(column: usize, row: usize, [width, height]: [usize; 2]) -> Terms {
    let place = |at: usize, size: usize| 2.0 * (at as f64 + 0.5) / size as f64 - 1.0;
    let (u, v) = (place(column, width), place(row, height));
    Terms::from([1.0, u, v, u * u, u * v, v * v])
}

fn constant_term() -> Terms {
    let mut terms = Terms::zeros();
    terms[0] = 1.0;
    terms
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let (low, high) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
    0.5 * (low + high)
}

/// Estimates a press's brightness from its untouched pixels; that of the background if there are too few.
fn brightness(folder: &PressFolder, press: &BallPress) -> Brightness {
    let (width, height) = (folder.background.width, folder.background.height);
    std::array::from_fn(|c| {
        let mut ratios = Vec::new();
        for row in (0..height).step_by(PIXEL_STRIDE) {
            for column in (0..width).step_by(PIXEL_STRIDE) {
                let at = 3 * (row * width + column) + c;
                let before = folder.background.rgb[at];
                // A saturated pixel shows the sensor's limit, not its brightness.
                if before > MIN_GREY_LEVEL && before < 250 && press.photo.rgb[at] < 250 && untouched(press, column, row)
                {
                    let ratio = f64::from(press.photo.rgb[at]) / f64::from(before);
                    ratios.push((terms(column, row, [width, height]), ratio));
                }
            }
        }
        let Some(first) = fit_terms(&ratios) else { return constant_term() };
        let off = |(terms, ratio): &(Terms, f64)| (ratio - first.dot(terms)).abs();
        let typical = median(&mut ratios.iter().map(off).collect::<Vec<f64>>());
        ratios.retain(|pair| off(pair) <= OUTLIER_THRESHOLD * typical);
        let found = fit_terms(&ratios).unwrap_or(first);
        // Far from any untouched pixel, a polynomial may diverge.
        let corners = [(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1), (width / 2, height / 2)];
        let sane = corners.iter().all(|&(x, y)| (0.3..3.0).contains(&found.dot(&terms(x, y, [width, height]))));
        if sane { found } else { constant_term() }
    })
}

/// Fits by least squares; `None` with too few points.
fn fit_terms(points: &[(Terms, f64)]) -> Option<Terms> {
    if points.len() < 20 * TERM_COUNT {
        return None;
    }
    let mut normal = SMatrix::<f64, TERM_COUNT, TERM_COUNT>::zeros();
    let mut right = Terms::zeros();
    for (terms, value) in points {
        normal += terms * terms.transpose();
        right += terms * *value;
    }
    Some(normal.cholesky()?.solve(&right))
}
