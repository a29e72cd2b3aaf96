//! Reconstruction of the gel's surface from an image.

use std::sync::Arc;

use anyhow::{Result, bail};
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use tactile_optics::calibration::{CalibratedSensor, Photo};
use tactile_perception::colour_change::relative_change;
use tactile_perception::network::PreparedNetwork;
use tactile_perception::photometric_stereo::gradients;
use tactile_perception::poisson::{PoissonSolver, rest_level};
use tactile_perception::{Gradients, StereoOptions};

use super::photometry::{CONFIGURATION, Photometry, SlopeMethod};
use super::touched::{border_share, touched_pixels};
use crate::grid::PadGrid;

/// Largest drift of a channel's brightness between background and image that is compensated, as a share.
const MAX_DRIFT: f32 = 0.15;

/// Threshold for the network's slopes, as a share of the largest indentation: they are used where the look-up finds
/// more than this.
const NETWORK_SHARE: f32 = 0.15;

/// Largest touched share of the image's border. With more, nothing shows the level of the untouched gel.
const MAX_TOUCHED_BORDER: f64 = 0.5;
/// Share of a contact outside the calibration's range from which no error of the depth is stated.
const ERROR_WITHDRAWAL_SHARE: f64 = 0.15;
/// Threshold of inconsistent slopes: multiple of their share in the worst held-out press, and smallest share that is
/// reported.
const MISFIT_FACTOR: f64 = 2.0;
const MIN_MISFIT: f64 = 0.2;
/// Steepest slope that gel can take, degrees.
const MAX_SLOPE_DEG: f32 = 75.0;

/// Surface reconstructed from an image, on the pads' grid.
#[derive(Debug, Clone)]
pub struct GridSurface {
    /// Slopes; 0 at untouched pixels.
    pub gradients: Gradients,
    /// Indentation, m.
    pub height: Vec<f32>,
    /// True for touched pixels.
    pub touched: Vec<bool>,
    /// True for touched pixels whose colours or slopes are outside the range of the calibration's presses.
    pub beyond: Vec<bool>,
    /// Residual of the integration: share of the slopes' energy that is inconsistent with any surface.
    pub misfit: f64,
}

impl GridSurface {
    /// Returns the largest indentation, m, averaged over a square of 3 x 3 pixels so that no single pixel decides.
    pub fn peak(&self) -> f64 {
        let inner = |i: &usize| (1..N - 1).contains(&(i % N)) && (1..N - 1).contains(&(i / N));
        let mean = |i: usize| {
            let rows = [i - N, i, i + N];
            rows.iter().flat_map(|at| &self.height[at - 1..=at + 1]).map(|h| f64::from(*h)).sum::<f64>() / 9.0
        };
        (0..N * N).filter(inner).map(mean).fold(0.0, f64::max)
    }
}

/// Surface reconstructed from an image, at the photo's pixels. Frame: x right, y up, z out of the gel; origin at the
/// image's centre.
#[derive(Debug, Clone)]
pub struct ReconstructedSurface {
    pub width: usize,
    pub height: usize,
    /// Size of a pixel, m.
    pub pixel: f64,
    /// Indentation, m; NaN outside the contact, where it is unknown.
    pub depth: Vec<f32>,
    /// dh/dx and dh/dy of the indentation.
    pub slopes: Vec<[f32; 2]>,
    /// Expected error of each normal (root mean square), degrees.
    pub normal_error: Vec<f32>,
    /// True where the gel lies on the pressed object.
    pub contact: Vec<bool>,
    /// True where colours or slopes are outside the range of the calibration's presses.
    pub beyond: Vec<bool>,
    /// Largest indentation, m; `None` if no untouched gel shows the reference level.
    pub deepest: Option<f64>,
    /// Expected error of the largest indentation (root mean square), m; `None` if it cannot be determined.
    pub depth_error: Option<f64>,
    /// Notes that qualify the figures.
    pub notes: Vec<String>,
}

