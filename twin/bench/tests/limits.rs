//! Trials on the rounded robot, whose commands and measurements pass the supervisor: none of them is stopped by what it presses, where it goes or how its
//! set-points move.

use bench::body::rounded::RoundedSource;
use bench::body::{Places, Task};
use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use hand_model::RobotModel;
use scenarios::record::Condition;
use scenarios::{FailureCause, Scenario};

#[test]
fn no_normal_trial_is_stopped() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 2, 1, true).expect("the built-in benchmark");
    let cell = &bench.world.cell;
    for (combination, condition) in [(0, Condition::Blind), (1, Condition::Touch)] {
        let mut source = RoundedSource { robot: cell.robot.clone(), sessions: None };
        let task = Task {
            robot: "rounded".to_owned(),
            seed: 1,
            combination,
            trial: 0,
            condition,
            watched: false,
            combos: 2,
            scenario: String::new(),
            robot_model: None,
            individual: None,
            pads: None,
            foresees: false,
            mirrored: false,
            places: Places::default(),
        };
        // A robot that stops is none that has been tried.
        let record = bench.play(&task, &mut source, &mut NoWatcher).expect("no stop").record;
        assert_ne!(record.cause, Some(FailureCause::RobotFault), "{}", record.reason);
    }
}
