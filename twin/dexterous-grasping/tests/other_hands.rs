//! Proposals for hands of the workspace's other files. Not part of the published package, which does not contain them.

use std::path::Path;

use Digit::{Index, Little, Middle, Ring, Thumb};
use dexterous_grasping::digit_sets;
use dexterous_grasping::grasp::pregrasp_pose;
use dexterous_grasping::sampler::{HandForm, ObjectExtent, propose};
use hand_model::{Digit, Hand};
use nalgebra::{Point3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn text(file: &str) -> String {
    std::fs::read_to_string(Path::new("../../hand-model/data").join(file)).expect(file)
}

fn hand(file: &str) -> Hand {
    Hand::parse(&text(file), Path::new(file)).expect(file)
}

/// The sets are those of the file, with one digit each if there are not enough. They are derived if the file says
/// nothing.
#[test]
fn objects_are_taken_by_sets_of_digits() {
    let sets = |file: &str, objects: usize| digit_sets(&hand(file), objects);
    let pinch = vec![Thumb, Index, Middle];
    assert_eq!(sets("ftac_hand.toml", 1), [vec![Ring, Little]]);
    assert_eq!(sets("ftac_hand.toml", 2), [vec![Ring, Little], pinch.clone()]);
    assert_eq!(sets("ftac_hand.toml", 3), [vec![Little], vec![Ring], pinch.clone()]);
    assert_eq!(sets("robots/allegro.toml", 2), [vec![Ring], pinch]);
    assert_eq!(sets("robots/allegro.toml", 3), [[]; 3]);
    assert_eq!(sets("robots/franka_hand.toml", 2), [vec![Thumb, Index], vec![]]);
}

/// A file may name digits other than the derived ones. Digits that take two objects are refused with the field's name.
#[test]
fn a_file_names_the_sets() {
    let text = text("ftac_hand.toml");
    let parse = |from: &str, to: &str| Hand::parse(&text.replace(from, to), Path::new("own.toml"));
    let hand = parse("digits = [\"ring\", \"little\"]", "digits = [\"little\"]").expect("valid");
    assert_eq!(digit_sets(&hand, 2)[0], [Little]);
    let error = parse("digits = [\"ring\", \"little\"]", "digits = [\"middle\"]").expect_err("twice").to_string();
    assert_eq!(error, "own.toml: grasps.set[1].digits: found middle, expected digits that take no object before");
}

/// Jaws come from above, clear of the table, and close across the side of a box that fits between them.
#[test]
fn jaws_come_from_above_across_the_narrow_side() {
    let hand = hand("robots/franka_hand.toml");
    let (form, jaws) = (HandForm::from_hand(&hand), hand.jaws().expect("jaws"));
    let half = Vector3::new(0.05, 0.02, 0.02);
    let object = ObjectExtent { name: "bar".into(), half, yaw_matters: true };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for id in 0..100 {
        let grasp = propose(&form, &object, hand.digits(), id, &mut rng).expect("jaws");
        let palm = grasp.palm_pose(&Point3::new(0.5, 0.0, half.z), 0.0);
        assert!((palm * Vector3::y()).z < -0.95 && (palm * Vector3::x()).y.abs() > 0.95, "{grasp:?}");
        assert!((palm * (jaws.center + Vector3::y() * jaws.tip_reach)).z > 0.0, "{grasp:?}");
        assert!(pregrasp_pose(&hand, &palm, 0.1).translation.z - palm.translation.z > 0.095);
    }
}