impl ReconstructedSurface {
    /// Returns the position of a pixel's centre on the untouched gel, m.
    pub fn position(&self, i: usize) -> [f64; 2] {
        let (column, row) = ((i % self.width) as f64, (i / self.width) as f64);
        [(column - 0.5 * (self.width as f64 - 1.0)) * self.pixel, (0.5 * (self.height as f64 - 1.0) - row) * self.pixel]
    }

    /// Returns the unit normal out of the gel.
    pub fn normal(&self, i: usize) -> [f32; 3] {
        let [gx, gy] = self.slopes[i];
        let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
        [gx * nz, gy * nz, nz]
    }

    /// Returns the share of the contact outside the calibration's range.
    pub fn beyond_share(&self) -> f64 {
        let inside = self.contact.iter().zip(&self.beyond).filter(|(contact, _)| **contact);
        let (count, beyond) =
            inside.fold((0.0, 0.0), |(n, m), (_, beyond)| (n + 1.0, m + f64::from(u8::from(*beyond))));
        beyond / f64::max(count, 1.0)
    }

    /// Returns the area of the contact, m2.
    pub fn area(&self) -> f64 {
        self.contact.iter().filter(|inside| **inside).count() as f64 * self.pixel * self.pixel
    }
}

/// Reconstruction pipeline: turns images of one sensor into surfaces.
pub struct Reconstructor {
    grid: PadGrid,
    /// Size of a photo's pixel, m.
    pixel: f64,
    /// Relative standard deviation of the pixel size. Heights have the same relative uncertainty.
    pixel_uncertainty: f64,
    background: Arc<TactileImage>,
    grey: bool,
    photometry: Photometry,
    network: PreparedNetwork,
    method: SlopeMethod,
    options: StereoOptions,
    poisson: PoissonSolver,
}

impl Reconstructor {
    /// Creates the pipeline for images against this background, by `method`.
    pub fn new(sensor: &CalibratedSensor, photometry: &Photometry, background: &Photo, method: SlopeMethod) -> Self {
        let (width, height) = sensor.size();
        let grid = PadGrid { width, height };
        Self {
            grid,
            pixel: 1e-3 * sensor.calibration().pixel_mm,
            pixel_uncertainty: sensor
                .calibration()
                .pixel_interval_mm
                .map_or(0.0, |[low, high]| (high - low) / (2.0 * 1.96 * sensor.calibration().pixel_mm)),
            background: grid.image(&background.rgb),
            grey: background.is_grey(),
            photometry: photometry.clone(),
            network: photometry.network.prepare(),
            method,
            options: StereoOptions { max_drift: MAX_DRIFT, ..StereoOptions::default() },
            poisson: PoissonSolver::new(),
        }
    }

    /// Reconstructs the surface on the pads' grid; `None` if the image shows an untouched gel.
    pub fn on_grid(&self, image: &TactileImage) -> Option<GridSurface> {
        let (model, range) = (&self.photometry.look_up, &self.photometry.range);
        let (_, change) = relative_change(image, &self.background, &self.options)?;
        let touched = touched_pixels(&change, range.noise);
        if !touched.contains(&true) {
            return None;
        }
        let level = |mut gradients: Gradients| {
            for i in (0..N * N).filter(|&i| !touched[i]) {
                (gradients.gx[i], gradients.gy[i]) = (0.0, 0.0);
            }
            gradients
        };
        let looked_up = level(gradients(image, &self.background, model, &self.options)?);
        let (mut found, mut height) = self.integrated(looked_up);
        if self.method == SlopeMethod::Network
            && let Some(learned) =
                self.network.gradients(image, &self.background, (CONFIGURATION, model), &self.options)
        {
            // The network was trained on colours in and around contacts only; elsewhere it is less reliable than the
            // look-up.
            let least = NETWORK_SHARE * height.iter().copied().fold(0.0, f32::max);
            for i in (0..N * N).filter(|&i| touched[i] && height[i] > least) {
                (found.gx[i], found.gy[i]) = (learned.gx[i], learned.gy[i]);
            }
            (found, height) = self.integrated(found);
        }
        let misfit = self.misfit(&found, &height, &touched);
        let gain = self.photometry.gain(self.method);
        height.iter_mut().for_each(|value| *value *= gain);
        let grey = |i: usize| [image.rgb[3 * i], image.rgb[3 * i + 1], image.rgb[3 * i + 2]];
        let is_beyond = |i: usize| touched[i] && range.is_beyond(change[i], [found.gx[i], found.gy[i]], grey(i));
        let beyond = (0..N * N).map(is_beyond).collect();
        Some(GridSurface { gradients: found, height, touched, beyond, misfit })
    }

