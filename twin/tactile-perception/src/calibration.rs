//! Photometric model: maps the colour change of a pixel and its position to the slope of the gel.
//!
//! A press of a body of known shape at a known position labels every pixel with the true slope. The model is linear in
//! features of the relative colour change (up to third order) times features of the position (up to second order), fitted
//! by ridge regression. It predicts the x and y components of the unit normal, in which a Lambertian surface's brightness
//! is linear and which stay bounded on steep flanks, and converts them to gradients. All features vanish with the colour
//! change, so an untouched pixel is level.

use std::collections::BTreeMap;
use std::path::Path;

use ftac_platform::file::write_atomically;
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::PIXELS;
use crate::colour_change::{ImageChange, colour_change};
use crate::error::TouchError;

/// Number of features of the colour change.
pub const COLOUR_FEATURES: usize = 19;
/// Number of features of the position: 1, u, v, u^2, uv, v^2.
pub const POSITION_FEATURES: usize = 6;
const FEATURE_COUNT: usize = COLOUR_FEATURES * POSITION_FEATURES;
const VERSION: u32 = 1;
/// Ridge parameter of a fit to presses alone, and of a fit to the change of a model, relative to each feature's own
/// energy in the presses. The larger one keeps the features of steep slopes, which a ball shows only at its contact's
/// rim, near those of the model.
const FIT_RIDGE: f64 = 1e-5;
const CORRECTION_RIDGE: f64 = 0.1;
/// Largest sine of a predicted slope angle.
pub(crate) const MAX_SLOPE_SINE: f32 = 0.95;

/// A labelled press.
#[derive(Debug, Clone)]
pub struct CalibrationPress {
    /// Index of the camera.
    pub camera: usize,
    /// The image under the press.
    pub image: std::sync::Arc<TactileImage>,
    /// The image of the untouched pad.
    pub background: std::sync::Arc<TactileImage>,
    /// Indentation of the gel's surface, m, [`PIXELS`] values as in the image.
    pub indentation: Vec<f32>,
}

/// The model of one sensor configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotometricModel {
    /// Weights of the position features for each colour feature, for the x and y components of the normal.
    weights: Vec<[[f32; 2]; POSITION_FEATURES]>,
}

/// Photometric models of a hand, one per sensor configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotometricCalibration {
    /// Version of the file format.
    pub version: u32,
    /// Models by the letter of the configuration, a to f.
    pub configurations: BTreeMap<char, PhotometricModel>,
}

/// Angle between predicted and true surface normals over contact pixels, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[allow(missing_docs)]
pub struct AngularError {
    pub mean: f64,
    pub median: f64,
    pub p95: f64,
    pub pixels: usize,
}

impl AngularError {
    /// Computes the statistics of angles, degrees.
    pub fn from_angles(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let at = |fraction: f64| errors.get((fraction * errors.len() as f64) as usize).copied().unwrap_or(f64::NAN);
        Self {
            mean: errors.iter().sum::<f64>() / errors.len() as f64,
            median: at(0.5),
            p95: at(0.95),
            pixels: errors.len(),
        }
    }
}

/// Pixels of a press that are in contact, without the image border.
pub fn contact_pixels(press: &CalibrationPress) -> impl Iterator<Item = usize> {
    let inside = |i: &usize| (1..N - 1).contains(&(i % N)) && (1..N - 1).contains(&(i / N));
    (0..PIXELS).filter(inside).filter(|&i| press.indentation[i] > 0.0)
}

/// Angle (degrees) at pixel `i` of a press between the true normal and that of a surface with slopes `found`; `pixel` is the
/// pixels' size (dx, dy; m).
pub fn angle(press: &CalibrationPress, i: usize, pixel: (f64, f64), [px, py]: [f64; 2]) -> f64 {
    let (gx, gy) = slope(&press.indentation, i, pixel);
    let cross = ((gy - py).powi(2) + (px - gx).powi(2) + (gx * py - gy * px).powi(2)).sqrt();
    cross.atan2(gx * px + gy * py + 1.0).to_degrees()
}

/// Number of pixels that are computed together.
const LANES: usize = 8;

/// Features of colour changes, pixel by pixel: first, second and third order.
fn colour_features<const M: usize>([r, g, b]: [[f32; M]; 3]) -> [[f32; M]; COLOUR_FEATURES] {
    let times = |a: [f32; M], b: [f32; M]| -> [f32; M] { std::array::from_fn(|k| a[k] * b[k]) };
    let (rr, gg, bb, rg, rb, gb) = (times(r, r), times(g, g), times(b, b), times(r, g), times(r, b), times(g, b));
    let third = [(rr, r), (gg, g), (bb, b), (rr, g), (rr, b), (gg, r), (gg, b), (bb, r), (bb, g), (rg, b)];
    let [rrr, ggg, bbb, rrg, rrb, ggr, ggb, bbr, bbg, rgb] = third.map(|(a, b)| times(a, b));
    [r, g, b, rr, gg, bb, rg, rb, gb, rrr, ggg, bbb, rrg, rrb, ggr, ggb, bbr, bbg, rgb]
}

