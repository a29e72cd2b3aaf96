//! Where a ball of known radius is that is pressed into a pad, from the images before and during the press.
//!
//! The ball's middle is where the gel's surface under it ([`impression`]) has the slopes that photometric stereo sees. A calibration
//! made on another unit sees slopes that are too steep or too flat, and turned, by much the same over one contact. A linear map
//! between seen and true slopes is therefore fitted beside the place: the slopes vanish below the ball's middle whatever the map, and
//! the contact's rim, where they break off, tells the depth.

mod impression;
mod own_calibration;

pub use own_calibration::{OwnCalibrationReport, calibrate};

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
use impression::{Ball, impression};

/// Every so many pixels along both axes are compared.
const STRIDE: usize = 3;
/// How far beyond the contact's rim the slopes are compared, as a share of the gel's thickness.
const BEYOND: f64 = 0.8;
/// Change of the place for derivatives, m.
const DIFFERENCE: f64 = 2e-5;
/// Most steps of the fit, and the step after which it ends, m.
const MOST_STEPS: usize = 20;
const STILL: f64 = 2e-6;
/// Largest depth as a share of the gel's thickness: deeper, the gel gives way in ways of its own.
const DEEPEST: f64 = 0.96;
/// Least share of the seen slopes' squares that a ball's impression explains.
const LEAST_EXPLAINED: f64 = 0.8;
/// Compared pixels that err alike: photometric stereo errs by place and slope, which change slowly over the contact.
const ALIKE: f64 = 25.0;
/// What no linear map takes away: by how much the slope below the ball's middle is seen wrong (standard deviation), and how far the
/// rim's seen place is wrong, told as depth (m). Measured on presses into pads of units that the calibration was not made on.
const OFF_LEVEL: f64 = 0.0055;
const OFF_DEPTH: f64 = 3.5e-5;
/// Largest change of the lamps' or the exposure's strength between background and press that is taken out, as a share.
const MOST_DRIFT: f32 = 0.05;

/// One image of a ball of known radius pressed into the pad that a camera looks at.
#[derive(Debug, Clone)]
pub struct BallPress {
    /// Index of the camera.
    pub camera: usize,
    /// The image under the press.
    pub image: Arc<TactileImage>,
    /// The image of the untouched pad.
    pub background: Arc<TactileImage>,
    /// Of the ball, m.
    pub radius: f64,
}

/// Where the ball's middle is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallPlace {
    /// m, pad frame.
    pub center: Point3<f64>,
    /// Of the middle, m2.
    pub covariance: Matrix3<f64>,
    /// Radius of the circle in which the ball passes through the undeformed surface, m.
    pub contact_radius: f64,
}

/// Finds the ball; `None` if the pad is untouched, if the image's border cuts the contact, if it is as deep as the gel is thick, or if
/// what is seen is no ball of this radius.
pub fn locate(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    press: &BallPress,
) -> Result<Option<BallPlace>, TouchError> {
    check_images(hand, press.camera, [&press.image, &press.background])?;
    let model = calibration.model(hand.pads[hand.cameras[press.camera].pad].configuration)?;
    let options = StereoOptions { most_drift: MOST_DRIFT, ..StereoOptions::default() };
    let Some(seen) = gradients(&press.image, &press.background, model, &options) else { return Ok(None) };
    Ok(coarse(hand, press, &seen).and_then(|start| Fit::new(hand, press, &seen, &start).run(start)))
}

/// A first guess of the ball, from the strongest contact in the height map.
fn coarse(hand: &Hand, press: &BallPress, seen: &Gradients) -> Option<Ball> {
    let camera = &hand.cameras[press.camera];
    let pad = &hand.pads[camera.pad];
    let mut height = PoissonSolver::new().solve(&seen.gx, &seen.gy, camera.pixel_size());
    let level = rest_level(&height, seen.region);
    height.iter_mut().for_each(|height| *height -= level);
    let patches = find_contacts(pad, press.camera, camera, hand.gel(), &height, &ContactOptions::default());
    let patch = patches.first()?;
    let (x, y, radius) = (patch.centroid.x, patch.centroid.y, press.radius);
    let depth = patch.peak.min(DEEPEST * hand.gel().thickness).min(radius);
    Some(Ball { center: Point3::new(x, y, pad.surface_height(x, y) + radius - depth), radius })
}

