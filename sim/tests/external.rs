//! External disturbances of a scene have the effect that their numbers state, for as long as commanded, and none
//! afterwards.

use std::sync::Arc;

use hand_model::robot::{RobotCommand, ServoGoal};
use hand_model::{Arm, Digit, Hand, RobotModel};
use nalgebra::{Isometry3, Vector3};
use plant::CameraFailure;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectSet;

/// Creates the robot in its home posture with a cube of 60 g on the table.
fn scene(board: fn(&Hand) -> TactileBoard) -> SimulatedRobot {
    let model = ObjectSet::standard().get("cube_45").expect("an object").clone();
    let pose = Isometry3::from_parts([0.62, 0.14, model.rest_height()].into(), model.rest);
    let setup = SceneSetup {
        objects: vec![ObjectPlacement { model, pose }],
        ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home)
    };
    let hand = Hand::ftac();
    let board = board(&hand);
    SimulatedRobot::new(&RobotModel { hand: Arc::new(hand), ..RobotModel::ftac_gen3() }, &setup, board)
}

fn command(capture: bool) -> RobotCommand {
    let pulled = ServoGoal::Current(0.05);
    RobotCommand { arm: Arm::gen3().home, servos: [pulled; 6].into(), capture }
}

fn wait(robot: &mut SimulatedRobot, seconds: f64, each: impl Fn(&mut SimulatedRobot)) {
    let until = robot.time() + seconds;
    while robot.time() < until - 1e-9 {
        robot.send(&command(false));
        each(robot);
        robot.wait_for_tick();
    }
}

/// A force lifts a cube according to Newton's second law; nothing of it remains when it ends.
#[test]
fn a_pull_obeys_newton() {
    let mut robot = scene(|_| TactileBoard::blank());
    wait(&mut robot, 0.5, |_| {});
    let force = Vector3::new(0.0, 0.0, 2.0 * 9.81 * 0.060);
    wait(&mut robot, 0.1, |robot| robot.apply_force(Some(0), force));
    let speed = robot.truth().velocities[0].z;
    // The table's contact is a soft spring, which returns some energy.
    assert!((speed - 0.981).abs() < 0.05, "{speed}");
    wait(&mut robot, 0.05, |_| {});
    let after = robot.truth().velocities[0].z;
    assert!((after - (speed - 9.81 * 0.05)).abs() < 0.01, "{after}");
}

/// A push on the hand deflects the arm against its position control, and the deflection ends with the push.
#[test]
fn a_push_on_the_hand_gives_way_and_comes_back() {
    let mut robot = scene(|_| TactileBoard::blank());
    wait(&mut robot, 1.0, |_| {});
    let before = robot.truth().palm.translation.vector;
    wait(&mut robot, 0.5, |robot| robot.apply_force(None, Vector3::new(0.0, 20.0, 0.0)));
    let pushed = robot.truth().palm.translation.vector - before;
    assert!(pushed.y > 5e-4 && pushed.y > pushed.x.abs() && pushed.y > pushed.z.abs(), "{pushed:?}");
    wait(&mut robot, 1.5, |_| {});
    let left = (robot.truth().palm.translation.vector - before).norm();
    assert!(left < 0.1 * pushed.y, "{left} of {}", pushed.y);
}

/// On a slippery table a pushed cube goes farther than on a rough one.
#[test]
fn less_friction_slides_farther() {
    let slid = |factor: f64| {
        let mut robot = scene(|_| TactileBoard::blank());
        wait(&mut robot, 0.5, |_| {});
        robot.set_friction(0, factor);
        let from = robot.truth().objects[0].translation.y;
        robot.add_velocity(0, &Vector3::new(0.0, 0.5, 0.0));
        wait(&mut robot, 1.0, |_| {});
        robot.truth().objects[0].translation.y - from
    };
    let (rough, slippery) = (slid(1.0), slid(0.2));
    assert!(slippery > 1.5 * rough && rough > 0.0, "{rough} {slippery}");
}

/// Digits without power stay open, whatever is commanded; the others close. The command that was sent shows this.
#[test]
fn digits_without_power_stay_open() {
    let mut robot = scene(|_| TactileBoard::blank());
    robot.cut_power(&[Digit::Thumb, Digit::Ring]);
    let sent = robot.send(&command(false));
    for n in [0, 3, 5] {
        assert_eq!(sent.servos[n], ServoGoal::Current(0.0), "servo {n}");
    }
    wait(&mut robot, 1.0, |_| {});
    let truth = robot.truth();
    assert_eq!((truth.tensions[0], truth.tensions[3]), (0.0, 0.0));
    let bent = |digit: Digit| digit.ftac_joints().iter().map(|joint| truth.hand[*joint]).sum::<f64>();
    // Gravity alone bends a slack finger a little.
    let (index, ring) = (bent(Digit::Index), bent(Digit::Ring));
    assert!(index > 1.0 && ring < 0.2 * index, "{index} {ring}");
}

/// A failed camera sends nothing or black images; all others send the same as before.
#[test]
fn failed_cameras_are_missed() {
    let frames = |how: Option<CameraFailure>| {
        let mut robot = scene(|hand| TactileBoard::unit(hand, 0));
        if let Some(how) = how {
            robot.fail_cameras(&["palm_radial".to_owned()], how);
        }
        robot.send(&command(true));
        robot.wait_for_tick();
        robot.observe().tactile
    };
    let hand = Hand::ftac();
    let pad = hand.pads.iter().find(|pad| pad.name == "palm_radial").expect("a pad");
    let (whole, missing, black) =
        (frames(None), frames(Some(CameraFailure::Missing)), frames(Some(CameraFailure::Black)));
    assert_eq!((whole.len(), black.len()), (hand.cameras.len(), hand.cameras.len()));
    assert_eq!(missing.len(), hand.cameras.len() - pad.cameras.len());
    assert!(missing.iter().all(|frame| !pad.cameras.contains(&frame.camera)));
    for (seen, other) in whole.iter().zip(&black) {
        if pad.cameras.contains(&seen.camera) {
            assert!(other.image.rgb.iter().all(|value| *value == 0) && other.image.rgb.len() == seen.image.rgb.len());
        } else {
            assert_eq!(seen.image, other.image);
        }
    }
}
