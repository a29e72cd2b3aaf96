//! Friction in the guides of the simulated finger against the capstan equation.

use hand_model::transmission::Crossing;
use std::sync::Arc;

use hand_model::transmission::MAX_SPANS;
use hand_model::{Digit, Hand};
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, tension_goals};

/// In a steady pull on a free finger each joint's spring balances the spool's tension times the capstan factor, exp(-mu
/// wrap); when let out again, times exp(mu wrap).
#[test]
fn a_finger_s_springs_feel_the_capstan_s_tension() {
    let hand = Arc::new(Hand::ftac());
    let cable = hand.parameters.cable;
    let digit = Digit::Index.index();
    let path = &hand.transmission.cables[digit];
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    let mut run = |from: f64, to: f64, seconds: f64| {
        // Half of the time is for coming to rest, because joints and servo have viscous losses too.
        let steps = (seconds * 240.0) as usize;
        for n in 0..2 * steps {
            let mut tensions = [0.0; 5];
            tensions[digit] = from + (to - from) * (n as f64 / steps as f64).min(1.0);
            stand.step(&tension_goals(&hand, &tensions, 0.0));
        }
        (stand.angles(), stand.tensions()[digit])
    };
    for ((q, tension), sign) in [(run(0.0, 5.0, 3.0), -1.0), (run(5.0, 3.0, 3.0), 1.0)] {
        let mut turned = cable.friction.routing;
        let mut least: f64 = 1.0;
        for Crossing { joint, lever, .. } in path.joints.iter().take(MAX_SPANS) {
            let [before, after] = lever.wraps(q[*joint]);
            let expected = (sign * cable.friction.coefficient * (turned + before)).exp();
            turned += before + after;
            let felt = hand.transmission.springs[*joint] * q[*joint] / lever.moment_arm(q[*joint]);
            println!("joint {joint} at {:.3}: {:.4} of the tension, expected {expected:.4}", q[*joint], felt / tension);
            assert!((felt / tension / expected - 1.0).abs() < 0.02, "joint {joint}: {felt} of {tension}");
            least = least.min(expected.min(1.0 / expected));
        }
        assert!(least < 0.9, "there is something to measure: {least}");
    }
}
