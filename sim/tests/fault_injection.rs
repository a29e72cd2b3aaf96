//! Each fault of the robot has its effect where it is injected, and nowhere else.

use std::f64::consts::PI;
use std::sync::Arc;

use hand_model::robot::{RobotCommand, ServoGoal, TactileFrame};
use hand_model::{Arm, ArmVector, Digit, Hand, HandVector, RobotModel};
use nalgebra::{Isometry3, Point3, Vector3};
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectSet;

/// Current of servos that close free fingers, A.
const PULL_CURRENT: f64 = 0.05;

/// Returns the home posture turned over, with the palm facing up.
fn palm_up() -> ArmVector {
    let mut arm = Arm::gen3().home;
    arm[6] += PI;
    arm
}

/// Creates the robot with its arm at `arm` (rad) and a cube of 60 g on the table.
fn scene(arm: ArmVector, board: fn(&Hand) -> TactileBoard) -> SimulatedRobot {
    let model = ObjectSet::standard().get("cube_45").expect("an object").clone();
    let pose = Isometry3::from_parts([0.62, 0.14, model.rest_height()].into(), model.rest);
    let setup =
        SceneSetup { objects: vec![ObjectPlacement { model, pose }], ..SceneSetup::ideal(Isometry3::identity(), arm) };
    let hand = Hand::ftac();
    let board = board(&hand);
    SimulatedRobot::new(&RobotModel { hand: Arc::new(hand), ..RobotModel::ftac_gen3() }, &setup, board)
}

/// Lays the cube on the little finger's half of the palm, which faces up.
fn lay_on_palm(robot: &mut SimulatedRobot) {
    let palm = robot.truth().palm;
    assert!((palm * Vector3::z()).z < -0.9, "the palm looks up: {palm}");
    robot.set_object_pose(0, &(palm * Isometry3::translation(-0.018, -0.060, -0.015)));
}

/// Holds the same goals for `seconds`.
fn hold(robot: &mut SimulatedRobot, arm: ArmVector, servos: [ServoGoal; 6], seconds: f64) {
    let until = robot.time() + seconds;
    while robot.time() < until - 1e-9 {
        robot.send(&RobotCommand { arm, servos: servos.into(), capture: false });
        robot.wait_for_tick();
    }
}

/// Returns a robot at home after its digits were pulled with [`PULL_CURRENT`] until they rest.
fn closed() -> SimulatedRobot {
    let mut robot = scene(Arm::gen3().home, |_| TactileBoard::blank());
    pull(&mut robot, 1.5);
    robot
}

/// Winds the five cables with [`PULL_CURRENT`], without current in the servo of the opposition.
fn pull(robot: &mut SimulatedRobot, seconds: f64) {
    let mut servos = [ServoGoal::Current(PULL_CURRENT); 6];
    servos[5] = ServoGoal::Current(0.0);
    hold(robot, Arm::gen3().home, servos, seconds);
}

/// Captures the images of all cameras, one tick later.
fn images(robot: &mut SimulatedRobot) -> Vec<TactileFrame> {
    robot.send(&RobotCommand { arm: palm_up(), servos: [ServoGoal::Current(0.0); 6].into(), capture: true });
    robot.wait_for_tick();
    robot.observe().tactile
}

/// Checks that all cables except `n` pull as they do in `sound`, and that the joints of the other digits have the same
/// angles.
fn others_as_in(sound: &SimulatedRobot, broken: &SimulatedRobot, n: usize) {
    let (sound, broken) = (sound.truth(), broken.truth());
    for digit in Digit::ALL.iter().filter(|digit| digit.index() != n) {
        let at = digit.index();
        assert!((broken.tensions[at] - sound.tensions[at]).abs() < 0.02 * sound.tensions[at], "{digit:?}");
        for joint in digit.ftac_joints() {
            assert!((broken.hand[joint] - sound.hand[joint]).abs() < 0.01, "joint {joint}");
        }
    }
}

