//! Pads feel the hand's own links, and idle frames have noise and drift, each according to its own law.

use std::sync::Arc;

use hand_model::robot::RobotCommand;
use hand_model::{Arm, Digit, DigitVector, Hand, RobotModel};
use nalgebra::{Isometry3, Vector3};
use sim::tactile::{BrightnessDrift, PadLoads, SelfLoad, TactileBoard};
use sim::{SceneSetup, SimulatedRobot};
use world::geometry::ObjectShape;

/// Creates the empty hand over the table.
fn empty(self_contact: bool, board: TactileBoard) -> SimulatedRobot {
    let setup = SceneSetup { self_contact, ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home) };
    SimulatedRobot::new(&RobotModel::ftac_gen3(), &setup, board)
}

/// Pulls with `tensions` (N) and opposes the thumb by `opposition` (rad) for a second and a half; images are captured
/// in the last tick.
fn close(robot: &mut SimulatedRobot, tensions: DigitVector, opposition: f64) {
    let hand = Hand::ftac();
    let servos = hand.servo_goals(&tensions, opposition, hand.parameters.servo.current_limit);
    for tick in 0..180 {
        robot.send(&RobotCommand { arm: Arm::gen3().home, servos, capture: tick == 179 });
        robot.wait_for_tick();
    }
}

/// Fingers that close on nothing touch palm and thumb. The pads there show it, and all others show their backgrounds. A
/// hand that feels objects only shows nothing.
#[test]
fn an_empty_fist_is_felt_where_it_touches_itself() {
    let board = TactileBoard::unit(&Hand::ftac(), 7);
    let backgrounds = board.backgrounds();
    let hand = Hand::ftac();
    for self_contact in [false, true] {
        let mut robot = empty(self_contact, board.clone());
        close(&mut robot, [8.0; 5].into(), 1.0);
        let loads = robot.self_loads();
        let pressed = |pad: usize| loads.iter().filter(|load| load.pad == pad && load.force > 0.02).count();
        assert_eq!(loads.is_empty(), !self_contact);
        assert!(!self_contact || (0..hand.pads.len()).filter(|pad| pressed(*pad) > 0).count() >= 2, "{loads:?}");
        assert!(robot.truth().pad_forces.iter().all(|force| *force == 0.0), "no object is there");
        for frame in robot.observe().tactile {
            let idle = frame.image == backgrounds[frame.camera];
            let pad = hand.cameras[frame.camera].pad;
            assert!(idle || pressed(pad) > 0, "{} shows what is not there", hand.pads[pad].name);
            let digit = hand.pads[pad].link.and_then(|link| Digit::ALL.get(link / 3));
            assert!(!idle || pressed(pad) == 0 || hand.pads[pad].cameras.len() > 1, "{digit:?}: {loads:?}");
        }
    }
}

