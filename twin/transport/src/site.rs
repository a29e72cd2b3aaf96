//! Scene of a transport: balls on the table, the robot over them, and the test for balls that are truly in its hand.

use std::sync::Arc;

use anyhow::Result;
use control::executor::Executor;
use control::motion::MotionProtocol;
use grasp_verification::rollout::RolloutSnapshot;
use grasp_verification::simulated_world::{SimulatedWorld, tick};
use nalgebra::Isometry3;
use scenarios::noise::TrialNoise;
use sim::robot::{GroundTruth, SimulatedRobot};
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup};
use world::holding::{SupportState, TRANSPORTED_RULE};
use world::objects::ObjectModel;

/// Builds the scene: the empty hand over balls at their places. Arm and perception have the execution error of
/// `noise`.
pub fn build_scene(
    world: &SimulatedWorld,
    protocol: MotionProtocol,
    balls: &[(Arc<ObjectModel>, Isometry3<f64>)],
    noise: &TrialNoise,
    board: TactileBoard,
) -> Result<RolloutSnapshot> {
    let scene = SceneSetup {
        objects: balls.iter().map(|(model, pose)| ObjectPlacement { model: model.clone(), pose: *pose }).collect(),
        ..world.bare_scene(world.cell.ready_posture, noise)
    };
    let robot = SimulatedRobot::new(&world.cell.robot, &scene, board);
    let (hand, servo) = (world.cell.robot.hand.clone(), world.cell.arm_servo(world.cell.ready_posture)?);
    let executor = Executor::new(hand, servo, protocol, Vec::new(), robot.tick_length())?;
    Ok(RolloutSnapshot { robot, executor })
}

/// Runs to the next decision. Calls `watch` after every tick and stops early if it returns `false`. Returns true if the
/// decision was reached.
pub fn run_until_decision(
    RolloutSnapshot { robot, executor }: &mut RolloutSnapshot,
    mut watch: impl FnMut(&mut SimulatedRobot, &Executor) -> Result<bool>,
) -> Result<bool> {
    while !executor.phase().waits_for_decision() {
        tick(robot, executor)?;
        if !watch(robot, executor)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// True if ball `index` is in the hand: held by it or leaning on another object, off the table, lifted and within reach
/// of the palm ([`TRANSPORTED_RULE`]).
pub fn is_in_hand(truth: &GroundTruth, index: usize) -> bool {
    let ball = truth.support(index);
    let leaning = truth.object_pairs.iter().any(|pair| pair.0 == index || pair.1 == index);
    TRANSPORTED_RULE.holds(&SupportState { held: ball.held || leaning, ..ball })
}
