//! An arm that differs from its controller's model: encoder offsets move the palm by an amount that depends on the
//! posture, and an unknown payload makes it sag in proportion.

use hand_model::robot::{RobotCommand, ServoGoal};
use hand_model::{Arm, ArmVector, Hand, RobotModel};
use nalgebra::{Isometry3, Vector3};
use plant::ArmDefects;
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// Settling time, s.
const SETTLING_TIME: f64 = 1.5;

/// Returns the palm's true pose and the encoder readings at rest when `posture` (rad) is commanded.
fn at_rest(posture: ArmVector, defects: ArmDefects) -> (Isometry3<f64>, ArmVector) {
    let setup = SceneSetup { arm_defects: defects, ..SceneSetup::ideal(Isometry3::identity(), posture) };
    let model = RobotModel::ftac_gen3();
    let mut robot = SimulatedRobot::new(&model, &setup, TactileBoard::blank());
    let command = RobotCommand { arm: posture, servos: [ServoGoal::Current(0.0); 6].into(), capture: false };
    while robot.time() < SETTLING_TIME {
        robot.send(&command);
        robot.wait_for_tick();
    }
    (robot.truth().palm, robot.observe().arm.position)
}

/// The encoders show the commanded angles, and the palm is where forward kinematics of the true joint angles places it.
#[test]
fn encoder_offsets_move_the_palm_by_posture() {
    let (hand, arm) = (Hand::ftac(), Arm::gen3());
    let encoders = [0.007, -0.004, 0.009, 0.006, -0.008, 0.005, 0.01];
    let mount_position = Vector3::new(0.001, -0.002, 0.0);
    let defects = ArmDefects { encoders: encoders.into(), mount_position, ..ArmDefects::default() };
    let folded = Arm::gen3().home;
    let mut stretched = folded;
    stretched[1] += 0.4;
    stretched[3] += 0.5;
    let errors = [folded, stretched].map(|posture| {
        let (palm, shown) = at_rest(posture, defects);
        for (shown, commanded) in shown.iter().zip(posture) {
            assert!((shown - commanded).abs() < 2e-3, "shown {shown} rad, commanded {commanded} rad");
        }
        let from_flange = hand.palm_from_flange.inverse();
        let law = arm.tool_pose(&defects.true_angles(&shown)) * defects.mount() * from_flange;
        let off = (palm.translation.vector - law.translation.vector).norm();
        assert!(off < 2e-4, "the palm is {off} m from where its joints put it");
        palm.translation.vector - (arm.tool_pose(&shown) * from_flange).translation.vector
    });
    let [one, other] = errors;
    assert!(one.norm() > 2e-3 && (one - other).norm() > 1e-3, "{one} {other}");
}

/// A payload unknown to gravity compensation makes the arm sag, twice the payload twice as far.
#[test]
fn an_unknown_payload_makes_the_arm_sag() {
    let height =
        |payload: f64| at_rest(Arm::gen3().home, ArmDefects { payload, ..ArmDefects::default() }).0.translation.z;
    let [none, some, twice] = [0.0, 0.2, 0.4].map(height);
    let (sag, double) = (none - some, none - twice);
    assert!(sag > 1e-4, "it sags by {sag} m");
    assert!((double / sag - 2.0).abs() < 0.2, "{sag} m, {double} m");
}
