//! The built-in grasp pairs, run in physics.

use hand_model::RobotModel;
use std::sync::Mutex;

use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use bench::workers;
use scenarios::Scenario;

/// Without errors every one of the 60 combinations ends with both objects held and no unwanted contact.
#[test]
fn all_built_in_plans_are_ideal() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 60, 1, true).expect("the built-in benchmark");
    let combinations: Vec<usize> = (0..bench.grasp_pairs.pairs.len()).collect();
    assert_eq!(combinations.len(), 60);
    let failed = Mutex::new(Vec::new());
    workers::for_each(workers::available_threads(), &combinations, |_, combination| {
        let record = bench.run_ideal(*combination, &mut NoWatcher)?.record;
        if !record.success || record.contact {
            failed.lock().expect("no panic").push((record.first, record.second, record.cause, record.contact));
        }
        Ok(())
    })
    .expect("run");
    let failed = failed.into_inner().expect("no panic");
    assert!(failed.is_empty(), "{failed:?}");
}
