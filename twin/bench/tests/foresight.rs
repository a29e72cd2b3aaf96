//! The twin of a scene, built from estimates, behaves as the scene does.

use bench::builtin::make_scenes;
use control::executor::{Phase, Skill};
use control::foresight::{Draw, Scene, Twin};
use control::odds::TryOutcome;
use grasp_verification::simulated_world::drive;
use grasp_verification::twin::SceneTwin;
use hand_model::RobotModel;
use nalgebra::Translation3;
use scenarios::Scenario;

/// With a known hold and target, the planned grasp holds in the twin as it does in the plan's own run. With the target
/// a hand's breadth off it does not. An object that is not in the hand is not a hold.
#[test]
fn the_planned_grasp_holds_in_the_twin_where_the_target_is() {
    let bench =
        make_scenes(&RobotModel::ftac_gen3(), Scenario::benchmark(), 3, 1, true).expect("the built-in benchmark");
    // Objects in the twin are as modelled, as they are in the plan's own run.
    let mut world = bench.world.clone();
    world.scenario.effects.objects = None;
    for combination in 0..3 {
        let mut snapshot = bench.ideal_start(combination).expect("a start");
        snapshot.executor.go_on().expect("a path");
        drive(&mut snapshot.robot, &mut snapshot.executor, Phase::decide(Skill::Look, 0), |_, _| {}).expect("a hold");
        let (truth, executor) = (snapshot.robot.truth(), &snapshot.executor);
        let plan = &bench.plans.plans[combination];
        let objects = [&plan.first, &plan.second].map(|name| bench.world.object(name).expect("known"));
        let held = truth.palm.inverse() * truth.objects[0];
        let beside = |x: f64| Translation3::new(x, 0.0, 0.0) * truth.objects[1];
        let draws = [
            Draw { held, target: beside(0.0) },
            Draw { held, target: beside(0.09) },
            Draw { held: Translation3::new(0.0, 0.0, -0.3) * held, target: beside(0.0) },
        ];
        let twin = SceneTwin::new(world.clone(), bench.board.clone());
        let imagined =
            twin.imagine(&Scene { executor, objects: &objects, joints: &truth.hand, draws: &draws }).expect("a scene");
        let mut going = executor.clone();
        going.go_on().expect("a path");
        let outcomes = imagined.play(&going, 0..3).expect("played");
        assert_eq!(outcomes[0], Some(TryOutcome::Held), "{} and {}", plan.first, plan.second);
        assert_ne!(outcomes[1], Some(TryOutcome::Held), "{} and {}", plan.first, plan.second);
        assert_eq!(outcomes[2], None, "{} and {}", plan.first, plan.second);
        // A second rollout gives the same outcomes.
        assert_eq!(imagined.play(&going, 0..1).expect("played"), outcomes[..1]);
    }
}
