//! Trials on the directly emulated robot, whose commands and measurements pass the supervisor. The supervisor stops
//! none of them for its forces, its workspace or its set-points.

use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use hand_model::RobotModel;
use robot_backends::TrialTask;
use robot_backends::direct_emulation::DirectEmulationFactory;
use scenarios::record::Condition;
use scenarios::{FailureCause, Scenario};

#[test]
fn no_normal_trial_is_stopped() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 2, 1, true).expect("the built-in benchmark");
    let cell = &bench.world.cell;
    for (combination, condition) in [(0, Condition::Blind), (1, Condition::Touch)] {
        let mut source = DirectEmulationFactory { robot: cell.robot.clone(), sessions: None };
        let task = TrialTask::new("direct", 1, [combination, 0, 2], condition);
        // A robot that stops fails the test.
        let record = bench.run(&task, &mut source, &mut NoWatcher).expect("no stop").record;
        assert_ne!(record.cause, Some(FailureCause::RobotFault), "{}", record.reason);
    }
}
