//! Force of the arm on the table under a controller that keeps moving down, with and without the supervisor's limits.

use hand_model::robot::{RobotBackend as _, RobotCommand, ServoGoal};
use hand_model::{Arm, ArmVector, Hand, RobotModel};
use hardware_bridge::config::{ArmLimitConfig, LimitConfig, WorkspaceConfig};
use hardware_bridge::emulator::direct::DirectRobot;
use hardware_bridge::safety::state::{StopCause, SupervisorState};
use nalgebra::{Isometry3, Point3, Vector3, Vector6};
use robot_backends::wire_emulation::{SharedPlant, lockstep_settings};
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// Requested downward speed of the hand, m/s.
const DOWNWARD_SPEED: f64 = 0.05;
/// Ticks from 50 mm above the table on: 1 s to reach it, 2 s more.
const TICK_COUNT: usize = 360;

/// Returns the joint angles after the hand has moved by `step` (m) without turning: damped least squares.
fn moved(arm: &Arm, q: &[f64], step: Vector3<f64>) -> ArmVector {
    let poses = arm.tree.forward(q);
    let jacobian = arm.tree.jacobian(&poses, arm.last_link(), &Point3::origin());
    let mut square = &jacobian * jacobian.transpose();
    (0..6).for_each(|n| square[(n, n)] += 1e-6);
    let twist = Vector6::new(step.x, step.y, step.z, 0.0, 0.0, 0.0);
    let change = square.cholesky().map(|root| jacobian.transpose() * root.solve(&twist)).expect("damped");
    q.iter().zip(&change).map(|(angle, change)| angle + change).collect()
}

/// Returns joint angles with the hand flat and its lowest point at this `height` above the table, m.
fn over_table(arm: &Arm, hand: &Hand, height: f64) -> ArmVector {
    let lowest = |q: &[f64]| {
        let palm = arm.tool_pose(q) * hand.palm_from_flange.inverse();
        let links = hand.tree.forward(&[0.0; 15]);
        let poses = std::iter::once(palm).chain(links.iter().map(|link| palm * link));
        let covers = std::iter::once(&hand.palm_cover).chain(&hand.covers);
        let down = -Vector3::z();
        let of = |(pose, cover): (Isometry3<f64>, &hand_model::hand::CoverShape)| {
            let skin = cover.skin_elements(0.002);
            skin.iter().map(|one| -(pose * one.point).coords.dot(&down)).fold(f64::INFINITY, f64::min)
        };
        poses.zip(covers).map(of).fold(f64::INFINITY, f64::min)
    };
    let mut q = Arm::gen3().home;
    for _ in 0..200 {
        let left = height - lowest(&q);
        q = moved(arm, &q, Vector3::new(0.0, 0.0, left.clamp(-0.01, 0.01)));
    }
    assert!((lowest(&q) - height).abs() < 1e-3, "{}", lowest(&q));
    q
}

/// Returns the greatest and the final force on the table (N), and the final state, of a robot whose controller commands
/// 5 cm/s downwards.
fn press(limits: LimitConfig) -> (f64, f64, SupervisorState) {
    let model = RobotModel::ftac_gen3();
    let mut wanted = over_table(&model.arm, &model.hand, 0.05);
    let scene = SceneSetup::ideal(Isometry3::identity(), wanted);
    let plant = SharedPlant::new(SimulatedRobot::new(&model, &scene, TactileBoard::blank()));
    let settings =
        hardware_bridge::emulator::lockstep::LockstepSettings { limits, ..lockstep_settings(&model.hand, 1) };
    let mut robot = DirectRobot::start(Box::new(plant.clone()), settings, &model).expect("starts");
    let mut greatest = 0.0_f64;
    for tick in 0..TICK_COUNT {
        // From rest, as all built-in controllers start.
        let speed = DOWNWARD_SPEED * (tick as f64 / 30.0).min(1.0);
        wanted = moved(&model.arm, &wanted, Vector3::new(0.0, 0.0, -speed * robot.tick_length()));
        let servos = [ServoGoal::Current(0.0); 6].into();
        robot.send(&RobotCommand { arm: wanted, servos, capture: false }).expect("sent");
        robot.wait_for_tick();
        greatest = greatest.max(plant.lock().force_on_table());
    }
    let last = plant.lock().force_on_table();
    println!("greatest force on the table {greatest:.1} N, at the end {last:.1} N, {}", robot.state());
    (greatest, last, robot.state())
}

/// Returns the former limits: speed and range of the joints only.
fn joint_limits_only() -> LimitConfig {
    let most = 1e6;
    let arm = ArmLimitConfig {
        acceleration: [most; 7].into(),
        jerk: [most; 7].into(),
        torque: [most; 7].into(),
        residual: [most; 7].into(),
        following: most,
        ..ArmLimitConfig::default()
    };
    let space = WorkspaceConfig {
        tolerance: most,
        low: [-most; 3],
        high: [most; 3],
        clearance: -most,
        ..WorkspaceConfig::default()
    };
    LimitConfig { arm, space, ..LimitConfig::default() }
}

/// An external policy commands 5 cm/s downwards. Without limits, two joints press with full torque as long as it does.
/// With them the arm is stopped as soon as it presses, reports the joint, and yields.
#[test]
fn an_arm_that_presses_on_the_table_is_stopped() {
    let (before, held, state) = press(joint_limits_only());
    assert!(before > 60.0 && held > 0.9 * before && state == SupervisorState::Running, "{before} N, {held} N, {state}");
    let (after, left, state) = press(LimitConfig::default());
    assert!(matches!(state, SupervisorState::Hold(StopCause::ArmResidual(..))), "{state}");
    assert!(after < 0.6 * before && left < 10.0, "{after} N, {left} N, {before} N without");
}

/// Without torque sensing in the arm, the table itself is the bound.
#[test]
fn an_arm_without_torque_sensors_is_stopped_below_the_table() {
    let arm = ArmLimitConfig { residual: [1e6; 7].into(), torque: [1e6; 7].into(), ..ArmLimitConfig::default() };
    let (_, _, state) = press(LimitConfig { arm, ..LimitConfig::default() });
    assert!(matches!(state, SupervisorState::Hold(StopCause::Table(..))), "{state}");
}
