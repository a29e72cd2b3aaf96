//! The policies and the choice of grasps in constructed situations: no simulator, no images.

mod choice;
mod chosen;
mod in_turn;
mod lists;
mod retries;
mod table;
mod ways_out;

use control::detection::DetectedObject;
use control::policy::blind::BlindPolicy;
use control::policy::{PolicyStep, TrialPolicy};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use self::table::*;

#[test]
fn blind_carries_out_the_plan_and_never_looks() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut blind = BlindPolicy::new(executor.targets().iter().map(|target| target.grasp.clone()).collect());
    for (phase, then) in [(DECIDE, PolicyStep::Continue), (CONFIRM, PolicyStep::Continue), (DONE, PolicyStep::Finish)] {
        run_until(&mut executor, phase);
        blind.perceive(&executor, in_hand(false, false)).expect("nothing to perceive");
        assert_eq!(blind.decide(&mut executor, &mut detector, 0.0).expect("decided"), then);
    }
    assert_eq!(detector.detections, [0, 0]);
    assert!(blind.trace().is_as_planned() && blind.trace().reasons.is_empty());
}

/// A detected pose returns the pose from which it was made.
#[test]
fn a_detection_keeps_the_pose() {
    let table = Table::new();
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.4);
    let pose = Isometry3::from_parts(Translation3::new(0.5, 0.1, 0.02), turned * table.objects[0].rest);
    let detected = DetectedObject::from_pose(&table.objects[0], &pose);
    assert!((detected.pose().translation.vector - pose.translation.vector).norm() < 1e-12);
    assert!(detected.pose().rotation.angle_to(&pose.rotation) < 1e-9);
}