    /// Computes the share of the slopes' energy that the integrated height does not reproduce.
    fn misfit(&self, gradients: &Gradients, height: &[f32], touched: &[bool]) -> f64 {
        let (dx, dy) = self.grid.pixel(self.pixel);
        let (mut off, mut all) = (0.0f64, 0.0f64);
        for i in (N..N * (N - 1)).filter(|&i| touched[i] && (1..N - 1).contains(&(i % N))) {
            let (gx, gy) = (f64::from(gradients.gx[i]), f64::from(gradients.gy[i]));
            let hx = f64::from(height[i + 1] - height[i - 1]) / (2.0 * dx);
            let hy = f64::from(height[i - N] - height[i + N]) / (2.0 * dy);
            off += (gx - hx).powi(2) + (gy - hy).powi(2);
            all += gx * gx + gy * gy;
        }
        off / all.max(f64::MIN_POSITIVE)
    }

    /// Integrates slopes to heights above the untouched gel, m.
    fn integrated(&self, gradients: Gradients) -> (Gradients, Vec<f32>) {
        let mut height = self.poisson.solve(&gradients.gx, &gradients.gy, self.grid.pixel(self.pixel));
        let level = rest_level(&height, gradients.region);
        height.iter_mut().for_each(|value| *value -= level);
        (gradients, height)
    }

    /// Reconstructs the surface from a photo; `None` if it shows an untouched gel.
    pub fn surface(&self, photo: &Photo) -> Result<Option<ReconstructedSurface>> {
        let PadGrid { width, height } = self.grid;
        if (photo.width, photo.height) != (width, height) {
            bail!("found {} x {} pixels; expected {width} x {height}, by the calibration", photo.width, photo.height);
        }
        if photo.is_grey() && !self.grey {
            bail!("found a grey image; expected colours, as in the background");
        }
        let Some(found) = self.on_grid(&self.grid.image(&photo.rgb)) else { return Ok(None) };
        let accuracy = self.photometry.accuracy(self.method);
        let peak = found.peak();
        let depth = self.grid.interpolated(&found.height);
        let (gx, gy) = (self.grid.interpolated(&found.gradients.gx), self.grid.interpolated(&found.gradients.gy));
        let slopes: Vec<[f32; 2]> = gx.into_iter().zip(gy).map(|(gx, gy)| [gx, gy]).collect();
        let (touched, beyond) = (self.photo_flags(&found.touched), self.photo_flags(&found.beyond));
        let limit = self.photometry.contact_share * peak as f32;
        let contact: Vec<bool> =
            depth.iter().zip(&touched).map(|(depth, touched)| *touched && *depth > limit).collect();
        let normal_error = slopes.iter().zip(&beyond).map(|(slope, beyond)| {
            let known = accuracy.normal_error(*slope);
            if *beyond { known.max(unknown_error(*slope)) } else { known }
        });
        let mut surface = ReconstructedSurface {
            width,
            height,
            pixel: self.pixel,
            normal_error: normal_error.collect(),
            depth: depth.iter().zip(&contact).map(|(depth, inside)| if *inside { *depth } else { f32::NAN }).collect(),
            contact,
            beyond,
            slopes,
            deepest: Some(peak),
            depth_error: None,
            notes: Vec::new(),
        };
        self.qualify_depth(&found, &mut surface);
        Ok(Some(surface))
    }

