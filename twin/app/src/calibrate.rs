//! `ftac touch train`: the calibration a lab makes with a ball on an XYZ stage, made with the simulated sensors: balls of
//! known diameter pressed at known places into one *other* hand unit than the one that runs the trials.

use anyhow::{Context, Result};
use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use optics::press;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sim::tactile::TactileBoard;
use touch::calibration::AngularError;
use touch::{Calibration, CalibrationPress};

/// Radii of the calibration balls, m.
const BALL_RADII: [f64; 3] = [0.004, 0.010, 0.022];

/// Presses of balls at random places of every camera.
pub fn presses(hand: &Hand, board: &TactileBoard, per_camera: usize, seed: u64) -> Result<Vec<CalibrationPress>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut presses = Vec::new();
    for (index, camera) in hand.cameras.iter().enumerate() {
        let pad = &hand.pads[camera.pad];
        let sensor = &board.sensors()[index];
        for n in 0..per_camera {
            let radius = BALL_RADII[n % BALL_RADII.len()];
            let x0 = rng.random_range(-0.38..0.38) * camera.w;
            let y0 = camera.center_y + rng.random_range(-0.38..0.38) * camera.h;
            let force = rng.random_range(0.5..4.0);
            let top = pad.surface_height(x0, y0);
            let ball = |x: f64, y: f64| {
                let inside = radius * radius - (x - x0).powi(2) - (y - y0).powi(2);
                (inside > 0.0).then(|| top + radius - inside.sqrt())
            };
            let pressed = press(pad, &[camera], &hand.gel(), force, ball)?;
            let map = &pressed.maps[0];
            // What touch should see is the gel's surface, bulge included.
            let gel = sensor.model().elastomer.deform(camera, map);
            let pixels = (0..IMAGE_SIZE).flat_map(|row| (0..IMAGE_SIZE).map(move |column| (column, row)));
            let label = pixels.map(|(column, row)| gel.as_ref().map_or(0.0, |gel| gel.depth(column, row))).collect();
            presses.push(CalibrationPress {
                camera: index,
                image: std::sync::Arc::new(sensor.render(map, &mut rng)),
                background: sensor.background().clone(),
                indentation: label,
            });
        }
    }
    Ok(presses)
}

/// Fits a calibration on `per_camera` presses a camera of unit `serial` and evaluates it on as many of another unit.
pub fn train(hand: &Hand, serial: u64, per_camera: usize, seed: u64) -> Result<(Calibration, AngularError)> {
    let calibration = Calibration::fit(hand, &presses(hand, &TactileBoard::unit(hand, serial), per_camera, seed)?)
        .context("fitting the photometric model")?;
    let held_out = presses(hand, &TactileBoard::unit(hand, serial + 1), per_camera.div_ceil(2), seed + 1)?;
    let error = calibration.evaluate(hand, &held_out).context("evaluating the photometric model")?;
    Ok((calibration, error))
}