/// Normalised position of a pixel, -1 to 1: u to the right (pad x), v up (pad y).
fn normalised_position(column: usize, row: usize) -> (f32, f32) {
    let half = 0.5 * N as f32;
    ((column as f32 + 0.5) / half - 1.0, 1.0 - (row as f32 + 0.5) / half)
}

/// The model for one image row: with v substituted, the weights are quadratics in u.
pub(crate) struct RowModel([[[f32; 2]; 3]; COLOUR_FEATURES]);

impl RowModel {
    /// x and y components of the normals of consecutive pixels from `column` on, from their relative colour changes.
    pub(crate) fn normals(&self, column: usize, changes: &[[f32; 3]], mut found: impl FnMut(usize, [f32; 2])) {
        for (chunk, changes) in changes.chunks(LANES).enumerate() {
            let at = |lane: usize| changes.get(lane).copied().unwrap_or_default();
            let u: [f32; LANES] = std::array::from_fn(|lane| normalised_position(column + chunk * LANES + lane, 0).0);
            let features =
                colour_features::<LANES>([0, 1, 2].map(|channel| std::array::from_fn(|lane| at(lane)[channel])));
            let (mut nx, mut ny) = ([0.0f32; LANES], [0.0f32; LANES]);
            for (feature, [w0, w1, w2]) in features.iter().zip(&self.0) {
                for lane in 0..LANES {
                    nx[lane] += feature[lane] * (w0[0] + u[lane] * (w1[0] + u[lane] * w2[0]));
                    ny[lane] += feature[lane] * (w0[1] + u[lane] * (w1[1] + u[lane] * w2[1]));
                }
            }
            for lane in 0..changes.len() {
                found(chunk * LANES + lane, limit_slope([nx[lane], ny[lane]]));
            }
        }
    }

    /// x and y components of the normal of one pixel, unbounded: on steep slopes they may exceed those of a unit
    /// vector.
    fn unbounded(&self, column: usize, change: [f32; 3]) -> [f64; 2] {
        let (u, _) = normalised_position(column, 0);
        let mut normal = [0.0; 2];
        for ([feature], [w0, w1, w2]) in colour_features(change.map(|value| [value])).iter().zip(&self.0) {
            for axis in 0..2 {
                normal[axis] += f64::from(feature * (w0[axis] + u * (w1[axis] + u * w2[axis])));
            }
        }
        normal
    }

    /// Gradients (dh/dx, dh/dy) of consecutive pixels from `column` on.
    pub(crate) fn gradients(&self, column: usize, changes: &[[f32; 3]], gx: &mut [f32], gy: &mut [f32]) {
        self.normals(column, changes, |i, normal| [gx[i], gy[i]] = gradient_from_normal(normal));
    }
}

/// Scales the x and y components of a normal down to the limit of the slope.
pub(crate) fn limit_slope([nx, ny]: [f32; 2]) -> [f32; 2] {
    let sine = (nx * nx + ny * ny).sqrt();
    let scale = if sine > MAX_SLOPE_SINE { MAX_SLOPE_SINE / sine } else { 1.0 };
    [nx * scale, ny * scale]
}

/// Gradients (dh/dx, dh/dy) of a surface from the x and y components of its unit normal.
pub(crate) fn gradient_from_normal([nx, ny]: [f32; 2]) -> [f32; 2] {
    let nz = (1.0 - nx * nx - ny * ny).sqrt();
    [nx / nz, ny / nz]
}

impl PhotometricModel {
    /// Checks that there is a finite weight for every feature.
    pub fn check(&self) -> Result<(), TouchError> {
        if self.weights.len() != COLOUR_FEATURES {
            let (found, expected) = (self.weights.len(), COLOUR_FEATURES);
            return Err(TouchError::Size { what: "weights of a photometric model", found, expected });
        }
        if !self.weights.iter().flatten().flatten().all(|weight| weight.is_finite()) {
            return Err(TouchError::NotFinite("a weight of a photometric model"));
        }
        Ok(())
    }

    pub(crate) fn row(&self, row: usize) -> RowModel {
        let (_, v) = normalised_position(0, row);
        let mut folded = [[[0.0; 2]; 3]; COLOUR_FEATURES];
        for (folded, w) in folded.iter_mut().zip(&self.weights) {
            for axis in 0..2 {
                folded[0][axis] = w[0][axis] + v * (w[2][axis] + v * w[5][axis]);
                folded[1][axis] = w[1][axis] + v * w[4][axis];
                folded[2][axis] = w[3][axis];
            }
        }
        RowModel(folded)
    }

