//! Joint angles of simulated holds with cables that rub and gears with play.

use bench::builtin::make_bench;
use hand_model::{CAMERAS, Digit};
use nalgebra::Isometry3;
use scenarios::Scenario;
use scenarios::effects::{Effect, Effects};
use touch::posture::digit_of;

/// Of so many combinations the first grasp is felt.
const HOLDS: usize = 24;
/// Half width of a region of 95 %, standard deviations.
const REGION: f64 = 1.96;

/// Regions of 95 % of the joint angles of digits in contact hold about as many of the true angles, and no fewer than without
/// friction.
#[test]
fn joint_angles_are_as_uncertain_as_they_say() {
    let mut scenario = Scenario::benchmark();
    let all = scenario.effects;
    scenario.effects = Effects { cables: all.cables, ..Effects::default() };
    assert!(
        Effect::ALL
            .into_iter()
            .filter(|effect| *effect != Effect::Cables)
            .all(|effect| { scenario.effects.without(effect) == scenario.effects })
    );
    let bench = make_bench(scenario, HOLDS, 1, true).expect("the built-in benchmark");
    let (mut inside, mut count, mut squares) = (0, 0, 0.0);
    for combination in 0..HOLDS {
        let Some(grasp) = bench.held(combination, 0).expect("played") else { continue };
        let known = &bench.known[&grasp.object];
        let objects: [(_, Isometry3<f64>); 1] = [(&known.model.shape, grasp.truth)];
        let hand = &bench.world.cell.hand;
        let frames =
            bench.board.with_noise(combination as u64).capture(hand, 0.0, &grasp.pads, &grasp.forces, &objects);
        let touches = bench.pipeline.perceive_frames(&frames, &[None; CAMERAS]).expect("images").touches;
        let prior = control::perception::trusted(grasp.expected);
        let estimate = bench.pipeline.estimate_pose(&touches, &grasp.servos(), &prior, known).expect("a pose");
        for digit in Digit::ALL {
            let touched =
                |touch: &&touch::PadTouch| touch.touched() && digit_of(hand.pads[touch.pad].link) == Some(digit);
            if !touches.iter().any(|touch| touched(&touch)) {
                continue;
            }
            for joint in hand.transmission.cables[digit.index()].joints.iter().map(|(joint, _)| *joint) {
                let sigma = estimate.q_covariance[(joint, joint)].sqrt();
                let off = (estimate.q[joint] - grasp.joints[joint]) / sigma;
                println!("{} joint {joint}: off {:+.3} rad, sigma {sigma:.3}", grasp.object, off * sigma);
                inside += usize::from(off.abs() < REGION);
                count += 1;
                squares += off * off;
            }
        }
    }
    let share = f64::from(inside as u32) / f64::from(count as u32);
    println!("{inside} of {count} inside: {share:.3}; mean square {:.2}", squares / f64::from(count as u32));
    assert!(count > 60 && (0.88..=1.0).contains(&share), "{inside} of {count}");
}
