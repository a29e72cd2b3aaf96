//! A trial is the same to the bit, whatever its watchers and the trials before it.

use bench::builtin::make_bench;
use bench::trial::filming::Filming;
use bench::trial::{Bench, NoWatcher, Watcher};
use hand_model::RobotModel;
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use serde_json::Value;

/// Returns the results of touch in the first trial of a combination, without its decision times.
fn finished(bench: &Bench, combination: usize, watcher: &mut dyn Watcher) -> Value {
    let results = bench.run_each_condition(combination, 0, &[Condition::Touch], &[], watcher).expect("a trial");
    let record = TrialRecord { decision_ms: None, ..results.records[0].clone() };
    serde_json::to_value((record, &results.tries)).expect("JSON")
}

/// A recording takes images throughout. In this trial the hand touches both objects and tries the second one twice.
#[test]
fn a_trial_that_is_recorded_is_the_same_one() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 2, 1, true).expect("the built-in benchmark");
    let mut filming = Filming::new(&bench, Condition::Touch, 4.0);
    let recorded = finished(&bench, 1, &mut filming);
    assert!(!filming.film.frames.is_empty());
    assert_eq!(recorded, finished(&bench, 1, &mut NoWatcher));
}

/// Its objects are meshes that are cut into convex parts when they are first needed.
#[test]
fn what_was_played_before_does_not_matter() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 5, 1, true).expect("the built-in benchmark");
    let first = finished(&bench, 4, &mut NoWatcher);
    bench.run_ideal(4, &mut NoWatcher).expect("an ideal run");
    assert_eq!(first, finished(&bench, 4, &mut NoWatcher));
}