    /// Angles (degrees) between predicted and true normals at the contact pixels of a press.
    pub(crate) fn angles(&self, press: &CalibrationPress, pixel: (f64, f64)) -> Vec<f64> {
        let change = colour_change(&press.image, &press.background, ImageChange::WHOLE);
        let slopes = |i: usize| {
            let (mut gx, mut gy) = ([0.0], [0.0]);
            self.row(i / N).gradients(i % N, &change[i..=i], &mut gx, &mut gy);
            [f64::from(gx[0]), f64::from(gy[0])]
        };
        contact_pixels(press).map(|i| angle(press, i, pixel, slopes(i))).collect()
    }

    /// Fits a model to presses that share a sensor configuration, each with its pixel size (dx, dy; m).
    pub fn fit(configuration: char, presses: &[(&CalibrationPress, (f64, f64))]) -> Result<Self, TouchError> {
        Self::corrected(None, configuration, presses)
    }

    /// Fits a correction to the model `before`, which stays as it is where the presses give little evidence, as for
    /// slopes steeper than theirs.
    pub fn corrected(
        before: Option<&Self>,
        configuration: char,
        presses: &[(&CalibrationPress, (f64, f64))],
    ) -> Result<Self, TouchError> {
        let mut normal = DMatrix::<f64>::zeros(FEATURE_COUNT, FEATURE_COUNT);
        let mut right = DMatrix::<f64>::zeros(FEATURE_COUNT, 2);
        let mut samples = 0;
        // Blocks of rows turn the normal equations into a matrix product.
        const BLOCK_ROWS: usize = 512;
        let mut rows = DMatrix::<f64>::zeros(FEATURE_COUNT, BLOCK_ROWS);
        let mut labels = DMatrix::<f64>::zeros(2, BLOCK_ROWS);
        let mut filled = 0;
        let mut flush = |rows: &DMatrix<f64>, labels: &DMatrix<f64>, filled: usize| {
            let (a, y) = (rows.columns(0, filled), labels.columns(0, filled));
            normal += a * a.transpose();
            right += a * y.transpose();
        };
        for (press, pixel) in presses {
            let change = colour_change(&press.image, &press.background, ImageChange::WHOLE);
            for row in 1..N - 1 {
                let known = before.map(|model| model.row(row));
                for column in 1..N - 1 {
                    let i = row * N + column;
                    let touched = press.indentation[i] > 0.0;
                    // One in 16 of the other pixels represents noise on a level surface.
                    if !touched && (row % 4 != 0 || column % 4 != 0) {
                        continue;
                    }
                    samples += usize::from(touched);
                    let (gx, gy) = slope(&press.indentation, i, *pixel);
                    let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
                    let (u, v) = normalised_position(column, row);
                    let place = [1.0, u, v, u * u, u * v, v * v];
                    for (k, [colour]) in colour_features(change[i].map(|value| [value])).iter().enumerate() {
                        for (l, place) in place.iter().enumerate() {
                            rows[(k * POSITION_FEATURES + l, filled)] = f64::from(colour * place);
                        }
                    }
                    let [x, y] = known.as_ref().map_or([0.0; 2], |model| model.unbounded(column, change[i]));
                    labels[(0, filled)] = gx * nz - x;
                    labels[(1, filled)] = gy * nz - y;
                    filled += 1;
                    if filled == BLOCK_ROWS {
                        flush(&rows, &labels, filled);
                        filled = 0;
                    }
                }
            }
        }
        flush(&rows, &labels, filled);
        let needed = 20 * FEATURE_COUNT;
        if samples < needed {
            return Err(TouchError::TooFewSamples { configuration, samples, needed });
        }
        let ridge = if before.is_some() { CORRECTION_RIDGE } else { FIT_RIDGE };
        // Ridge relative to each feature's own energy, so that small cubic features are not penalised more.
        for k in 0..FEATURE_COUNT {
            normal[(k, k)] += ridge * normal[(k, k)] + 1e-9 * samples as f64 * 1e-3;
        }
        let solution = normal.cholesky().ok_or(TouchError::Singular("the photometric regression"))?.solve(&right);
        let column = |axis: usize| -> DVector<f64> { solution.column(axis).into_owned() };
        let (x, y) = (column(0), column(1));
        let known = |k: usize, l: usize| before.map_or([0.0; 2], |model| model.weights[k][l]);
        let weights = (0..COLOUR_FEATURES)
            .map(|k| {
                std::array::from_fn(|l| {
                    let ([a, b], at) = (known(k, l), k * POSITION_FEATURES + l);
                    [a + x[at] as f32, b + y[at] as f32]
                })
            })
            .collect();
        Ok(Self { weights })
    }
}