#[test]
fn a_broken_cable_pulls_no_more() {
    let mut sound = closed();
    let mut robot = sound.clone();
    let ring = Digit::Ring.index();
    assert!(sound.truth().tensions[ring] > 2.0);
    robot.break_cable(ring);
    pull(&mut robot, 1.0);
    pull(&mut sound, 1.0);
    let bent = |robot: &SimulatedRobot| Digit::Ring.ftac_joints().map(|joint| robot.truth().hand[joint]);
    assert_eq!(robot.truth().tensions[ring], 0.0);
    for (open, before) in bent(&robot).iter().zip(bent(&sound)) {
        // Gravity alone bends a slack finger a little.
        assert!(before > 0.1 && *open < 0.3 * before, "{open} {before}");
    }
    others_as_in(&sound, &robot, ring);
}

/// The length that the spool has wound is taken up by joints and stretch, except for the part that has slipped.
#[test]
fn a_cable_slips_by_its_length() {
    let hand = Hand::ftac();
    let index = Digit::Index.index();
    let mut servos = [ServoGoal::Current(0.0); 6];
    servos[index] = ServoGoal::Position { angle: 4.0, current_limit: 0.9 };
    let mut robot = scene(Arm::gen3().home, |_| TactileBoard::blank());
    let mut at_rest = |slip: f64| {
        robot.slip_cable(index, slip);
        hold(&mut robot, Arm::gen3().home, servos, 1.5);
        let (truth, angle) = (robot.truth(), robot.observe().servos[index].position);
        let q: HandVector = truth.hand.iter().copied().collect();
        let taken =
            hand.transmission.cables[index].excursion(&q) + truth.tensions[index] / hand.cables[index].stiffness;
        (angle, truth.tensions[index], hand.cables[index].spool_radius * angle - taken)
    };
    let (whole, slipped) = (at_rest(0.0), at_rest(0.002));
    assert!((whole.0 - slipped.0).abs() < 0.01, "the servo stays: {whole:?} {slipped:?}");
    assert!(slipped.1 > 0.1 && slipped.1 < 0.98 * whole.1, "tension: {whole:?} {slipped:?}");
    assert!(whole.2.abs() < 3e-5 && (slipped.2 - 0.002).abs() < 3e-5, "slack: {whole:?} {slipped:?}");
}

#[test]
fn a_weak_servo_pulls_its_share() {
    let mut sound = closed();
    let mut robot = sound.clone();
    let middle = Digit::Middle.index();
    robot.weaken_servo(middle, 0.6);
    pull(&mut robot, 1.5);
    pull(&mut sound, 1.5);
    let share = robot.truth().tensions[middle] / sound.truth().tensions[middle];
    assert!((share - 0.6).abs() < 0.01, "{share}");
    assert_eq!(robot.observe().servos[middle].current, sound.observe().servos[middle].current);
    others_as_in(&sound, &robot, middle);
}

#[test]
fn a_stuck_joint_stays_where_it_is() {
    let mut sound = scene(Arm::gen3().home, |_| TactileBoard::blank());
    pull(&mut sound, 0.3);
    let [mcp, pip, dip] = Digit::Middle.ftac_joints();
    let mut robot = sound.clone();
    let before = sound.truth().hand;
    robot.stick_joint(pip);
    pull(&mut robot, 1.2);
    pull(&mut sound, 1.2);
    let moved = |robot: &SimulatedRobot, joint: usize| robot.truth().hand[joint] - before[joint];
    let of = [mcp, pip, dip].map(|joint| (moved(&sound, joint), moved(&robot, joint)));
    assert!(of[1].0 > 0.1 && of[1].1.abs() < 0.005, "{of:?}");
    assert!(of[0].1 > 0.1 && of[2].1 > 0.1, "{of:?}");
    others_as_in(&sound, &robot, Digit::Middle.index());
}

/// A mass in the hand loads each joint of the arm by its weight times the lever arm.
#[test]
fn added_mass_weighs_on_the_arm() {
    let more = 0.2;
    let mut light = scene(palm_up(), |_| TactileBoard::blank());
    lay_on_palm(&mut light);
    let mut heavy = light.clone();
    heavy.add_mass(0, more);
    // The arm's position control sways a little under its load: mean torques over two seconds.
    let ticks = 200;
    let [before, after] = [&mut light, &mut heavy].map(|robot| {
        let mut mean = [0.0; 7];
        hold(robot, palm_up(), [ServoGoal::Current(0.0); 6], 1.0);
        for _ in 0..ticks {
            hold(robot, palm_up(), [ServoGoal::Current(0.0); 6], 0.01);
            let torques = robot.observe().arm.torque;
            mean.iter_mut().zip(torques).for_each(|(mean, torque)| *mean += torque / f64::from(ticks));
        }
        let truth = robot.truth();
        assert!(truth.touched_by[0] != 0 && !truth.on_table[0], "it lies in the hand");
        mean
    });
    let truth = heavy.truth();
    let links = &truth.arm_links;
    let at = links[6].inverse_transform_point(&Point3::from(truth.objects[0].translation.vector));
    let jacobian = Arm::gen3().tree.jacobian(links, 6, &at);
    let weight = Vector3::new(0.0, 0.0, -9.81 * more);
    let expected = -(jacobian.fixed_rows::<3>(0).transpose() * weight);
    assert!(expected.amax() > 0.5, "there is something to measure: {expected}");
    for joint in 0..7 {
        let gained = after[joint] - before[joint];
        assert!((gained - expected[joint]).abs() < 0.05 * expected.amax(), "joint {joint}: {gained} {expected}");
    }
}

