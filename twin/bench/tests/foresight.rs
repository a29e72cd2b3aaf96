//! A rollout in a scene built from estimates behaves like the scene.

use bench::builtin::make_scene_bench;
use control::executor::{Phase, Skill};
use control::look_ahead::{RolloutModel, RolloutScene, StateSample};
use control::outcome_model::TryOutcome;
use grasp_verification::scene_model::SceneModel;
use grasp_verification::simulated_world::drive;
use hand_model::RobotModel;
use nalgebra::Translation3;
use scenarios::Scenario;

/// With a known hold and target, the planned grasp holds in the rollout as in the ideal run of its grasp pair. With the
/// target a hand's breadth off it does not. An object that is not in the hand is not a hold.
#[test]
fn the_planned_grasp_holds_in_the_twin_where_the_target_is() {
    let bench =
        make_scene_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 3, 1, true).expect("the built-in benchmark");
    // Objects in the rollout are as modelled, as in the ideal run.
    let mut world = bench.world.clone();
    world.scenario.effects.objects = None;
    for combination in 0..3 {
        let mut snapshot = bench.ideal_start(combination).expect("a start");
        snapshot.executor.continue_as_planned().expect("a path");
        drive(&mut snapshot.robot, &mut snapshot.executor, Phase::decide(Skill::Snapshot, 0), |_, _| {})
            .expect("a hold");
        let (truth, executor) = (snapshot.robot.truth(), &snapshot.executor);
        let plan = &bench.grasp_pairs.pairs[combination];
        let objects = [&plan.first, &plan.second].map(|name| bench.world.object(name).expect("known"));
        let held = truth.palm.inverse() * truth.objects[0];
        let beside = |x: f64| Translation3::new(x, 0.0, 0.0) * truth.objects[1];
        let draws = [
            StateSample { held, target: beside(0.0) },
            StateSample { held, target: beside(0.09) },
            StateSample { held: Translation3::new(0.0, 0.0, -0.3) * held, target: beside(0.0) },
        ];
        let twin = SceneModel::new(world.clone(), bench.cameras.clone());
        let imagined = twin
            .prepare(&RolloutScene { executor, objects: &objects, joints: &truth.hand, samples: &draws })
            .expect("a scene");
        let mut going = executor.clone();
        going.continue_as_planned().expect("a path");
        let outcomes = imagined.roll_out(&going, 0..3).expect("run");
        assert_eq!(outcomes[0], Some(TryOutcome::Held), "{} and {}", plan.first, plan.second);
        assert_ne!(outcomes[1], Some(TryOutcome::Held), "{} and {}", plan.first, plan.second);
        assert_eq!(outcomes[2], None, "{} and {}", plan.first, plan.second);
        // A second rollout gives the same outcomes.
        assert_eq!(imagined.roll_out(&going, 0..1).expect("run"), outcomes[..1]);
    }
}