/// Central-difference gradient of an indentation map at pixel `i` (not on the border), pad frame.
pub fn slope(indentation: &[f32], i: usize, (dx, dy): (f64, f64)) -> (f64, f64) {
    (
        f64::from(indentation[i + 1] - indentation[i - 1]) / (2.0 * dx),
        f64::from(indentation[i - N] - indentation[i + N]) / (2.0 * dy),
    )
}

impl PhotometricCalibration {
    /// Fits a model for every sensor configuration that occurs in `presses`.
    pub fn fit(hand: &Hand, presses: &[CalibrationPress]) -> Result<Self, TouchError> {
        Self::fit_from(None, hand, presses)
    }

    /// Corrects this calibration by presses. It stays as it is where they give little evidence. Configurations that do
    /// not occur in `presses` are kept.
    pub fn corrected(&self, hand: &Hand, presses: &[CalibrationPress]) -> Result<Self, TouchError> {
        let corrected = Self::fit_from(Some(self), hand, presses)?;
        let mut configurations = self.configurations.clone();
        configurations.extend(corrected.configurations);
        Ok(Self { version: VERSION, configurations })
    }

    fn fit_from(before: Option<&Self>, hand: &Hand, presses: &[CalibrationPress]) -> Result<Self, TouchError> {
        let mut groups: BTreeMap<char, Vec<_>> = BTreeMap::new();
        for press in presses {
            check(hand, press)?;
            let camera = &hand.cameras[press.camera];
            groups.entry(hand.pads[camera.pad].configuration).or_default().push((press, camera.pixel_size()));
        }
        let configurations = groups
            .into_iter()
            .map(|(letter, group)| {
                let before = before.map(|calibration| calibration.model(letter)).transpose()?;
                Ok((letter, PhotometricModel::corrected(before, letter, &group)?))
            })
            .collect::<Result<_, TouchError>>()?;
        Ok(Self { version: VERSION, configurations })
    }

    /// The model of a sensor configuration.
    pub fn model(&self, configuration: char) -> Result<&PhotometricModel, TouchError> {
        self.configurations.get(&configuration).ok_or(TouchError::Uncalibrated(configuration))
    }

    /// Angular error of the predicted normals over the contact pixels (indentation > 0) of presses, which should not have
    /// been used in the fit.
    pub fn evaluate(&self, hand: &Hand, presses: &[CalibrationPress]) -> Result<AngularError, TouchError> {
        let mut errors: Vec<f64> = Vec::new();
        for press in presses {
            check(hand, press)?;
            let camera = &hand.cameras[press.camera];
            let model = self.model(hand.pads[camera.pad].configuration)?;
            errors.extend(model.angles(press, camera.pixel_size()));
        }
        Ok(AngularError::from_angles(errors))
    }

    /// Reads a calibration file (JSON).
    pub fn read(path: &Path) -> Result<Self, TouchError> {
        let text =
            ftac_platform::file::read_text(path).map_err(|source| TouchError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Parses the text of a calibration file; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, TouchError> {
        let fault = |message: String| TouchError::Format { path: path.into(), message };
        let calibration: Self = serde_json::from_str(text).map_err(|error| fault(error.to_string()))?;
        if calibration.version != VERSION {
            return Err(fault(format!("version {}, expected {VERSION}", calibration.version)));
        }
        for (letter, model) in &calibration.configurations {
            model.check().map_err(|error| fault(format!("configuration {letter}: {error}")))?;
        }
        Ok(calibration)
    }

    /// Writes a calibration file (JSON).
    pub fn write(&self, path: &Path) -> Result<(), TouchError> {
        let text = serde_json::to_string(self)
            .map_err(|error| TouchError::Format { path: path.into(), message: error.to_string() })?;
        write_atomically(path, text.as_bytes()).map_err(|source| TouchError::Io { path: path.into(), source })
    }
}

fn check(hand: &Hand, press: &CalibrationPress) -> Result<(), TouchError> {
    check_images(hand, press.camera, [&press.image, &press.background])?;
    match press.indentation.len() {
        PIXELS => Ok(()),
        found => Err(TouchError::Size { what: "indentation values of a press", found, expected: PIXELS }),
    }
}

/// Checks that the hand has the camera and that the image and the background of a press have its size.
pub(crate) fn check_images(hand: &Hand, camera: usize, images: [&TactileImage; 2]) -> Result<(), TouchError> {
    if camera >= hand.cameras.len() {
        return Err(TouchError::Size { what: "camera index of a press", found: camera, expected: hand.cameras.len() });
    }
    for (what, image) in ["bytes of a press image", "bytes of a press background"].into_iter().zip(images) {
        let (found, expected) = (image.rgb.len(), 3 * PIXELS);
        if found != expected {
            return Err(TouchError::Size { what, found, expected });
        }
    }
    Ok(())
}
