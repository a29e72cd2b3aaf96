//! The place of a transport: balls on the table, the robot over them, and what is truly in its hand.

use std::sync::Arc;

use anyhow::Result;
use control::carrier::{Carrier, CarryPhase};
use control::motion::Protocol;
use nalgebra::Isometry3;
use proving::simulated_world::World;
use scenarios::noise::TrialNoise;
use sim::robot::{SimulatedRobot, Truth};
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup};
use world::holding::{Support, TRANSPORTED};
use world::objects::ObjectModel;

/// Body and controller together; a clone is a branch.
#[derive(Clone)]
pub struct Branch {
    /// The body.
    pub robot: SimulatedRobot,
    /// The controller.
    pub carrier: Carrier,
}

impl Branch {
    /// The hand empty over balls that stand at their places, arm and perception off by `noise`'s execution error.
    pub fn begin(
        world: &World,
        protocol: Protocol,
        balls: &[(Arc<ObjectModel>, Isometry3<f64>)],
        noise: &TrialNoise,
        board: TactileBoard,
    ) -> Result<Self> {
        let scene = SceneSetup {
            objects: balls.iter().map(|(model, pose)| ObjectPlacement { model: model.clone(), pose: *pose }).collect(),
            ..world.bare_scene(world.cell.ready, noise)
        };
        let robot = SimulatedRobot::new(&world.cell.robot, &scene, board);
        let tick = robot.tick_length();
        Ok(Self {
            robot,
            carrier: Carrier::new(
                world.cell.robot.hand.clone(),
                world.cell.arm_servo(world.cell.ready)?,
                protocol,
                tick,
            )?,
        })
    }

    /// Plays on until the carrier waits for a decision, or until `watch`, which sees every tick, says `false`: whether it came
    /// to the decision.
    pub fn play(&mut self, mut watch: impl FnMut(&mut SimulatedRobot, &Carrier) -> Result<bool>) -> Result<bool> {
        loop {
            let observation = self.robot.observe();
            let command = self.carrier.tick(&observation)?;
            self.robot.send(&command);
            self.robot.wait_for_tick();
            if !watch(&mut self.robot, &self.carrier)? {
                return Ok(false);
            }
            if self.carrier.phase() == CarryPhase::Decide {
                return Ok(true);
            }
        }
    }
}

/// Whether ball `index` is in the hand, or held up by another that is.
pub fn in_hand(truth: &Truth, index: usize) -> bool {
    let ball = truth.support(index);
    let leaning = truth.object_pairs.iter().any(|pair| pair.0 == index || pair.1 == index);
    TRANSPORTED.holds(&Support { held: ball.held || leaning, ..ball })
}
