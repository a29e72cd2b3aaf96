//! `ftac touch train`: simulated version of a laboratory calibration with a ball on an XYZ stage. Balls of known
//! diameter are pressed at known positions into a hand unit *other* than the one that runs the trials.

use anyhow::{Context, Result};
use hand_model::Hand;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sim::tactile::TactileBoard;
use tactile_perception::calibration::AngularError;
use tactile_perception::{CalibrationPress, PhotometricCalibration};

use crate::pressed_shapes::{PressPlace, Relief, ball_height, press_into};

/// Radii of the calibration balls, m.
const BALL_RADII: [f64; 3] = [0.004, 0.010, 0.022];

/// Presses balls at random positions of every camera.
pub fn presses(hand: &Hand, board: &TactileBoard, per_camera: usize, seed: u64) -> Result<Vec<CalibrationPress>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut presses = Vec::new();
    for (index, camera) in hand.cameras.iter().enumerate() {
        let sensor = &board.sensors()[index];
        for n in 0..per_camera {
            let radius = BALL_RADII[n % BALL_RADII.len()];
            let at =
                [rng.random_range(-0.38..0.38) * camera.w, camera.center_y + rng.random_range(-0.38..0.38) * camera.h];
            let force = rng.random_range(0.5..4.0);
            let relief: Relief = Box::new(move |x, y| ball_height(radius, x, y));
            let place = PressPlace { at, turn: 0.0 };
            presses.push(press_into(hand, (index, sensor), (&relief, &place), force, &mut rng)?);
        }
    }
    Ok(presses)
}

/// Fits a calibration to `per_camera` presses per camera of unit `serial`, and evaluates it on half as many of another
/// unit.
pub fn train(hand: &Hand, serial: u64, per_camera: usize, seed: u64) -> Result<(PhotometricCalibration, AngularError)> {
    let calibration =
        PhotometricCalibration::fit(hand, &presses(hand, &TactileBoard::unit(hand, serial), per_camera, seed)?)
            .context("fitting the photometric model")?;
    let held_out = presses(hand, &TactileBoard::unit(hand, serial + 1), per_camera.div_ceil(2), seed + 1)?;
    let error = calibration.evaluate(hand, &held_out).context("evaluating the photometric model")?;
    Ok((calibration, error))
}