    /// Judges the depth: removes or qualifies figures that the image does not support, and adds notes.
    fn qualify_depth(&self, found: &GridSurface, surface: &mut ReconstructedSurface) {
        let accuracy = self.photometry.accuracy(self.method);
        let peak = found.peak();
        if border_share(&found.touched) > MAX_TOUCHED_BORDER {
            surface.deepest = None;
            surface.notes.push(
                "no depth: the contact reaches most of the border, and no untouched gel shows the level".to_owned(),
            );
        }
        let bump = found.height.iter().zip(&found.touched).filter(|(_, touched)| **touched);
        if bump.map(|(height, _)| f64::from(*height)).sum::<f64>() <= 0.0 {
            surface.notes.push("found a bump, expected a dent: image mirrored, or of another sensor".to_owned());
        }
        if found.misfit > (MISFIT_FACTOR * accuracy.misfit).max(MIN_MISFIT) {
            surface.notes.push(format!(
                "{:.0} % of the slopes fit no surface, {:.0} % at most in the calibration's presses: image mirrored, of another sensor, or \
                 with shadows",
                100.0 * found.misfit,
                100.0 * accuracy.misfit
            ));
        }
        let beyond = surface.beyond_share();
        if beyond > ERROR_WITHDRAWAL_SHARE {
            surface.notes.push(format!(
                "{:.0} % of the contact has colours or slopes that no press of the calibration had (they end at {:.0} degrees)",
                100.0 * beyond,
                self.photometry.range.steepest_deg()
            ));
        }
        if surface.notes.is_empty() {
            let steeper = self.depth_with_steeper_slopes(found) - peak;
            surface.depth_error =
                Some(accuracy.depth_error(peak).hypot(self.pixel_uncertainty * peak).hypot(steeper.max(0.0)));
        }
    }

    /// Computes the largest indentation, m, that would result if all out-of-range slopes were steeper by their expected
    /// error.
    fn depth_with_steeper_slopes(&self, found: &GridSurface) -> f64 {
        if !found.beyond.contains(&true) {
            return found.peak();
        }
        let mut gradients = found.gradients.clone();
        for i in (0..N * N).filter(|&i| found.beyond[i]) {
            let slope = [gradients.gx[i], gradients.gy[i]];
            let tangent = slope[0].hypot(slope[1]);
            let steeper = (tangent.atan().to_degrees() + unknown_error(slope)).min(MAX_SLOPE_DEG).to_radians().tan();
            let factor = if tangent > 0.0 { steeper / tangent } else { 1.0 };
            (gradients.gx[i], gradients.gy[i]) = (slope[0] * factor, slope[1] * factor);
        }
        let (gradients, mut height) = self.integrated(gradients);
        let gain = self.photometry.gain(self.method);
        height.iter_mut().for_each(|value| *value *= gain);
        GridSurface { gradients, height, ..found.clone() }.peak()
    }

    /// Maps flags on the pads' grid to the photo's pixels.
    fn photo_flags(&self, flags: &[bool]) -> Vec<bool> {
        let PadGrid { width, height } = self.grid;
        (0..width * height).map(|at| flags[at / width * N / height * N + at % width * N / width]).collect()
    }
}

/// Returns the expected error (root mean square, degrees) of an out-of-range normal: the true slope may be anywhere
/// from the estimated one up to [`MAX_SLOPE_DEG`].
fn unknown_error([gx, gy]: [f32; 2]) -> f32 {
    (MAX_SLOPE_DEG - gx.hypot(gy).atan().to_degrees()).max(0.0) / f32::sqrt(3.0)
}
