//! Presses on one ball: where touch finds it, and what the pads' own calibration from it is worth.

use bench::builtin::builtin_calibration;
use hand_model::Hand;
use lab::touch::balls::{press_ball, session};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sim::tactile::TactileBoard;
use touch::ball_press::locate;

const RADIUS: f64 = 0.008;
const UNIT: u64 = 1101;

/// By the calibration of another unit, on every pad, in the middle and where its edges are rounded; errors are as large as stated.
#[test]
fn the_ball_is_found_wherever_it_presses() {
    let (hand, calibration) = (Hand::ftac(), builtin_calibration().unwrap());
    let presses = session(&hand, &TactileBoard::unit(&hand, UNIT), RADIUS, 1).unwrap();
    let (mut squares, mut shares) = (Vector3::zeros(), Vector3::zeros());
    for known in &presses {
        let place = locate(&hand, &calibration, &known.press).unwrap().expect("a ball");
        let square = (place.center - known.center).map(|error| error * error);
        squares += square;
        shares += square.component_div(&place.covariance.diagonal());
    }
    let count = presses.len() as f64;
    let rms = (squares / count).map(f64::sqrt);
    assert!(rms.x < 0.08e-3 && rms.y < 0.08e-3 && rms.z < 0.05e-3, "{rms}");
    let share = shares.sum() / (3.0 * count);
    assert!((0.4..2.0).contains(&share), "mean squared error over variance: {share}");
}

#[test]
fn no_ball_is_found_where_none_is_or_part_of_one() {
    let (hand, calibration) = (Hand::ftac(), builtin_calibration().unwrap());
    let board = TactileBoard::unit(&hand, UNIT);
    let sensor = (0, &board.sensors()[0]);
    let camera = &hand.cameras[0];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut press = |radius: f64, x: f64, force: f64| {
        press_ball(&hand, sensor, radius, ([x * camera.w, camera.center_y], force), &mut rng).unwrap().press
    };
    assert!(locate(&hand, &calibration, &press(RADIUS, 0.0, 2.0)).unwrap().is_some());
    for (what, press) in [("untouched", press(RADIUS, 0.0, 0.0)), ("clipped", press(RADIUS, 0.49, 2.0))] {
        assert_eq!(locate(&hand, &calibration, &press).unwrap(), None, "{what}");
    }
    // A ball that is told to be half as large as it is.
    let other = touch::BallPress { radius: 0.5 * RADIUS, ..press(RADIUS, 0.0, 2.0) };
    assert_eq!(locate(&hand, &calibration, &other).unwrap(), None);
    let mut nowhere = press(RADIUS, 0.0, 2.0);
    nowhere.camera = hand.cameras.len();
    let error = locate(&hand, &calibration, &nowhere).unwrap_err().to_string();
    assert!(error.contains("camera index"), "{error}");
}
