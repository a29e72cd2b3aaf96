//! Free and blocked paths to an open hand.

use super::*;
use crate::synthesis::urdf_hand::describe::tests::clamp;

/// True if the open clamp (jaws from x = 20 to 80 mm, 80 mm apart, in front of a base up to x = 20 mm) reaches a golf
/// ball at x and y, m.
fn reaches([x, y]: [f64; 2], table: Option<&TablePlane>) -> bool {
    let hand = clamp("{ a = -0.01 }").expect("described");
    let ball = PreparedObject::from_set("golf_ball").expect("the ball");
    reachable(&hand, &ball, &Isometry3::translation(x, y, 0.0), &hand.mechanism().rest_coordinates(), table)
}

#[test]
fn an_open_hand_gets_to_a_ball_between_its_jaws() {
    assert!(reaches([0.06, 0.0], None));
    let barred = |offset| TablePlane { normal: Vector3::x_axis(), offset };
    // The front of the base is 40 mm behind the ball's centre, its back 80 mm.
    assert!(!reaches([0.06, 0.0], Some(&barred(-0.06))), "the base is below the table");
    let beside = TablePlane { normal: Vector3::z_axis(), offset: -0.022 };
    assert!(reaches([0.06, 0.0], Some(&beside)), "along the table");
}

/// The hand cannot reach an object inside the base, or one that a jaw penetrates.
#[test]
fn a_hand_that_would_have_to_pass_the_object_does_not_get_there() {
    assert!(!reaches([0.0, 0.0], None));
    assert!(!reaches([0.05, 0.04], None));
}