/// Slopes at the compared pixels, and the place whose impression has them.
struct Fit<'a> {
    hand: &'a Hand,
    press: &'a BallPress,
    /// Compared pixels.
    pixels: Vec<usize>,
    /// x components of the seen normals at those pixels, then their y components.
    seen: DMatrix<f64>,
}

impl<'a> Fit<'a> {
    fn new(hand: &'a Hand, press: &'a BallPress, seen: &Gradients, start: &Ball) -> Self {
        let camera = &hand.cameras[press.camera];
        let reach = contact_radius(hand, press.camera, start) + BEYOND * hand.gel().thickness;
        let grid = || (1..N - 1).step_by(STRIDE);
        let near = |i: &usize| {
            let (x, y) = camera.pixel_center(i % N, i / N);
            (x - start.center.x).hypot(y - start.center.y) < reach
        };
        let pixels: Vec<usize> =
            grid().flat_map(|row| grid().map(move |column| row * N + column)).filter(near).collect();
        let normals = pixels.iter().flat_map(|&i| normal(f64::from(seen.gx[i]), f64::from(seen.gy[i])));
        let seen = DMatrix::from_row_iterator(pixels.len(), 2, normals);
        Self { hand, press, pixels, seen }
    }

    /// Seen normals less those of the impression, after the linear map that brings them nearest; and whether the contact is clipped.
    fn residuals(&self, ball: &Ball) -> Option<(DVector<f64>, bool)> {
        let impression = impression(self.hand, self.press.camera, ball);
        let pixel = self.hand.cameras[self.press.camera].pixel_size();
        let expected = self.pixels.iter().flat_map(|&i| {
            let (gx, gy) = slope(&impression.indentation, i, pixel);
            normal(gx, gy)
        });
        let expected = DMatrix::from_row_iterator(self.pixels.len(), 2, expected);
        let square: Matrix2<f64> = (expected.transpose() * &expected).fixed_view::<2, 2>(0, 0).into();
        let map = square.try_inverse()? * (expected.transpose() * &self.seen);
        let left = &self.seen - expected * map;
        Some((DVector::from_column_slice(left.as_slice()), impression.clipped))
    }

    fn run(&self, start: Ball) -> Option<BallPlace> {
        let gel = self.hand.gel();
        let mut ball = start;
        let (mut left, mut clipped) = self.residuals(&ball)?;
        let mut damping = 1e-3;
        let mut certain = Matrix3::zeros();
        for _ in 0..MOST_STEPS {
            let mut slopes = DMatrix::zeros(left.len(), 3);
            for axis in 0..3 {
                let mut other = ball;
                other.center[axis] += DIFFERENCE;
                slopes.set_column(axis, &((self.residuals(&other)?.0 - &left) / DIFFERENCE));
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
            if moved < STILL {
                break;
            }
        }
        let error = left.norm_squared();
        let explained = 1.0 - error / self.seen.norm_squared();
        let depth = depth(self.hand, self.press.camera, &ball);
        if clipped || explained < LEAST_EXPLAINED || !(0.0..DEEPEST * gel.thickness).contains(&depth) {
            return None;
        }
        let variance = ALIKE * error / left.len() as f64;
        let aside = (OFF_LEVEL * ball.radius).powi(2);
        let beside = Matrix3::from_diagonal(&Vector3::new(aside, aside, OFF_DEPTH.powi(2)));
        Some(BallPlace {
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

/// How far a ball lies below the undeformed surface at its middle, m.
fn depth(hand: &Hand, camera: usize, ball: &Ball) -> f64 {
    let pad = &hand.pads[hand.cameras[camera].pad];
    pad.surface_height(ball.center.x, ball.center.y) + ball.radius - ball.center.z
}

fn contact_radius(hand: &Hand, camera: usize, ball: &Ball) -> f64 {
    let depth = depth(hand, camera, ball).clamp(0.0, ball.radius);
    (2.0 * ball.radius * depth - depth * depth).sqrt()
}
