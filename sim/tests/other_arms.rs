//! The built-in arms: each stands in its home posture, with the joint torques that statics requires.

use std::path::Path;

use hand_model::RobotModel;
use hand_model::gravity::gravity_torques;
use hand_model::robot::{RobotCommand, ServoGoal};
use nalgebra::Isometry3;
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

fn shipped(name: &str) -> RobotModel {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../hand-model/data/robots").join(name);
    RobotModel::read(&path).expect("valid")
}

#[test]
fn every_arm_holds_its_home_posture() {
    for (name, joints) in [("ftac_ur5e.toml", 6), ("ftac_panda.toml", 7), ("ftac_right.toml", 7)] {
        let model = shipped(name);
        assert_eq!(model.arm.joints(), joints, "{name}");
        let home = model.arm.home;
        let mut robot =
            SimulatedRobot::new(&model, &SceneSetup::ideal(Isometry3::identity(), home), TactileBoard::blank());
        let command = RobotCommand { arm: home, servos: [ServoGoal::Current(0.0); 6].into(), capture: false };
        while robot.time() < 1.5 {
            assert_eq!(robot.send(&command).arm.len(), joints);
            robot.wait_for_tick();
        }
        let shown = robot.observe().arm;
        for (joint, (at, home)) in shown.position.iter().zip(home).enumerate() {
            assert!((at - home).abs() < 2e-3, "{name}, joint {joint}: {at} rad, {home} rad asked for");
        }
        let law = gravity_torques(&model, &shown.position);
        for (joint, torque) in shown.torque.iter().enumerate() {
            // The simulated digits hang on their springs; the static law assumes them straight.
            assert!((torque - law[joint]).abs() < 0.3, "{name}, joint {joint}: {torque} N m, {} N m", law[joint]);
        }
    }
}
