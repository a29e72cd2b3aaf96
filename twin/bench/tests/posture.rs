//! Joint angles of simulated holds with cable friction and gear backlash.

use bench::builtin::make_bench;
use hand_model::transmission::Crossing;
use hand_model::{Digit, RobotModel};
use nalgebra::Isometry3;
use scenarios::Scenario;
use scenarios::effects::Effects;
use tactile_perception::PadTouch;

/// Number of combinations whose first grasp is perceived.
const HOLD_COUNT: usize = 60;
/// Half width of a 95 % region, standard deviations.
const REGION_HALF_WIDTH: f64 = 1.96;

/// Number of joint angles of digits in contact that lie within their 95 % region.
#[derive(Default)]
struct Tally {
    inside: u32,
    count: u32,
}

/// The 95 % regions of the joint angles of digits in contact contain about as many of the true angles.
#[test]
fn joint_angles_are_as_uncertain_as_they_say() {
    let mut scenario = Scenario::benchmark();
    let all = scenario.effects;
    scenario.effects = Effects { cables: all.cables, ..Effects::default() };
    let bench = make_bench(&RobotModel::ftac_gen3(), scenario, HOLD_COUNT, 1, true).expect("the built-in benchmark");
    let mut tally = Tally::default();
    for combination in 0..HOLD_COUNT {
        let Some(grasp) = bench.held_grasp(combination, 0).expect("run") else { continue };
        let known = &bench.known_objects[&grasp.object];
        let objects: [(_, Isometry3<f64>); 1] = [(&known.model.shape, grasp.truth)];
        let hand = &bench.world.cell.robot.hand;
        let mut board = bench.cameras.with_noise(combination as u64);
        let frames = board.capture(hand, 0.0, &grasp.pads, &grasp.forces, &objects);
        let touches = bench.pipeline.perceive_frames(&frames, &[]).expect("images").touches;
        let prior = grasp.prior;
        let estimate =
            bench.pipeline.estimate_pose(&touches, grasp.readings(&grasp.servos()), &prior, known).expect("a pose");
        for digit in Digit::ALL {
            let touched =
                |touch: &PadTouch| touch.is_touched() && hand.digit_of(hand.pads[touch.pad].link) == Some(digit);
            if !touches.iter().any(touched) {
                continue;
            }
            for Crossing { joint, .. } in &hand.transmission.cables[digit.index()].joints {
                let sigma = estimate.q_covariance[(*joint, *joint)].sqrt();
                tally.inside +=
                    u32::from((estimate.q[*joint] - grasp.joints[*joint]).abs() < REGION_HALF_WIDTH * sigma);
                tally.count += 1;
            }
        }
    }
    println!("{} of {} inside", tally.inside, tally.count);
    assert!(tally.count > 60);
    let share = f64::from(tally.inside) / f64::from(tally.count);
    assert!((0.9..=1.0).contains(&share), "{share}");
}
