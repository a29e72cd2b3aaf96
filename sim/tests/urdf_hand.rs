//! Third-party hands load, and close on a ball. Their models are not part of this repository.

use std::path::Path;
use std::sync::Arc;

use hand_model::hand_mechanism::HandMechanism;
use nalgebra::{Isometry3, Point3};
use sim::collision_model::CollisionModel;
use sim::hand_scene::{HandScene, TensionCommand};
use sim::test_stand::Prop;
use world::ObjectShape;
use world::geometry::LINK_MESHES;

fn hand(urdf: &str, pulls: &str) -> Option<Arc<HandMechanism>> {
    let path = e2e::shared_data(&format!("hands/{urdf}"))?;
    // Cargo runs the tests in the crate's folder.
    let hand =
        HandMechanism::read(&path, &Path::new("../hand-model/data/hands").join(pulls), LINK_MESHES).expect("loads");
    Some(Arc::new(hand))
}

fn at_rest(hand: Arc<HandMechanism>) -> HandScene {
    let rest = hand.rest_coordinates();
    HandScene::new(&CollisionModel::new(hand), &rest)
}

/// Closes on a ball held at `center`, releases it, and returns the force of each link on it once all is at rest.
fn close(hand: &Arc<HandMechanism>, center: Point3<f64>, radius: f64, tensions: &[f64]) -> (HandScene, Vec<f64>) {
    let mut stand = at_rest(hand.clone());
    stand.add_prop(
        &Prop::new("ball", ObjectShape::Sphere { radius }, 0.1, 0.8),
        &Isometry3::translation(center.x, center.y, center.z),
    );
    stand.run(&TensionCommand::tensions(tensions), 2.0);
    stand.release();
    stand.run(&TensionCommand::tensions(tensions), 2.0);
    let forces = stand.link_forces();
    println!("{}: {:?}", hand.name, forces);
    (stand, forces)
}

#[test]
fn the_allegro_hand_closes_on_a_ball() {
    let Some(hand) = hand("allegro/allegro_hand_right.urdf", "allegro.toml") else { return };
    // Nothing pulls the four joints that spread and rotate.
    assert_eq!((hand.tree.len(), hand.held_joints.len()), (12, 4));
    // In front of the palm (+x), between fingers and thumb.
    let (_, forces) = close(&hand, Point3::new(0.07, 0.0, 0.03), 0.05, &[12.0, 12.0, 12.0, 20.0, 12.0]);
    let touching = |first: usize, last: usize| {
        (first..=last).any(|n| hand.tree.find(&format!("joint_{n}.0")).is_some_and(|joint| forces[joint] > 0.1))
    };
    let digits = [(0, 3), (4, 7), (8, 11), (12, 15)].into_iter().filter(|(a, b)| touching(*a, *b)).count();
    assert!(digits >= 2, "{digits} digits touch");
}

#[test]
fn the_ez_gripper_closes_on_a_ball() {
    let Some(hand) = hand("ezgripper_gen2/urdf/ezgripper_dual_gen2_expanded.urdf", "ezgripper.toml") else { return };
    assert_eq!((hand.tree.len(), hand.followers.len()), (4, 2));
    // On a ball of 60 mm the hollow fingers would close without touching it, and their tips would meet.
    let (stand, forces) = close(&hand, Point3::new(0.12, 0.0, 0.0), 0.04, &[40.0]);
    for follower in &hand.followers {
        let (led, leader) = (stand.angles()[follower.joint], stand.angles()[follower.leader]);
        assert!((led - follower.multiplier * leader).abs() < 0.05, "{led} follows {leader}");
    }
    assert!(forces.iter().filter(|force| **force > 0.1).count() >= 2, "{forces:?}");
}

