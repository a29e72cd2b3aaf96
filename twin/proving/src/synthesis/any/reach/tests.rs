//! Ways to an open hand, free and barred.

use super::*;
use crate::synthesis::any::describe::tests::clamp;
use nalgebra::Isometry3;

/// The open clamp (jaws from x = 20 to 80 mm, 80 mm apart, before a base up to x = 20 mm) with an object on its axis at `x`, m.
fn open(hand: &Described, x: f64) -> AnyOpen {
    AnyOpen { start: Isometry3::translation(x, 0.0, 0.0), joints: hand.hand.rest(), tensions: vec![0.0] }
}

#[test]
fn an_open_hand_gets_to_a_ball_between_its_jaws() {
    let hand = clamp("{ a = -0.01 }").expect("described");
    let ball = Subject::named("golf_ball").expect("the ball");
    assert!(reachable(&hand, &ball, &open(&hand, 0.06), None));
    let barred = |offset| Plane { normal: Vector3::x_axis(), offset };
    // The base's front is 40 mm behind the ball's middle, its back 80 mm.
    assert!(!reachable(&hand, &ball, &open(&hand, 0.06), Some(&barred(-0.06))), "the base is below the table");
    let beside = Plane { normal: Vector3::z_axis(), offset: -0.022 };
    assert!(reachable(&hand, &ball, &open(&hand, 0.06), Some(&beside)), "along the table");
}

/// An object in the base cannot have got there, and none that a jaw is stuck in.
#[test]
fn a_hand_that_would_have_to_pass_the_object_does_not_get_there() {
    let hand = clamp("{ a = -0.01 }").expect("described");
    let ball = Subject::named("golf_ball").expect("the ball");
    assert!(!reachable(&hand, &ball, &open(&hand, 0.0), None));
    let mut beside = open(&hand, 0.05);
    beside.start = Isometry3::translation(0.05, 0.04, 0.0);
    assert!(!reachable(&hand, &ball, &beside, None));
}
