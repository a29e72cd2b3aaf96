//! Locates a ball of known radius that is pressed into a pad, from the images before and during the press.
//!
//! The ball's centre is where the gel's surface under it (`impression`) has the slopes that photometric stereo
//! measures. A calibration made on another unit measures slopes that are too steep or too flat, and rotated, by much
//! the same over one contact. A linear map between measured and true slopes is therefore fitted together with the
//! position. Whatever the map, the slopes vanish below the ball's centre, and the rim of the contact, where they break
//! off, determines the depth.

mod impression;
mod self_calibration;

pub use self_calibration::{SelfCalibrationReport, calibrate};

use std::sync::Arc;

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Point3, Vector3};

use crate::calibration::{PhotometricCalibration, check_images, slope};
use crate::colour_change::StereoOptions;
use crate::contacts::{ContactOptions, find_contacts};
use crate::error::TouchError;
use crate::photometric_stereo::{Gradients, gradients};
use crate::poisson::{PoissonSolver, rest_level};
use impression::{PressedBall, impression};

/// Stride, along both axes, of the pixels that are compared.
const PIXEL_STRIDE: usize = 3;
/// Distance beyond the contact's rim up to which slopes are compared, as a share of the gel's thickness.
const RIM_MARGIN_SHARE: f64 = 0.8;
/// Step of the position for finite differences, m.
const DIFFERENCE_STEP: f64 = 2e-5;
/// Largest number of steps of the fit, and the step below which it ends, m.
const MAX_STEPS: usize = 20;
const STEP_TOLERANCE: f64 = 2e-6;
/// Largest depth as a share of the gel's thickness; deeper, the gel deforms in other ways.
const MAX_DEPTH_SHARE: f64 = 0.96;
/// Least share of the sum of squares of the measured slopes that a ball's impression explains.
const MIN_EXPLAINED_SHARE: f64 = 0.8;
/// Number of compared pixels with a common error: the error of photometric stereo depends on position and slope, which
/// change slowly over the contact.
const CORRELATED_PIXELS: f64 = 25.0;
/// Errors that no linear map removes: the standard deviation of the measured slope below the ball's centre, and the
/// error of the rim's position, expressed as depth (m). Measured on presses into pads of units on which the calibration
/// was not made.
const SLOPE_SIGMA: f64 = 0.0055;
const RIM_DEPTH_SIGMA: f64 = 3.5e-5;
/// Largest change of the brightness of lamps or exposure between background and press that is compensated, as a share.
const MAX_DRIFT: f32 = 0.05;

/// One image of a ball of known radius pressed into the pad that a camera looks at.
#[derive(Debug, Clone)]
pub struct BallPress {
    /// Index of the camera.
    pub camera: usize,
    /// The image under the press.
    pub image: Arc<TactileImage>,
    /// The image of the untouched pad.
    pub background: Arc<TactileImage>,
    /// Radius of the ball, m.
    pub radius: f64,
}

/// Estimated position of the ball's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallEstimate {
    /// Centre, m, pad frame.
    pub center: Point3<f64>,
    /// Covariance of the centre, m2.
    pub covariance: Matrix3<f64>,
    /// Radius of the circle in which the ball passes through the undeformed surface, m.
    pub contact_radius: f64,
}

/// Locates the ball. `None` if the pad is untouched, if the image's border clips the contact, if the contact is as deep
/// as the gel is thick, or if it is not that of a ball of this radius.
pub fn locate(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    press: &BallPress,
) -> Result<Option<BallEstimate>, TouchError> {
    check_images(hand, press.camera, [&press.image, &press.background])?;
    let model = calibration.model(hand.pads[hand.cameras[press.camera].pad].configuration)?;
    let options = StereoOptions { max_drift: MAX_DRIFT, ..StereoOptions::default() };
    let Some(seen) = gradients(&press.image, &press.background, model, &options) else { return Ok(None) };
    Ok(initial_guess(hand, press, &seen).and_then(|start| BallFit::new(hand, press, &seen, &start).run(start)))
}

/// First guess of the ball, from the strongest contact in the height map.
fn initial_guess(hand: &Hand, press: &BallPress, seen: &Gradients) -> Option<PressedBall> {
    let camera = &hand.cameras[press.camera];
    let pad = &hand.pads[camera.pad];
    let mut height = PoissonSolver::new().solve(&seen.gx, &seen.gy, camera.pixel_size());
    let level = rest_level(&height, seen.region);
    height.iter_mut().for_each(|height| *height -= level);
    let patches = find_contacts(pad, press.camera, camera, hand.gel(), &height, &ContactOptions::default());
    let patch = patches.first()?;
    let (x, y, radius) = (patch.centroid.x, patch.centroid.y, press.radius);
    let depth = patch.peak.min(MAX_DEPTH_SHARE * hand.gel().thickness).min(radius);
    Some(PressedBall { center: Point3::new(x, y, pad.surface_height(x, y) + radius - depth), radius })
}

/// Slopes at the compared pixels, and the fit of a ball whose impression has these slopes.
struct BallFit<'a> {
    hand: &'a Hand,
    press: &'a BallPress,
    /// Indices of the compared pixels.
    pixels: Vec<usize>,
    /// x components of the measured normals at those pixels, then their y components.
    measured: DMatrix<f64>,
}

