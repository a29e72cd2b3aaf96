//! Calibration session on one ball: every camera's pad is pressed at several places, each with several forces.

use anyhow::Result;
use hand_model::Hand;
use nalgebra::Point3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sensor_calibration::pressed_shapes::ball_height;
use sim::tactile::TactileBoard;
use tactile_optics::{Sensor, press};
use tactile_perception::BallPress;

/// Positions of the presses, as shares of the camera's view from its centre.
pub const PRESS_POSITIONS: [[f64; 2]; 5] = [[0.0, 0.0], [0.3, 0.0], [-0.3, 0.0], [0.0, 0.3], [0.0, -0.3]];
/// Forces at each place, N.
pub const PRESS_FORCES: [f64; 4] = [1.0, 2.0, 3.0, 4.0];
/// Maximum placement error of a press, as a share of the view.
const MAX_PLACEMENT_ERROR: f64 = 0.02;

/// A press with the true centre of the ball (m, pad frame).
pub struct LocatedBallPress {
    pub press: BallPress,
    pub center: Point3<f64>,
}

/// Presses a ball of `radius` (m) with a force (N) at a position (m, pad frame) into the pad of camera `index`.
pub fn press_ball(
    hand: &Hand,
    (index, sensor): (usize, &Sensor),
    radius: f64,
    ([x, y], force): ([f64; 2], f64),
    rng: &mut impl Rng,
) -> Result<LocatedBallPress> {
    let camera = &hand.cameras[index];
    let pad = &hand.pads[camera.pad];
    let top = pad.surface_height(x, y);
    let pressed =
        press(pad, &[camera], &hand.gel(), force, |px, py| ball_height(radius, px - x, py - y).map(|z| top + z))?;
    let press = BallPress {
        camera: index,
        image: std::sync::Arc::new(sensor.render(&pressed.maps[0], rng)),
        background: sensor.background().clone(),
        radius,
    };
    Ok(LocatedBallPress { press, center: Point3::new(x, y, top + radius - pressed.shift) })
}

/// Makes presses at [`PRESS_POSITIONS`] with [`PRESS_FORCES`] into the pads of all cameras.
pub fn press_session(hand: &Hand, board: &TactileBoard, radius: f64, seed: u64) -> Result<Vec<LocatedBallPress>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut presses = Vec::new();
    for (index, camera) in hand.cameras.iter().enumerate() {
        for place in PRESS_POSITIONS {
            for force in PRESS_FORCES {
                let mut aside = || rng.random_range(-MAX_PLACEMENT_ERROR..MAX_PLACEMENT_ERROR);
                let at = [(place[0] + aside()) * camera.w, camera.center_y + (place[1] + aside()) * camera.h];
                presses.push(press_ball(hand, (index, &board.sensors()[index]), radius, (at, force), &mut rng)?);
            }
        }
    }
    Ok(presses)
}
