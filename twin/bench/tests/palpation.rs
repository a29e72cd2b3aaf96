//! Palpation finds an object that is not at its detected pose, in physics and from rendered images.

use bench::builtin::make_bench;
use control::detection::DetectedObject;
use control::executor::{GraspTarget, Phase, Skill};
use control::guarded::GuardedMotion;
use control::palpation::estimate_touched_pose;
use control::perception::{ExpectedHolds, default_prior, estimate_hold};
use control::sensing::TouchPerception;
use dexterous_grasping::digit_sets;
use grasp_verification::simulated_world::drive;
use hand_model::RobotModel;
use nalgebra::Vector3;
use scenarios::Scenario;
use tactile_perception::{ExpectedObject, PosePrior};
use world::Sensing;

/// Combinations whose second objects have the top of a pear, a cylinder and a sphere.
const COMBINATIONS: [usize; 3] = [10, 1, 15];
/// Offset of the detected object from its true position, along the palm's x, m.
const DETECTION_OFFSET: f64 = 0.012;

#[test]
fn an_object_is_where_it_is_felt() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 16, 1, true).expect("the built-in benchmark");
    let senses = TouchPerception::new(&bench.pipeline, Sensing::Full).expect("all senses");
    let hand = &bench.world.cell.robot.hand;
    for (combination, side) in
        COMBINATIONS.into_iter().flat_map(|combination| [(combination, -1.0), (combination, 1.0)])
    {
        let mut trial = bench.ideal_start(combination).expect("a trial");
        let (robot, executor) = (&mut trial.robot, &mut trial.executor);
        executor.continue_as_planned().expect("a path");
        drive(robot, executor, Phase::decide(Skill::Snapshot, 0), |_, _| {}).expect("the first grasp");
        let GraspTarget { grasp: first, detected: seen_first } = executor.target(0).clone();
        let second = executor.target(1).grasp.clone();
        let known = [&first.object, &second.object].map(|name| &bench.known_objects[name]);
        let expected = ExpectedHolds::from_grasps(&first, &seen_first, Some(&second));
        let felt = estimate_hold(&senses, &executor.motion().snapshot(), known[0], &expected).expect("felt");

        let seen = executor.target(1).detected;
        let lateral = second.palm_rotation(seen.yaw) * Vector3::x() * DETECTION_OFFSET * side;
        executor.update_detection(1, DetectedObject { position: seen.position + lateral, ..seen });
        let touching = executor.feasible_palpations(1, &known[1].model.shape).next().expect("within reach");
        let guarded = GuardedMotion::new(touching.guarded_motion, hand, &digit_sets(hand, 2)[1], |_| true);
        executor.palpate(1, touching.approach, guarded);
        drive(robot, executor, Phase::decide(Skill::Palpate, 1), |_, _| {}).expect("the touch");

        let seen = executor.target(1).detected.pose();
        let palm_from_object = executor.motion().palm().inverse() * seen;
        let prior = PosePrior { palm_from_object, sigma_translation: 0.01, sigma_rotation: 0.08 };
        let held = ExpectedObject { shape: known[0], prior: default_prior(felt.estimate.palm_from_object) };
        let found = estimate_touched_pose(&senses, &executor.motion().snapshot(), known[1], &prior, Some(held))
            .expect("perceived");
        let estimate = found.unwrap_or_else(|| panic!("combination {combination}: found no contact"));
        let truth = robot.truth();
        let real = (truth.palm.inverse() * truth.objects[1]).translation.vector;
        let believed = |pose: &nalgebra::Isometry3<f64>| (pose.translation.vector - real).x.abs();
        let (before, after) = (believed(&palm_from_object), believed(&estimate.palm_from_object));
        assert!(before > 0.008, "combination {combination}: {before}");
        assert!(after < 0.004, "combination {combination}, {}: {after}, {before} before", second.object);
        assert!(truth.object_pairs.is_empty(), "combination {combination}: the held object touches it");
    }
}
