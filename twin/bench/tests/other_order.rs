//! Grasping the two objects in the other order changes only the order.

use bench::builtin::make_bench;
use bench::trial::setup::InitialConditions;
use bench::trial::{NoWatcher, PolicyCapabilities};
use hand_model::RobotModel;
use plant::CameraFailure;
use scenarios::Scenario;
use scenarios::disturbance::{Disturbances, FailedPadCameras};
use scenarios::record::Condition;

/// If the trial is uncertain and the other order has a higher expected score, the other object comes first. The poses,
/// detections and errors are those of the planned order. A disturbed scenario keeps the planned order.
#[test]
fn the_other_order_leaves_everything_where_it_is() {
    let bench =
        make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 60, 1, true).expect("the built-in benchmark");
    let means = PolicyCapabilities::for_condition(Condition::Touch).expect("touch decides");
    let mut seen = 0;
    for combination in (0..60).filter(|n| bench.grasp_pairs.pairs[*n].reversed.is_some()) {
        let (setup, _) = InitialConditions::noisy(&bench, combination, 0).expect("a trial");
        let ordered = setup.reordered_for(&bench, means).expect("an order");
        if ordered.reordered.is_none() {
            continue;
        }
        seen += 1;
        let begin = |setup: &InitialConditions| setup.begin_at_rest(&bench, None, &mut NoWatcher).expect("a start");
        let (planned, other) = (begin(&setup), begin(&ordered));
        let objects =
            |start: &bench::trial::setup::PreparedTrial| start.run.snapshot.robot.truth().expect("simulated").objects;
        let (there, mut here) = (objects(&planned), objects(&other));
        here.reverse();
        assert_eq!(there, here, "{}", ordered.grasp_pair.first);
        let (planned, other) = (&planned.run.snapshot.executor, &other.run.snapshot.executor);
        assert_eq!([0, 1].map(|n| planned.target(n).detected), [1, 0].map(|n| other.target(n).detected));
        let blind_pads = Some(FailedPadCameras { pads: vec!["ring_distal".to_owned()], frames: CameraFailure::Black });
        let disturbances = Disturbances { blind_pads, ..Disturbances::default() };
        let disturbed = InitialConditions { disturbances, ..setup };
        assert!(disturbed.reordered_for(&bench, means).expect("an order").reordered.is_none());
    }
    assert!(seen > 0, "no combination is taken in the other order");
}
