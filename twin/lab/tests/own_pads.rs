//! Presses on one ball: localization by touch, and quality of the pads' self-calibration.

use bench::builtin::builtin_calibration;
use hand_model::Hand;
use lab::touch::balls::{press_ball, press_session};
use lab::touch::own_pads::{board_with_scaled_lamp, evaluate_pads, localization_errors};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sim::tactile::TactileBoard;
use tactile_perception::ball_press::{calibrate, locate};
use tactile_perception::{BallPress, TouchError};

const BALL_RADIUS: f64 = 0.008;
const HAND_UNIT: u64 = 1101;

/// With the calibration of another unit, the ball is found on every pad, in the middle and on its rounded edges, with
/// errors as large as stated.
#[test]
fn the_ball_is_found_wherever_it_presses() {
    let (hand, calibration) = (Hand::ftac(), builtin_calibration().unwrap());
    let presses = press_session(&hand, &TactileBoard::unit(&hand, HAND_UNIT), BALL_RADIUS, 1).unwrap();
    let found = localization_errors(&hand, &calibration, &presses).unwrap();
    assert_eq!(found.found, found.of);
    assert!(found.rms.x < 0.08e-3 && found.rms.y < 0.08e-3 && found.rms.z < 0.05e-3, "{found:?}");
    assert!((0.4..2.0).contains(&found.over_variance.mean()), "{found:?}");
}

/// With a dimmed lamp, normals of the fingertips after self-calibration on a ball are nearly as good as with a
/// laboratory calibration, and better than with another unit's calibration.
#[test]
fn pads_calibrate_themselves_on_a_ball() {
    let (hand, other) = (Hand::ftac(), builtin_calibration().unwrap());
    let dim = board_with_scaled_lamp(&hand, HAND_UNIT, 0.3).unwrap();
    let found = evaluate_pads(&hand, &other, (&dim, BALL_RADIUS), |camera| is_tip(&hand, camera), 1).unwrap();
    let [other, own, laboratory] = [&found.other, &found.own, &found.laboratory].map(|normals| normals.all.mean);
    assert!(own < 1.2 * laboratory && own < other, "{found:?}");
    assert!(found.report.after.mean < 0.9 * found.report.before.mean, "{found:?}");
}

/// A calibration from the very same presses is not improved, nor is any without presses.
#[test]
fn a_calibration_that_is_no_better_is_refused() {
    let (hand, other) = (Hand::ftac(), builtin_calibration().unwrap());
    let known = press_session(&hand, &TactileBoard::unit(&hand, HAND_UNIT), BALL_RADIUS, 1).unwrap();
    let presses: Vec<BallPress> =
        known.into_iter().map(|known| known.press).filter(|press| is_tip(&hand, press.camera)).collect();
    let mut own = other.clone();
    let refusal = (0..8).find_map(|_| match calibrate(&hand, &presses, &own) {
        Ok((better, _)) => {
            own = better;
            None
        }
        Err(error) => Some(error),
    });
    assert!(matches!(refusal, Some(TouchError::NoImprovement { .. })), "{refusal:?}");
    assert_ne!(own, other, "the first one is better");
    assert!(matches!(calibrate(&hand, &[], &other), Err(TouchError::NoImprovement { .. })));
}

fn is_tip(hand: &Hand, camera: usize) -> bool {
    hand.pads[hand.cameras[camera].pad].configuration == 'a'
}

#[test]
fn no_ball_is_found_where_none_is_or_part_of_one() {
    let (hand, calibration) = (Hand::ftac(), builtin_calibration().unwrap());
    let board = TactileBoard::unit(&hand, HAND_UNIT);
    let sensor = (0, &board.sensors()[0]);
    let camera = &hand.cameras[0];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut press = |radius: f64, x: f64, force: f64| {
        press_ball(&hand, sensor, radius, ([x * camera.w, camera.center_y], force), &mut rng).unwrap().press
    };
    assert!(locate(&hand, &calibration, &press(BALL_RADIUS, 0.0, 2.0)).unwrap().is_some());
    for (what, press) in [("untouched", press(BALL_RADIUS, 0.0, 0.0)), ("clipped", press(BALL_RADIUS, 0.49, 2.0))] {
        assert_eq!(locate(&hand, &calibration, &press).unwrap(), None, "{what}");
    }
    // The stated radius is half of the ball's true radius.
    let other = BallPress { radius: 0.5 * BALL_RADIUS, ..press(BALL_RADIUS, 0.0, 2.0) };
    assert_eq!(locate(&hand, &calibration, &other).unwrap(), None);
    let mut nowhere = press(BALL_RADIUS, 0.0, 2.0);
    nowhere.camera = hand.cameras.len();
    let error = locate(&hand, &calibration, &nowhere).unwrap_err().to_string();
    assert!(error.contains("camera index"), "{error}");
}
