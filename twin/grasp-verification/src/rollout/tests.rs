use dexterous_grasping::digit_sets;
use hand_model::RobotModel;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use scenarios::noise::ObjectNoise;

use super::*;

/// Returns small errors of every kind at once, m and rad.
fn errors(scale: f64) -> TrialNoise {
    let offset = Vector3::new(0.6, -0.8, 0.5) * scale;
    let object = ObjectNoise { offset, yaw: -0.9 * scale, ..ObjectNoise::default() };
    let nowhere = ObjectNoise { offset: Vector3::repeat(f64::NAN), yaw: f64::NAN, ..object };
    TrialNoise {
        position: Vector3::new(-0.4, 0.7, 1.1) * scale,
        rotation: Vector3::new(0.8, 0.5, -0.6) * scale,
        objects: [nowhere, object, nowhere],
        ..TrialNoise::none()
    }
}

/// Returns the true pose of the object in the hand for a level grasp that is aimed under `noise`, by composing poses.
/// The planner sends the palm to the detected object, and the arm goes there with its own error.
fn by_composition(grasp: &Grasp, noise: &TrialNoise, center: &Point3<f64>) -> Isometry3<f64> {
    let seen = center + noise.objects[1].offset;
    let world_from_palm = noise.executed_pose(&grasp.palm_pose(&seen, noise.objects[1].yaw));
    world_from_palm.inverse() * Isometry3::translation(center.x, center.y, center.z)
}

fn by_misaiming(grasp: &Grasp, noise: &TrialNoise, center: &Point3<f64>) -> Isometry3<f64> {
    let world_from_palm = misaimed(grasp, noise, 1).palm_pose(center, 0.0);
    world_from_palm.inverse() * Isometry3::translation(center.x, center.y, center.z)
}

/// Returns the distance between two poses: m, rad.
fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}

/// An error in the world is an error of the object's position in the hand, to first order: the residual falls with the
/// square of the error. The hand points ahead and is level, so that the world's axes are those of roll, pitch and yaw.
/// It grasps the object at the palm's origin, about which the arm's error turns it.
#[test]
fn a_misaimed_grasp_is_the_composition_of_the_errors() {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let any = repertoire.for_digits("golf_ball", &digit_sets(&Hand::ftac(), 2)[1]).next().expect("a grasp");
    let grasp = Grasp { center: [0.0; 3], yaw: 0.0, pitch: 0.0, roll: 0.0, ..any.clone() };
    let center = Point3::new(0.5, -0.1, 0.03);
    let plain = by_composition(&grasp, &TrialNoise::none(), &center);
    for scale in [1e-2, 1e-3, 1e-4] {
        let noise = errors(scale);
        let (true_place, place) = (by_composition(&grasp, &noise, &center), by_misaiming(&grasp, &noise, &center));
        let (left_m, left_rad) = apart(&true_place, &place);
        assert!(left_m < 4.0 * scale * scale && left_rad < 4.0 * scale * scale, "{scale}: {left_m} m, {left_rad} rad");
        let (moved, turned) = apart(&true_place, &plain);
        assert!(moved > scale && turned > scale, "the errors move the object: {moved} m, {turned} rad");
    }
}

/// Shifts without turns are exact for any grasp.
#[test]
fn shifts_are_exact() {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let center = Point3::new(0.5, -0.1, 0.03);
    let mut noise = errors(0.01);
    (noise.rotation, noise.objects[1].yaw) = (Vector3::zeros(), 0.0);
    for grasp in repertoire.for_digits("golf_ball", &digit_sets(&Hand::ftac(), 2)[1]) {
        let (left_m, left_rad) = apart(&by_composition(grasp, &noise, &center), &by_misaiming(grasp, &noise, &center));
        assert!(left_m < 1e-12 && left_rad < 1e-9, "{left_m} m, {left_rad} rad");
    }
}

/// The errors under which grasps are verified are the same in every run, whatever their number.
#[test]
fn verification_errors_are_fixed() {
    let (few, many) = (verification_errors(3), verification_errors(9));
    assert_eq!(few[..], many[..3]);
    assert!(many.windows(2).all(|pair| pair[0] != pair[1]));
}

/// An object counts as in the hand only if it is touched, off the table, near the palm and lifted.
#[test]
fn in_hand_needs_every_condition() {
    let world = SimulatedWorld::new(&RobotModel::ftac_gen3(), scenarios::Scenario::benchmark()).expect("the world");
    let objects = [world.object("golf_ball").expect("known"), world.object("egg").expect("known")];
    let scene = world.scene(&objects, world.cell.ready_posture, &TrialNoise::none());
    let robot = SimulatedRobot::new(&world.cell.robot, &scene, TactileBoard::blank());
    let mut truth = robot.truth();
    truth.objects[0] = truth.palm * Isometry3::translation(0.0, 0.0, -0.05);
    truth.objects[0].rotation = UnitQuaternion::identity();
    (truth.touched_by[0], truth.on_table[0]) = (1, false);
    assert!(in_grip(&truth, 0) && in_hand(&truth, 0));
    let spoilt = |spoil: &dyn Fn(&mut GroundTruth)| {
        let mut truth = truth.clone();
        spoil(&mut truth);
        (in_grip(&truth, 0), in_hand(&truth, 0))
    };
    assert_eq!(spoilt(&|truth| truth.touched_by[0] = 0), (false, false));
    assert_eq!(spoilt(&|truth| truth.on_table[0] = true), (false, false));
    assert_eq!(spoilt(&|truth| truth.objects[0].translation.vector.x += 0.2), (false, false));
    let low = |truth: &mut GroundTruth| {
        let down = truth.palm.translation.z - 0.06;
        truth.palm.translation.z -= down;
        truth.objects[0].translation.z -= down;
    };
    assert_eq!(spoilt(&low), (true, false));
}
