//! Objects left alone on the table come to rest and stay there; rolling resistance stops balls that roll.

use hand_model::{Arm, RobotModel};
use nalgebra::Isometry3;
use sim::engine::EngineSettings;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectSet;

/// Motion allowed while settling, m: an object on its side has facets and may roll by half a facet.
const MAX_SETTLING_MOTION: f64 = 2e-3;
/// Settling time, s.
const SETTLING_TIME: f64 = 8.0;
/// Motion after settling above which an object creeps, m.
const MAX_CREEP: f64 = 1e-4;
/// Duration of observation after settling, s.
const OBSERVATION_TIME: f64 = 12.0;

#[test]
fn objects_rest_where_they_are_put() {
    let mut crept = Vec::new();
    for model in ObjectSet::standard().iter() {
        let pose = Isometry3::from_parts([0.62, 0.14, model.rest_height()].into(), model.rest);
        let setup = SceneSetup {
            objects: vec![ObjectPlacement { model: model.clone(), pose }],
            ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home)
        };
        let model = RobotModel::ftac_gen3();
        let mut robot = SimulatedRobot::new(&model, &setup, TactileBoard::blank());
        let mut position_at = |time: f64| {
            while robot.wait_for_tick().time < time {}
            robot.truth().objects[0].translation.vector
        };
        let settled = position_at(SETTLING_TIME);
        let rolled = (settled - pose.translation.vector).norm();
        let moved = (position_at(OBSERVATION_TIME) - settled).norm();
        println!("{:14} settled by {:.3} mm, then moved {:.4} mm", model.name, rolled * 1e3, moved * 1e3);
        if rolled > MAX_SETTLING_MOTION || moved > MAX_CREEP {
            crept.push(model.name.clone());
        }
    }
    assert!(crept.is_empty(), "these creep: {crept:?}");
}

/// A golf ball rolled over the table travels as far as its energy lasts against the resistance: v^2 / (2 c g / 1.4),
/// once slip has turned into rolling.
#[test]
fn a_rolling_ball_is_stopped() {
    let objects = ObjectSet::standard();
    let model = objects.get("golf_ball").unwrap();
    let height = model.rest_height();
    let law = |speed: f64| 1.4 * speed * speed / (2.0 * EngineSettings::default().rolling_resistance * 9.81);
    let pose = Isometry3::from_parts([0.62, 0.14, height].into(), model.rest);
    let setup = SceneSetup {
        objects: vec![ObjectPlacement { model: model.clone(), pose }],
        ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home)
    };
    let mut robot = SimulatedRobot::new(&RobotModel::ftac_gen3(), &setup, TactileBoard::blank());
    let speed = 0.1;
    robot.add_velocity(0, &nalgebra::Vector3::new(0.0, speed, 0.0));
    let mut rolling = None;
    while robot.wait_for_tick().time < 3.0 {
        let truth = robot.truth();
        // Slip ends when five sevenths of the speed remain.
        if rolling.is_none() && truth.velocities[0].y < speed * 5.0 / 7.0 {
            rolling = Some((truth.objects[0].translation.y, truth.velocities[0].y));
        }
    }
    let truth = robot.truth();
    let (start, speed) = rolling.expect("it slows down");
    let rolled = truth.objects[0].translation.y - start;
    assert!(truth.velocities[0].norm() < 1e-3, "it still rolls");
    assert!((rolled / law(speed) - 1.0).abs() < 0.2, "rolled {rolled} m, expected {} m", law(speed));
}