/// Two jaws 80 mm apart, closed by a tendon by up to 1 rad, the second as a mimic.
const CLAMP: &str = r#"<robot name="clamp">
  <link name="base"><collision><geometry><box size="0.04 0.1 0.02"/></geometry></collision></link>
  <link name="left"><inertial><mass value="0.1"/><origin xyz="0.04 0 0"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0.05 0 0"/><geometry><box size="0.08 0.01 0.02"/></geometry></collision></link>
  <link name="right"><inertial><mass value="0.1"/><origin xyz="0.04 0 0"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><origin xyz="0.05 0 0"/><geometry><box size="0.08 0.01 0.02"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="left"/><origin xyz="0.02 0.04 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="0" effort="1" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="base"/><child link="right"/><origin xyz="0.02 -0.04 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="a" multiplier="-1"/></joint>
</robot>"#;
const TENDON: &str = "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n[[actuator]]\nname = \"close\"\narms = { a = -0.01 }\n";

fn clamp(urdf: &str) -> Arc<HandMechanism> {
    let hand = HandMechanism::parse(urdf, Path::new("clamp.urdf"), TENDON, Path::new("clamp.toml"), LINK_MESHES);
    Arc::new(hand.expect("a clamp"))
}

/// With nothing between them the jaws stop at each other: their tips meet where sin q = 0.4, long before the limits.
#[test]
fn jaws_stop_at_each_other() {
    let mut stand = at_rest(clamp(CLAMP));
    stand.run(&TensionCommand::tensions(&[30.0]), 2.0);
    let (angle, deep) = (stand.angles()[1], stand.self_penetration());
    println!("the jaws stop at {angle:.3} rad, {:.2} mm deep in each other", 1e3 * deep);
    assert!((0.3..0.5).contains(&angle), "{angle} rad");
    assert!(deep < 1e-3, "{deep} m");
    assert_eq!(stand.penetration(), deep);
}

/// A gripper with sliding jaws, the second as a mimic: both move inwards equally, and stop at a ball between them or at
/// their limits.
#[test]
fn a_parallel_gripper_slides() {
    let slide = CLAMP
        .replace("type=\"revolute\"", "type=\"prismatic\"")
        .replace("xyz=\"0 0 1\"", "xyz=\"0 1 0\"")
        .replace("lower=\"-1\" upper=\"0\"", "lower=\"-0.03\" upper=\"0\"")
        .replace("lower=\"0\" upper=\"1\"", "lower=\"0\" upper=\"0.03\"")
        .replace("effort=\"1\"", "effort=\"40\"");
    let pulls = TENDON.replace("a = -0.01", "a = -1.0");
    let hand = HandMechanism::parse(&slide, Path::new("clamp.urdf"), &pulls, Path::new("clamp.toml"), LINK_MESHES);
    let hand = Arc::new(hand.expect("a gripper"));
    let mut empty = at_rest(hand.clone());
    empty.run(&TensionCommand::tensions(&[20.0]), 2.0);
    println!("empty: {:?} m", empty.angles());
    assert!((empty.angles()[0] + 0.03).abs() < 1e-3 && (empty.angles()[1] - 0.03).abs() < 1e-3, "{:?}", empty.angles());
    let (stand, forces) = close(&hand, Point3::new(0.08, 0.0, 0.0), 0.02, &[20.0]);
    // The jaws are 10 mm thick and 80 mm apart: 15 mm remain on either side of the ball.
    assert!(
        (stand.angles()[0] + 0.015).abs() < 2e-3 && (stand.angles()[1] - 0.015).abs() < 2e-3,
        "{:?}",
        stand.angles()
    );
    assert!(forces.iter().all(|force| *force > 1.0), "{forces:?}");
}

/// Only links connected by a joint, and links that overlap at rest, pass through each other.
#[test]
fn links_that_overlap_at_rest_pass() {
    assert!(CollisionModel::new(clamp(CLAMP)).ignored_pairs().is_empty());
    let wide = CLAMP.replacen("size=\"0.08 0.01 0.02\"", "size=\"0.08 0.17 0.02\"", 1);
    assert_eq!(CollisionModel::new(clamp(&wide)).ignored_pairs().iter().collect::<Vec<_>>(), [&(Some(0), Some(1))]);
    let mut stand = at_rest(clamp(&wide));
    stand.run(&TensionCommand::tensions(&[30.0]), 2.0);
    assert!(stand.angles()[1] > 0.9, "{:?}", stand.angles());
    assert_eq!(stand.self_penetration(), 0.0);
}