impl<'a> BallFit<'a> {
    fn new(hand: &'a Hand, press: &'a BallPress, seen: &Gradients, start: &PressedBall) -> Self {
        let camera = &hand.cameras[press.camera];
        let reach = contact_radius(hand, press.camera, start) + RIM_MARGIN_SHARE * hand.gel().thickness;
        let grid = || (1..N - 1).step_by(PIXEL_STRIDE);
        let near = |i: &usize| {
            let (x, y) = camera.pixel_center(i % N, i / N);
            (x - start.center.x).hypot(y - start.center.y) < reach
        };
        let pixels: Vec<usize> =
            grid().flat_map(|row| grid().map(move |column| row * N + column)).filter(near).collect();
        let normals = pixels.iter().flat_map(|&i| normal(f64::from(seen.gx[i]), f64::from(seen.gy[i])));
        let seen = DMatrix::from_row_iterator(pixels.len(), 2, normals);
        Self { hand, press, pixels, measured: seen }
    }

    /// Measured normals less those of the impression after the best linear map, and a flag for a clipped contact.
    fn residuals(&self, ball: &PressedBall) -> Option<(DVector<f64>, bool)> {
        let impression = impression(self.hand, self.press.camera, ball);
        let pixel = self.hand.cameras[self.press.camera].pixel_size();
        let expected = self.pixels.iter().flat_map(|&i| {
            let (gx, gy) = slope(&impression.indentation, i, pixel);
            normal(gx, gy)
        });
        let expected = DMatrix::from_row_iterator(self.pixels.len(), 2, expected);
        let square: Matrix2<f64> = (expected.transpose() * &expected).fixed_view::<2, 2>(0, 0).into();
        let map = square.try_inverse()? * (expected.transpose() * &self.measured);
        let left = &self.measured - expected * map;
        Some((DVector::from_column_slice(left.as_slice()), impression.clipped))
    }

    fn run(&self, start: PressedBall) -> Option<BallEstimate> {
        let gel = self.hand.gel();
        let mut ball = start;
        let (mut left, mut clipped) = self.residuals(&ball)?;
        let mut damping = 1e-3;
        let mut certain = Matrix3::zeros();
        for _ in 0..MAX_STEPS {
            let mut slopes = DMatrix::zeros(left.len(), 3);
            for axis in 0..3 {
                let mut other = ball;
                other.center[axis] += DIFFERENCE_STEP;
                slopes.set_column(axis, &((self.residuals(&other)?.0 - &left) / DIFFERENCE_STEP));
            }
            certain = (slopes.transpose() * &slopes).fixed_view::<3, 3>(0, 0).into();
            let downhill: Vector3<f64> = (slopes.transpose() * &left).fixed_view::<3, 1>(0, 0).into();
            let mut moved = 0.0;
            while moved == 0.0 && damping < 1e6 {
                let damped = certain + Matrix3::from_diagonal(&(damping * certain.diagonal()));
                let step = -(damped.try_inverse()? * downhill);
                let mut other = ball;
                other.center += step;
                match self.residuals(&other) {
                    Some((less, cut)) if less.norm_squared() < left.norm_squared() => {
                        (ball, left, clipped, moved) = (other, less, cut, step.norm());
                        damping = (0.2 * damping).max(1e-6);
                    }
                    _ => damping *= 8.0,
                }
            }
            if moved < STEP_TOLERANCE {
                break;
            }
        }
        let error = left.norm_squared();
        let explained = 1.0 - error / self.measured.norm_squared();
        let depth = depth(self.hand, self.press.camera, &ball);
        if clipped || explained < MIN_EXPLAINED_SHARE || !(0.0..MAX_DEPTH_SHARE * gel.thickness).contains(&depth) {
            return None;
        }
        let variance = CORRELATED_PIXELS * error / left.len() as f64;
        let aside = (SLOPE_SIGMA * ball.radius).powi(2);
        let beside = Matrix3::from_diagonal(&Vector3::new(aside, aside, RIM_DEPTH_SIGMA.powi(2)));
        Some(BallEstimate {
            center: ball.center,
            covariance: certain.try_inverse()? * variance + beside,
            contact_radius: contact_radius(self.hand, self.press.camera, &ball),
        })
    }
}

/// x and y components of the unit normal of a surface with slopes `gx` and `gy`.
fn normal(gx: f64, gy: f64) -> [f64; 2] {
    let nz = 1.0 / (1.0 + gx * gx + gy * gy).sqrt();
    [gx * nz, gy * nz]
}

/// Depth of a ball below the undeformed surface at its centre, m.
fn depth(hand: &Hand, camera: usize, ball: &PressedBall) -> f64 {
    let pad = &hand.pads[hand.cameras[camera].pad];
    pad.surface_height(ball.center.x, ball.center.y) + ball.radius - ball.center.z
}

fn contact_radius(hand: &Hand, camera: usize, ball: &PressedBall) -> f64 {
    let depth = depth(hand, camera, ball).clamp(0.0, ball.radius);
    (2.0 * ball.radius * depth - depth * depth).sqrt()
}