/// A camera that freezes before the touch never shows it. All others do, and so does this one without the fault.
#[test]
fn a_frozen_camera_repeats_its_image() {
    let mut sound = scene(palm_up(), |hand| TactileBoard::unit(hand, 0));
    let before = images(&mut sound);
    lay_on_palm(&mut sound);
    hold(&mut sound, palm_up(), [ServoGoal::Current(0.0); 6], 0.3);
    let mut robot = sound.clone();
    let shown = images(&mut sound);
    let feels = |n: usize| before[n].image != shown[n].image;
    let frozen = (0..shown.len()).find(|n| feels(*n)).expect("a camera that feels the cube");
    robot.freeze_camera(shown[frozen].camera);
    let sent = images(&mut robot);
    assert_eq!(sent.len(), shown.len());
    for n in 0..sent.len() {
        let expected = if n == frozen { &before[n] } else { &shown[n] };
        assert_eq!((sent[n].camera, sent[n].time), (shown[n].camera, shown[n].time));
        assert!(sent[n].image == expected.image, "camera {}", sent[n].camera);
    }
}

/// With one lamp at half its light, the camera's images have half of its colour, and nothing else changes.
#[test]
fn a_dim_lamp_darkens_its_colour() {
    let mut sound = scene(palm_up(), |hand| TactileBoard::unit(hand, 0));
    let mut robot = sound.clone();
    let (camera, green) = (2, 1);
    robot.dim_lamp(camera, green, 0.5);
    for (seen, dim) in images(&mut sound).iter().zip(images(&mut robot)) {
        assert_eq!(seen.camera, dim.camera);
        if seen.camera != camera {
            assert!(seen.image == dim.image, "camera {}", seen.camera);
            continue;
        }
        let of = |image: &[u8], channel: usize| image.iter().skip(channel).step_by(3).copied().collect::<Vec<u8>>();
        for channel in 0..3 {
            let (seen, dim) = (of(&seen.image.rgb, channel), of(&dim.image.rgb, channel));
            let light = |values: &[u8]| values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
            if channel == green {
                assert!(light(&seen) > 10.0 && (light(&dim) / light(&seen) - 0.5).abs() < 0.02);
            } else {
                assert!(seen == dim, "channel {channel}");
            }
        }
    }
}

/// Faults of zero size leave every bit of the robot's measurements unchanged, and so does the code path through the
/// fault hooks.
#[test]
fn faults_of_no_size_change_no_bit() {
    let mut sound = scene(palm_up(), |hand| TactileBoard::unit(hand, 0));
    let mut robot = sound.clone();
    for n in 0..5 {
        robot.slip_cable(n, 0.0);
        robot.weaken_servo(n, 1.0);
    }
    robot.dim_lamp(0, 0, 1.0);
    let [ours, theirs] = [&mut sound, &mut robot].map(|robot| {
        lay_on_palm(robot);
        let mut arm = palm_up();
        arm[0] += 0.1;
        hold(robot, arm, [ServoGoal::Current(PULL_CURRENT); 6], 1.0);
        let measured = robot.observe();
        (measured.servos, measured.arm, robot.truth().hand, images(robot))
    });
    assert!((&ours.0, &ours.1, &ours.2) == (&theirs.0, &theirs.1, &theirs.2));
    for (ours, theirs) in ours.3.iter().zip(&theirs.3) {
        assert!(ours.camera == theirs.camera && ours.image == theirs.image, "camera {}", ours.camera);
    }
}
