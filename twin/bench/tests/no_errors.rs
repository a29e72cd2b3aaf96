//! A robot without errors at a table without effects, and a controller that knows both.

use hand_model::RobotModel;
use std::path::Path;

use bench::builtin::{make_bench, set_expected_errors};
use bench::trial::NoWatcher;
use scenarios::Scenario;
use scenarios::effects::Effect;
use scenarios::record::Condition;

/// In this trial touch once palpated both objects, estimated an error of a millimetre that did not exist, and touched
/// the second object with the first one's digits. Blind never did.
#[test]
fn feeling_costs_nothing_where_nothing_is_wrong() {
    let mut scenario = Scenario::benchmark();
    scenario.noise = scenario.noise.scaled(0.0);
    scenario.effects = Effect::ALL.into_iter().fold(scenario.effects, |effects, effect| effects.without(effect));
    assert!(scenario.is_ideal());
    let mut bench = make_bench(&RobotModel::ftac_gen3(), scenario, 1, 1, true).expect("a bench");
    set_expected_errors(&mut bench, None, Path::new("uncertainty"), "sim").expect("set");
    let results = bench.run_each_condition(0, 0, &[Condition::Touch], &[], &mut NoWatcher).expect("a trial");
    let record = &results.records[0];
    assert!(record.clean_success, "{record:?}");
    assert!(!record.reason.contains("is touched from above"), "{}", record.reason);
}
