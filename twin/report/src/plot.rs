//! Line plots as pictures: axes with round ticks, one colour per line, names on the right.
//!
//! Written by hand: plotters needs a font for its bitmaps, or a custom backend longer than this file.

use image::{Rgb, RgbImage};

use crate::lettering::{TEXT_COLOR, text};

const WIDTH: u32 = 640;
const HEIGHT: u32 = 420;
const LEFT: f64 = 64.0;
const RIGHT: f64 = WIDTH as f64 - 150.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = HEIGHT as f64 - 52.0;
const GRID_COLOR: [u8; 3] = [225, 226, 228];
const LINE_COLORS: [[u8; 3]; 6] =
    [[31, 99, 170], [206, 92, 28], [52, 140, 72], [150, 70, 150], [120, 120, 120], [180, 150, 30]];

pub struct Plot {
    /// Title above the plot.
    pub title: String,
    /// Label below the horizontal axis.
    pub x: String,
    /// Label above the vertical axis.
    pub y: String,
    /// Name and points of each line.
    pub lines: Vec<(String, Vec<[f64; 2]>)>,
}

impl Plot {
    pub fn draw(&self) -> RgbImage {
        let mut image = RgbImage::from_pixel(WIDTH, HEIGHT, Rgb([255, 255, 255]));
        let range = |axis: usize| {
            let values = || self.lines.iter().flat_map(|(_, points)| points).map(move |point| point[axis]);
            let (low, high) = (values().fold(0.0, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
            if high > low { (low, high) } else { (low, low + 1.0) }
        };
        let (xs, ys) = (range(0), range(1));
        let across = |x: f64| LEFT + (x - xs.0) / (xs.1 - xs.0) * (RIGHT - LEFT);
        let down = |y: f64| BOTTOM - (y - ys.0) / (ys.1 - ys.0) * (BOTTOM - TOP);
        for x in ticks(xs) {
            line(&mut image, [across(x), TOP], [across(x), BOTTOM], GRID_COLOR);
            text(&mut image, (across(x) as i64 - 12, BOTTOM as i64 + 8), &label(x), TEXT_COLOR);
        }
        for y in ticks(ys) {
            line(&mut image, [LEFT, down(y)], [RIGHT, down(y)], GRID_COLOR);
            text(&mut image, (8, down(y) as i64 - 7), &format!("{:>6}", label(y)), TEXT_COLOR);
        }
        line(&mut image, [LEFT, TOP], [LEFT, BOTTOM], TEXT_COLOR);
        line(&mut image, [LEFT, BOTTOM], [RIGHT, BOTTOM], TEXT_COLOR);
        text(&mut image, (8, 4), &self.title, TEXT_COLOR);
        text(&mut image, (8, 20), &self.y, TEXT_COLOR);
        text(&mut image, (LEFT as i64, BOTTOM as i64 + 28), &self.x, TEXT_COLOR);
        for (n, (name, points)) in self.lines.iter().enumerate() {
            let color = LINE_COLORS[n % LINE_COLORS.len()];
            for pair in points.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|p| [across(p[0]), down(p[1])]);
                line(&mut image, a, b, color);
                line(&mut image, [a[0], a[1] + 1.0], [b[0], b[1] + 1.0], color);
            }
            if points.len() < 30 {
                for p in points {
                    let (x, y) = (across(p[0]), down(p[1]));
                    line(&mut image, [x - 2.0, y - 2.0], [x + 3.0, y + 3.0], color);
                    line(&mut image, [x - 2.0, y + 3.0], [x + 3.0, y - 2.0], color);
                }
            }
            text(&mut image, (RIGHT as i64 + 10, TOP as i64 + 14 * n as i64), name, color);
        }
        image
    }
}

/// Returns round values that divide the range into 4 to 10 parts.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let rough = (high - low) / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|s| s * power >= rough).unwrap_or(10.0);
    let first = (low / step - 1e-9).ceil() as i64;
    (first..).map(|n| n as f64 * step).take_while(|tick| *tick <= high + 1e-9 * step).collect()
}

fn label(value: f64) -> String {
    if value == 0.0 || value.abs() >= 10.0 { format!("{value:.0}") } else { format!("{value:.2}") }
}

fn line(image: &mut RgbImage, a: [f64; 2], b: [f64; 2], color: [u8; 3]) {
    let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil().max(1.0) as usize;
    for n in 0..=steps {
        let part = n as f64 / steps as f64;
        let (x, y) = (a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]));
        if x >= 0.0 && y >= 0.0 && (x as u32) < image.width() && (y as u32) < image.height() {
            image.put_pixel(x as u32, y as u32, Rgb(color));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks((0.0, 90.0)), [0.0, 20.0, 40.0, 60.0, 80.0]);
        let small = ticks((-0.013, 0.02));
        assert!(small.contains(&0.0) && small.iter().all(|tick| (-0.0131..=0.0201).contains(tick)), "{small:?}");
    }

    /// Lines cross the plot area from corner to corner, in their colours.
    #[test]
    fn a_line_is_drawn_in_its_color_between_its_ends() {
        let plot = Plot {
            title: "t".into(),
            x: "x".into(),
            y: "y".into(),
            lines: vec![("a".into(), vec![[0.0, 0.0], [1.0, 2.0]]), ("b".into(), vec![[0.0, 2.0], [1.0, 0.0]])],
        };
        let image = plot.draw();
        let near = |color: [u8; 3], x: f64, y: f64| {
            let (x, y) = (x as u32, y as u32);
            (x - 6..x + 6).any(|x| (y - 6..y + 6).any(|y| image.get_pixel(x, y).0 == color))
        };
        assert!(near(LINE_COLORS[0], LEFT, BOTTOM) && near(LINE_COLORS[0], RIGHT, TOP), "a rises");
        assert!(near(LINE_COLORS[1], LEFT, TOP) && near(LINE_COLORS[1], RIGHT, BOTTOM), "b falls");
        assert!(!near(LINE_COLORS[0], LEFT, TOP) && !near(LINE_COLORS[1], RIGHT, TOP));
    }
}
