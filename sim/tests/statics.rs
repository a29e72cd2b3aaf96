//! The dynamic hand comes to rest at the static equilibrium.

use std::sync::Arc;

use hand_model::statics::{self, GuideFriction};
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use world::ObjectShape;

/// Foundation stiffness of a nearly rigid cover in the static problem, Pa/m: an element yields by a few micrometres.
const RIGID_STIFFNESS: f64 = 2.0e9;

fn closed(hand: &Hand) -> GuideFriction {
    GuideFriction { friction: hand.parameters.cable.friction, state: 1.0 }
}

#[test]
fn free_postures_agree() {
    let hand = Arc::new(Hand::ftac());
    for (tension, opposition) in [(2.0, 0.2), (5.0, 0.8), (8.0, 0.0)] {
        let tensions = [0.7 * tension, tension, 0.5 * tension, tension, 0.8 * tension];
        let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
        stand.run(&tension_goals(&hand, &tensions, opposition), 3.0);
        let found = stand.angles();
        let expected = statics::free_equilibrium_with_friction(&hand, &tensions, found[0], &closed(&hand));
        println!("tensions {:?} of {tensions:?}", stand.tensions());
        for (joint, (ours, still)) in found.iter().zip(&expected).enumerate() {
            let difference = (ours - still).to_degrees();
            assert!(difference.abs() < 1.0, "joint {joint} at {tension} N: {ours} {still}");
        }
    }
}

/// The four fingers around a rod without friction: angles agree within a degree, forces within a tenth.
#[test]
fn postures_on_a_rod_agree() {
    let hand = Arc::new(Hand::ftac());
    let rod = Prop::new("rod", ObjectShape::Cylinder { radius: 0.025, half_height: 0.06 }, 0.2, 0.0);
    let pose = Isometry3::from_parts(
        Vector3::new(0.0, 0.005, -0.018).into(),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2),
    );
    let tensions = [0.0, 10.0, 8.0, 10.0, 6.0];
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    stand.add_prop(rod.clone(), &pose);
    stand.run(&tension_goals(&hand, &tensions, 0.0), 4.0);
    let slid = closed(&hand);
    let rest = statics::contact_equilibrium(&hand, &tensions, 0.0, &slid, RIGID_STIFFNESS, |point| {
        let (distance, outward) = rod.signed_distance(&pose.inverse_transform_point(point));
        (distance, pose * outward)
    })
    .expect("at rest");
    let found = stand.angles();
    for (joint, (ours, still)) in found.iter().zip(&rest.angles).enumerate().skip(3) {
        println!("joint {joint}: {:.2} {:.2} deg", ours.to_degrees(), still.to_degrees());
        assert!((ours - still).abs().to_degrees() < 1.0, "joint {joint}");
    }
    let mut forces = [Vector3::zeros(); 15];
    for contact in stand.contacts() {
        if let Some(link) = contact.link {
            forces[link] -= contact.force;
        }
    }
    for push in &rest.contact_forces {
        println!("link {}: {:?} {:?}", push.link, forces[push.link].as_slice(), push.force.as_slice());
    }
    assert!(rest.contact_forces.len() >= 6);
    for push in &rest.contact_forces {
        let difference = (forces[push.link] - push.force).norm();
        assert!(difference < 0.1 * push.force.norm() + 0.1, "link {}", push.link);
    }
}

/// Tension up and down again: closing follows one static path and opening the other, with hysteresis between them. The
/// spool turns by the joints' excursion and the cable's stretch.
#[test]
fn closing_and_opening_follow_their_static_paths() {
    let hand = Arc::new(Hand::ftac());
    let friction = hand.parameters.cable.friction;
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    let digit = Digit::Middle;
    let (mut widest, mut farthest, mut stretch) = (0.0f64, 0.0f64, 0.0f64);
    let pull = |step: i32| 0.1 * f64::from(step);
    for (state, steps) in [(1.0, (1..=80).collect::<Vec<i32>>()), (-1.0, (8..80).rev().collect())] {
        for step in steps {
            let mut tensions = [0.0; 5];
            tensions[digit.index()] = pull(step);
            stand.run(&tension_goals(&hand, &tensions, 0.0), 0.15);
            // After the reversal the cable sticks until the tension has fallen by the factor that the guides hold,
            // exp(-2 mu phi).
            let sticks = state < 0.0 && step > 26;
            if step < 8 || sticks {
                continue;
            }
            let tension = stand.tensions()[digit.index()];
            let mut now = [0.0; 5];
            now[digit.index()] = tension;
            let expected =
                statics::free_equilibrium_with_friction(&hand, &now, 0.0, &GuideFriction { friction, state });
            let other =
                statics::free_equilibrium_with_friction(&hand, &now, 0.0, &GuideFriction { friction, state: -state });
            let found = stand.angles();
            for joint in digit.ftac_joints() {
                farthest = farthest.max((found[joint] - expected[joint]).abs().to_degrees());
                widest = widest.max((expected[joint] - other[joint]).abs().to_degrees());
            }
            let cable = hand.parameters.cable;
            let way = cable.spool_radius * stand.servos()[digit.index()].position;
            let taken = hand.transmission.cables[digit.index()].excursion(&found);
            stretch = stretch.max((way - taken - tension / cable.stiffness).abs());
        }
    }
    println!(
        "off by {farthest:.2} deg at most, {widest:.1} deg between closing and opening, stretch off by {stretch:.1e} m"
    );
    assert!(widest > 5.0, "{widest}");
    assert!(farthest < 3.0, "{farthest}");
    assert!(stretch < 3e-5, "{stretch}");
}
