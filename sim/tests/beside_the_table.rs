//! An object that leaves the table falls on the floor, if there is one, and stays where it fell.

use hand_model::{Arm, RobotModel};
use nalgebra::Isometry3;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectSet;
use world::physics::Physics;

/// Height of the floor, m.
const FLOOR: f64 = -0.75;

/// Returns the height (m) and upward speed (m/s) of a cube, initially 0.1 m beyond the table's edge, at these times
/// (s).
fn falling(floor: Option<f64>, times: [f64; 2]) -> [(f64, f64); 2] {
    let model = ObjectSet::standard().get("cube_45").expect("an object").clone();
    let table = Physics::standard().table;
    let beyond = table.center[0] + table.half[0] + 0.1;
    let pose = Isometry3::from_parts([beyond, 0.0, model.rest_height()].into(), model.rest);
    let setup = SceneSetup {
        objects: vec![ObjectPlacement { model, pose }],
        floor,
        ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home)
    };
    let mut robot = SimulatedRobot::new(&RobotModel::ftac_gen3(), &setup, TactileBoard::blank());
    times.map(|time| {
        while robot.wait_for_tick().time < time {}
        let truth = robot.truth();
        (truth.objects[0].translation.z, truth.velocities[0].z)
    })
}

#[test]
fn a_floor_stops_what_falls() {
    let [(soon, _), (late, _)] = falling(Some(FLOOR), [2.0, 6.0]);
    assert!((soon - (FLOOR + 0.0225)).abs() < 2e-3, "{soon}");
    assert!((late - soon).abs() < 1e-4, "{soon} {late}");
}

/// Without a floor it falls for ever and conserves its energy: the square of its speed is 2 g times the height it has
/// lost.
#[test]
fn without_a_floor_it_falls_for_ever() {
    for (height, speed) in falling(None, [0.5, 1.0]) {
        let lost = speed * speed / (2.0 * 9.81);
        assert!(height < -1.0 && ((0.0225 - height) / lost - 1.0).abs() < 0.02, "{height} m at {speed} m/s");
    }
}
