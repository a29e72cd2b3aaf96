//! Simulation of the estimated scene, for rollouts of tries before one is chosen.
//!
//! It is built from the controller's knowledge: the nominal or identified robot, the objects' models, measured joint
//! angles, the held object as felt, and the target as detected. It never uses the robot backend on which the trial is
//! run. A hold is built anew for each draw: the held object is fastened at its felt pose in digits at their felt
//! angles, with servos and tensions as measured, and is then released. The uncertainty of the target's height goes into
//! the arm's height over the table, because the target stands on the table.

use std::ops::Range;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use control::executor::Executor;
use control::look_ahead::{RolloutError, RolloutModel, RolloutScene, SampledScene, StateSample};
use control::outcome_model::TryOutcome;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use scenarios::generator::trial_rng;
use sim::robot::HandPosture;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::objects::ObjectModel;

use crate::rollout::{in_grip, roll_out_to_carry};
use crate::simulated_world::{SimulatedWorld, tick};

/// Times for which the digits press on the fastened object, and in which it then settles, s.
const PRESS_AND_SETTLE_TIMES: (f64, f64) = (0.15, 0.25);
/// Height above its place at which the target waits meanwhile, m.
const WAITING_HEIGHT: f64 = 1.0;
/// Seed of the properties of the object instances in the draws. No benchmark trial draws from it.
const SEED: u64 = 0x7477_696e;

/// Builder of scenes from the controller's model of a world.
pub struct SceneModel {
    world: SimulatedWorld,
    board: TactileBoard,
}

impl SceneModel {
    /// Creates the model of a world. Nothing is drawn with `board`.
    pub fn new(world: SimulatedWorld, board: TactileBoard) -> Self {
        Self { world, board }
    }

    /// Returns the objects of draw `number`, which differ from their models in mass, friction and size within the
    /// variation of the world's objects. They are the same in every scene.
    fn objects(&self, models: [&Arc<ObjectModel>; 2], number: usize) -> Result<[Arc<ObjectModel>; 2]> {
        let Some(spread) = &self.world.scenario.effects.objects else { return Ok(models.map(Arc::clone)) };
        let mut rng = trial_rng(SEED, 0, number);
        let [first, second] = models.map(|model| spread.draw(&mut rng).apply_to(model));
        Ok([first?, second?])
    }

    /// Returns the robot of one draw, with the first object in its hand and the second one in its place. `None` if the
    /// first object is not held.
    fn hold(&self, scene: &RolloutScene, number: usize, draw: &StateSample) -> Result<Option<SimulatedRobot>> {
        let [first, second] = self.objects([&scene.objects[0], &scene.objects[1]], number)?;
        let (target, above) = standing_pose(&second, &draw.target);
        let mut executor = scene.executor.clone();
        executor.request_images_every(f64::INFINITY);
        let level = Translation3::from(Vector3::z() * above);
        let aside = Translation3::from(Vector3::z() * WAITING_HEIGHT);
        let objects = vec![
            ObjectPlacement { model: first, pose: level * executor.motion().palm() * draw.held },
            ObjectPlacement { model: second, pose: aside * target },
        ];
        let base = level * self.world.cell.world_from_base;
        let setup = SceneSetup {
            objects,
            cables: self.world.known_cable_losses(),
            gel: self.world.scenario.effects.gel,
            ..SceneSetup::ideal(base, executor.motion().arm().position)
        };
        let cell = &self.world.cell;
        let servos = executor.motion().servos().iter().map(|servo| servo.position).collect();
        let joints = cell.robot.hand.each_joint(|joint| scene.joints.get(joint).copied().unwrap_or(0.0));
        let posture = HandPosture { joints, servos };
        let mut robot = SimulatedRobot::in_posture(&cell.robot, &setup, &posture, self.board.clone());
        robot.fix_object(0);
        robot.fix_object(1);
        wait_for(&mut robot, &mut executor, PRESS_AND_SETTLE_TIMES.0)?;
        robot.release_object(0);
        wait_for(&mut robot, &mut executor, PRESS_AND_SETTLE_TIMES.1)?;
        if !in_grip(&robot.truth(), 0) {
            return Ok(None);
        }
        robot.set_object_pose(1, &target);
        robot.release_object(1);
        Ok(Some(robot))
    }
}

/// Holds of a scene, one per draw.
struct SampledHolds(Vec<Option<SimulatedRobot>>);

/// Returns the pose of an object that stands on the table and is estimated to be at `pose`, and how much higher it is
/// than estimated, m.
fn standing_pose(object: &ObjectModel, pose: &Isometry3<f64>) -> (Isometry3<f64>, f64) {
    let upright = |yaw: f64| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * object.rest;
    let rotation = object.resting_yaw(&pose.rotation).map_or(pose.rotation, upright);
    let height = -object.shape.lowest_height(&rotation);
    let at = pose.translation.vector;
    (Isometry3::from_parts(Translation3::new(at.x, at.y, height), rotation), height - at.z)
}

/// Lets `executor` wait for `time` s.
fn wait_for(robot: &mut SimulatedRobot, executor: &mut Executor, time: f64) -> Result<()> {
    for _ in 0..(time / robot.tick_length()).round() as usize {
        tick(robot, executor)?;
    }
    Ok(())
}

impl RolloutModel for SceneModel {
    fn prepare(&self, scene: &RolloutScene) -> Result<Box<dyn SampledScene>, RolloutError> {
        let hold = |(number, draw)| self.hold(scene, number, draw).context("the hold of the first object");
        let holds = scene
            .samples
            .par_iter()
            .enumerate()
            .map(hold)
            .collect::<Result<_>>()
            .map_err(|error| RolloutError(error.into()))?;
        Ok(Box::new(SampledHolds(holds)))
    }
}

impl SampledScene for SampledHolds {
    fn roll_out(&self, going: &Executor, draws: Range<usize>) -> Result<Vec<Option<TryOutcome>>, RolloutError> {
        let mut going = going.clone();
        going.request_images_every(f64::INFINITY);
        let one = |robot: &Option<SimulatedRobot>| {
            robot.as_ref().map(|robot| roll_out_to_carry(robot.clone(), going.clone())).transpose()
        };
        self.0[draws].par_iter().map(one).collect::<Result<_>>().map_err(|error| RolloutError(error.into()))
    }
}
