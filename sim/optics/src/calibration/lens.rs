//! Lens distortion: mapping between a camera's raw image and the rectified one.
//!
//! The model of Brown and Conrady, as in Zhang's calibration. With `x = (u - c_x) / f_x`, `y` likewise and `r2 = x^2 +
//! y^2`, a point of the rectified image appears in the raw image at `x (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 x y + p2
//! (r2 + 2 x^2)`, and y with p1 and p2 exchanged.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::calibration::photo::Photo;
use crate::error::OpticsError;

/// Intrinsics of a camera with its distortion; the same intrinsics hold for raw and rectified images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Focal lengths across and down, pixels.
    pub focal: [f64; 2],
    /// Principal point: column and row, pixels; pixel centres are whole numbers.
    pub center: [f64; 2],
    /// Radial coefficients k1, k2, k3.
    pub radial: [f64; 3],
    /// Tangential coefficients p1, p2.
    pub tangential: [f64; 2],
}

/// Largest number of fixed-point iterations for inverting the distortion, and their tolerance, pixels.
const MAX_ITERATIONS: usize = 50;
const PIXEL_TOLERANCE: f64 = 1e-6;

impl Lens {
    /// Reads a TOML file with the four fields.
    pub fn read(path: &Path) -> Result<Self, OpticsError> {
        let text = std::fs::read_to_string(path).map_err(|error| OpticsError::file(path, error))?;
        toml::from_str(&text).map_err(|error| OpticsError::file(path, error))
    }

    /// Checks for impossible values, and for a lens that folds an image of this size over itself.
    pub fn check(&self, width: usize, height: usize) -> Result<(), OpticsError> {
        let fault = |what: String| Err(OpticsError::Calibration(format!("lens.{what}")));
        let all = [&self.focal[..], &self.center, &self.radial, &self.tangential].concat();
        if all.iter().any(|value| !value.is_finite()) {
            return fault(format!("focal, center, radial, tangential: found {all:?}; expected finite numbers"));
        }
        if self.focal.iter().any(|focal| *focal <= 0.0) {
            return fault(format!("focal: found {:?}; expected positive numbers", self.focal));
        }
        let (w, h) = (width as f64 - 1.0, height as f64 - 1.0);
        for place in [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [0.5 * w, 0.0], [0.0, 0.5 * h]] {
            let back = self.distort_point(self.rectify_point(place));
            if (back[0] - place[0]).hypot(back[1] - place[1]).is_nan()
                || (back[0] - place[0]).hypot(back[1] - place[1]) > 1e-3
            {
                return fault(format!("radial, tangential: the point {place:?} px has no rectified counterpart"));
            }
        }
        Ok(())
    }

    /// Maps a point of the rectified image to the raw one, pixels.
    pub fn distort_point(&self, place: [f64; 2]) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| (place[axis] - self.center[axis]) / self.focal[axis]);
        let r2 = x * x + y * y;
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let moved = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        [0, 1].map(|axis| self.center[axis] + self.focal[axis] * moved[axis])
    }

    /// Maps a point of the raw image to the rectified one, pixels.
    pub fn rectify_point(&self, place: [f64; 2]) -> [f64; 2] {
        let mut found = place;
        for _ in 0..MAX_ITERATIONS {
            let there = self.distort_point(found);
            let off = [place[0] - there[0], place[1] - there[1]];
            found = [found[0] + off[0], found[1] + off[1]];
            if off[0].hypot(off[1]) < PIXEL_TOLERANCE {
                break;
            }
        }
        found
    }

    /// Rectifies a raw image.
    pub fn rectify(&self, raw: &Photo) -> Photo {
        resample(raw, |place| self.distort_point(place))
    }

    /// Distorts a rectified image to the raw one.
    pub fn distort(&self, rectified: &Photo) -> Photo {
        resample(rectified, |place| self.rectify_point(place))
    }
}

/// Resamples `from`: each pixel takes the value at `origin(pixel)`, bilinear, with the border pixels extended outwards.
fn resample(from: &Photo, origin: impl Fn([f64; 2]) -> [f64; 2]) -> Photo {
    let (w, h) = (from.width, from.height);
    let mut rgb = Vec::with_capacity(from.rgb.len());
    for at in 0..w * h {
        let [column, row] = origin([(at % w) as f64, (at / w) as f64]);
        let (column, row) = (column.clamp(0.0, (w - 1) as f64), row.clamp(0.0, (h - 1) as f64));
        let (c, r) = (column as usize, row as usize);
        let (u, v) = (column - c as f64, row - r as f64);
        let (right, below) = ((c + 1).min(w - 1), (r + 1).min(h - 1));
        let corners = [from.pixel(c, r), from.pixel(right, r), from.pixel(c, below), from.pixel(right, below)];
        for channel in 0..3 {
            let [a, b, c, d] = corners.map(|pixel| f64::from(pixel[channel]));
            rgb.push(((1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)).round() as u8);
        }
    }
    Photo { width: w, height: h, rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens {
        focal: [260.0, 255.0],
        center: [161.0, 118.0],
        radial: [-0.25, 0.06, -0.01],
        tangential: [0.002, -0.001],
    };

    #[test]
    fn rectifying_undoes_distorting() {
        assert!(LENS.check(320, 240).is_ok());
        for place in [[0.0, 0.0], [319.0, 5.0], [161.0, 118.0], [40.0, 200.0]] {
            let back = LENS.rectify_point(LENS.distort_point(place));
            assert!((back[0] - place[0]).hypot(back[1] - place[1]) < 1e-4, "{place:?} {back:?}");
        }
        // A barrel lens draws the border inwards, by k1 r^2 to first order.
        let [x, _] = Lens { radial: [-0.1, 0.0, 0.0], tangential: [0.0; 2], ..LENS }.distort_point([291.0, 118.0]);
        assert!((x - (161.0 + 130.0 * (1.0 - 0.1 * 0.25))).abs() < 1e-9, "{x}");
    }

    #[test]
    fn an_image_comes_back() {
        let (w, h) = (320, 240);
        let wave = |at: usize, c: usize| {
            let (x, y) = ((at % w) as f64, (at / w) as f64);
            (127.0 + 90.0 * (0.04 * x + c as f64).sin() * (0.05 * y).cos()) as u8
        };
        let rgb = (0..3 * w * h).map(|i| wave(i / 3, i % 3)).collect();
        let image = Photo { width: w, height: h, rgb };
        let raw = LENS.distort(&image);
        assert_ne!(raw, image);
        let back = LENS.rectify(&raw);
        // Content beyond the border of the raw image is lost.
        for row in 40..h - 40 {
            for column in 50..w - 50 {
                let (a, b) = (image.pixel(column, row), back.pixel(column, row));
                assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 3), "{column} {row}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn a_lens_that_folds_is_refused() {
        let error = Lens { radial: [-3.0, 0.0, 0.0], ..LENS }.check(320, 240).unwrap_err().to_string();
        assert!(error.contains("lens.radial"), "{error}");
        let error = Lens { focal: [0.0, 1.0], ..LENS }.check(320, 240).unwrap_err().to_string();
        assert!(error.contains("lens.focal"), "{error}");
    }
}
