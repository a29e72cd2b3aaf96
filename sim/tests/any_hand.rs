//! Other people's hands load and close on a ball. Their models are not part of this repository.

use std::path::Path;
use std::sync::Arc;

use hand_model::any_hand::AnyHand;
use nalgebra::{Isometry3, Point3};
use scenarios::Shape;
use sim::engine::EngineSettings;
use sim::stand::{AnyStand, Prop};

fn hand(urdf: &str, pulls: &str) -> Option<Arc<AnyHand>> {
    let path = e2e::shared_data(&format!("hands/{urdf}"))?;
    // Cargo runs the tests in the crate's folder.
    let hand = AnyHand::read(&path, &Path::new("../hand-model/data/hands").join(pulls)).expect("loads");
    Some(Arc::new(hand))
}

/// Closes on a ball held at `center`, lets go of it, and gives the force of each link on it once all is at rest.
fn close(hand: &Arc<AnyHand>, center: Point3<f64>, radius: f64, tensions: &[f64]) -> (AnyStand, Vec<f64>) {
    let mut stand = AnyStand::new(hand.clone(), EngineSettings::default());
    stand.put(
        &Prop::new("ball", Shape::Sphere { radius }, 0.1, 0.8),
        &Isometry3::translation(center.x, center.y, center.z),
    );
    stand.run(tensions, 2.0);
    stand.release();
    stand.run(tensions, 2.0);
    let forces = stand.forces();
    println!("{}: {:?}", hand.name, forces);
    (stand, forces)
}

#[test]
fn the_allegro_hand_closes_on_a_ball() {
    let Some(hand) = hand("allegro/allegro_hand_right.urdf", "allegro.toml") else { return };
    assert_eq!(hand.tree.len(), 16);
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
    let (stand, forces) = close(&hand, Point3::new(0.13, 0.0, 0.0), 0.03, &[40.0]);
    for follower in &hand.followers {
        let (led, leader) = (stand.angles()[follower.joint], stand.angles()[follower.leader]);
        assert!((led - follower.multiplier * leader).abs() < 0.05, "{led} follows {leader}");
    }
    assert!(forces.iter().filter(|force| **force > 0.1).count() >= 2, "{forces:?}");
}
