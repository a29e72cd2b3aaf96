//! Quality of the pads' self-calibration from presses on a ball, compared with the calibration of another unit and with
//! that of a laboratory.

use anyhow::Result;
use hand_model::Hand;
use nalgebra::Vector3;
use sensor_calibration::pad_calibration::presses;
use sim::tactile::TactileBoard;
use tactile_optics::SensorModel;
use tactile_perception::ball_press::{SelfCalibrationReport, calibrate, locate};
use tactile_perception::calibration::{angle, contact_pixels};
use tactile_perception::photometric_stereo::gradients;
use tactile_perception::{
    AngularError, BallPress, CalibrationPress, PhotometricCalibration, StereoOptions, TouchError,
};

use super::balls::{LocatedBallPress, press_session};

/// Presses per camera: in a laboratory calibration, and held out.
const LABORATORY_PRESSES: usize = 20;
const HELD_OUT_PRESSES: usize = 9;
/// Upper limits of the slope classes by which errors are split, degrees; steeper slopes are the last class.
pub const SLOPE_CLASS_LIMITS: [f64; 4] = [10.0, 20.0, 30.0, 45.0];

/// Localization errors of the balls' centres, over the balls that were found.
#[derive(Debug, Clone, Copy)]
pub struct LocalizationErrors {
    pub found: usize,
    pub of: usize,
    /// Root-mean-square error, m.
    pub rms: Vector3<f64>,
    /// Mean of the squared errors over their stated variances, x, y, z.
    pub over_variance: Vector3<f64>,
}

/// Measures the localization errors of balls by `calibration`.
pub fn localization_errors(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    known: &[LocatedBallPress],
) -> Result<LocalizationErrors, TouchError> {
    let (mut found, mut squares, mut shares) = (0, Vector3::zeros(), Vector3::zeros());
    for ball in known {
        let Some(place) = locate(hand, calibration, &ball.press)? else { continue };
        let square = (place.center - ball.center).map(|error| error * error);
        found += 1;
        squares += square;
        shares += square.component_div(&place.covariance.diagonal());
    }
    let count = found as f64;
    Ok(LocalizationErrors {
        found,
        of: known.len(),
        rms: (squares / count).map(f64::sqrt),
        over_variance: shares / count,
    })
}

/// Errors of normals on held-out laboratory presses by one calibration.
#[derive(Debug, Clone)]
pub struct Normals {
    pub all: AngularError,
    /// Errors by true slope: up to each of [`SLOPE_CLASS_LIMITS`], and beyond.
    pub by_slope: Vec<AngularError>,
}

impl Normals {
    fn of(hand: &Hand, calibration: &PhotometricCalibration, held_out: &[CalibrationPress]) -> Result<Self> {
        let mut classes = vec![Vec::new(); SLOPE_CLASS_LIMITS.len() + 1];
        for press in held_out {
            let camera = &hand.cameras[press.camera];
            let model = calibration.model(hand.pads[camera.pad].configuration)?;
            let seen = gradients(&press.image, &press.background, model, &StereoOptions::default());
            for i in contact_pixels(press) {
                let level = angle(press, i, camera.pixel_size(), [0.0; 2]);
                let at = seen.as_ref().map_or([0.0; 2], |seen| [f64::from(seen.gx[i]), f64::from(seen.gy[i])]);
                let class = SLOPE_CLASS_LIMITS
                    .iter()
                    .position(|steepest| level < *steepest)
                    .unwrap_or(SLOPE_CLASS_LIMITS.len());
                classes[class].push(angle(press, i, camera.pixel_size(), at));
            }
        }
        let all = calibration.evaluate(hand, held_out)?;
        Ok(Self { all, by_slope: classes.into_iter().map(AngularError::from_angles).collect() })
    }
}

/// One hand unit's pads evaluated with three calibrations.
#[derive(Debug)]
pub struct OwnPads {
    /// Errors with the calibration of another unit.
    pub other: Normals,
    /// Errors with a laboratory calibration of this unit.
    pub laboratory: Normals,
    /// Errors with the self-calibration from presses on a ball.
    pub own: Normals,
    pub report: SelfCalibrationReport,
    /// Localization errors of the ball: with the other unit's calibration and with the own one.
    pub localization: [LocalizationErrors; 2],
}

/// Returns the cameras of hand unit `serial`, with one of each camera's lamps `strength` times as bright.
pub fn board_with_scaled_lamp(hand: &Hand, serial: u64, strength: f64) -> Result<TactileBoard> {
    let dim = |_: usize, model: &mut SensorModel| {
        if let Some(lamp) = model.lamps.first_mut() {
            lamp.eta *= strength;
        }
    };
    Ok(TactileBoard::with_models(hand, serial, dim)?)
}

/// Calibrates the pads of a board from presses on a ball of `radius` (m) and in a laboratory, for the cameras selected
/// by `wanted`. `other` is another unit's calibration.
pub fn evaluate_pads(
    hand: &Hand,
    other: &PhotometricCalibration,
    (board, radius): (&TactileBoard, f64),
    wanted: impl Fn(usize) -> bool,
    seed: u64,
) -> Result<OwnPads> {
    let kept = |per_camera: usize, seed: u64| -> Result<Vec<CalibrationPress>> {
        let mut made = presses(hand, board, per_camera, seed)?;
        made.retain(|press| wanted(press.camera));
        Ok(made)
    };
    let held_out = kept(HELD_OUT_PRESSES, seed + 1)?;
    let laboratory = PhotometricCalibration::fit(hand, &kept(LABORATORY_PRESSES, seed + 2)?)?;
    let mut known = press_session(hand, board, radius, seed)?;
    known.retain(|known| wanted(known.press.camera));
    let session: Vec<BallPress> = known.iter().map(|known| known.press.clone()).collect();
    let (own, report) = calibrate(hand, &session, other)?;
    let normals = |calibration| Normals::of(hand, calibration, &held_out);
    let places = [localization_errors(hand, other, &known)?, localization_errors(hand, &own, &known)?];
    Ok(OwnPads {
        other: normals(other)?,
        laboratory: normals(&laboratory)?,
        own: normals(&own)?,
        report,
        localization: places,
    })
}