/// A cover presses like an object of its shape, and beside an object each keeps its own force.
#[test]
fn own_loads_press_like_objects_and_beside_them() {
    let hand = Hand::ftac();
    let pad =
        hand.find_pad("palm_ulnar").unwrap_or_else(|| hand.pads.iter().position(|pad| pad.link.is_none()).unwrap());
    let poses: Vec<Isometry3<f64>> = (0..hand.pads.len()).map(|n| Isometry3::translation(n as f64, 0.0, 0.0)).collect();
    let tip = ObjectShape::Cuboid { half: Vector3::new(0.006, 0.006, 0.006), radius: 0.004 };
    let ball = ObjectShape::Sphere { radius: 0.008 };
    let at = |x: f64, y: f64, z: f64| poses[pad] * Isometry3::translation(x, y, z);
    let (tip_at, ball_at) = (at(0.0, -0.008, 0.006), at(0.0, 0.008, 0.008));
    let forces = |force: f64| (0..hand.pads.len()).map(|n| if n == pad { force } else { 0.0 }).collect::<Vec<_>>();
    let own = [SelfLoad { pad, force: 2.0, shape: tip.clone(), pose: tip_at }];
    let mut board = TactileBoard::unit(&hand, 7);
    let mut seen = |force: f64, objects: &[(&ObjectShape, Isometry3<f64>)], own: &[SelfLoad]| {
        let forces = forces(force);
        let loads = PadLoads { pads: &poses, forces: &forces, objects, self_loads: own };
        let frames = board.capture_loads(&hand, 1.0, &loads);
        hand.pads[pad].cameras.iter().map(|camera| frames[*camera].image.clone()).collect::<Vec<_>>()
    };
    let nothing = seen(0.0, &[], &[]);
    let as_object = seen(2.0, &[(&tip, tip_at)], &[]);
    assert_eq!(seen(0.0, &[], &own), as_object);
    let alone = seen(1.0, &[(&ball, ball_at)], &[]);
    let both = seen(1.0, &[(&ball, ball_at)], &own);
    // Where one of them alone changes the image strongly, both together show the same there.
    let mut compared = [0; 2];
    for camera in 0..both.len() {
        for at in 0..both[camera].rgb.len() {
            let of = |images: &[Arc<hand_model::robot::TactileImage>]| i32::from(images[camera].rgb[at]);
            for (n, one, other) in [(0, &as_object, &alone), (1, &alone, &as_object)] {
                if (of(one) - of(&nothing)).abs() > 15 && (of(other) - of(&nothing)).abs() <= 4 {
                    compared[n] += usize::from((of(&both) - of(one)).abs() <= 6);
                    compared[n] = compared[n].saturating_sub(usize::from((of(&both) - of(one)).abs() > 6) * 20);
                }
            }
        }
    }
    assert!(compared.iter().all(|count| *count > 200), "{compared:?}");
}

/// An idle frame is the background, brighter by rate times age, with the camera's read-out noise of 0.7 grey levels; no
/// two are the same.
#[test]
fn idle_frames_drift_and_are_noisy() {
    let hand = Hand::ftac();
    let rates: Vec<f64> = (0..hand.cameras.len()).map(|camera| 0.01 * (camera as f64 - 8.0)).collect();
    let mut board = TactileBoard::unit(&hand, 7).with_noise(3).drifting(BrightnessDrift::new(rates.clone(), 30.0));
    let grey: Vec<_> = board.backgrounds();
    let poses = vec![Isometry3::identity(); hand.pads.len()];
    let mut idle = |time: f64| board.capture(&hand, time, &poses, &vec![0.0; hand.pads.len()], &[]);
    let (now, later) = (idle(30.0), idle(31.0));
    for (frame, rate) in now.iter().zip(&rates) {
        let (seen, bare) = (&frame.image.rgb, &grey[frame.camera].rgb);
        let sum = |image: &[u8]| image.iter().map(|value| f64::from(*value)).sum::<f64>();
        let gain = sum(seen) / sum(bare);
        assert!((gain - (1.0 + rate)).abs() < 3e-4, "camera {}: {gain} {rate}", frame.camera);
        let square: f64 = seen.iter().zip(bare).map(|(a, b)| (f64::from(*a) - gain * f64::from(*b)).powi(2)).sum();
        let deviation = (square / seen.len() as f64).sqrt();
        // Noise, rounding of the frame, and rounding of the background.
        let expected = (0.49 + 2.0 / 12.0f64).sqrt();
        assert!((deviation / expected - 1.0).abs() < 0.1, "camera {}: {deviation} {expected}", frame.camera);
    }
    assert!(now.iter().zip(&later).all(|(a, b)| a.image != b.image));
    let backgrounds = board.background_frames();
    assert!(backgrounds.iter().zip(&grey).all(|(frame, bare)| frame != bare), "a background frame is noisy too");
    assert!(backgrounds.iter().zip(&now).all(|(frame, now)| *frame != now.image));
}
