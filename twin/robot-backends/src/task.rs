//! What a trial is, and how its robot knows where things are.

use anyhow::Result;
use hand_model::RobotSources;
use proving::simulated_world::World;
use scenarios::record::Condition;
use serde::{Deserialize, Serialize};

use super::mount::{Plan, hidden_mount};
use super::pose;

/// What a trial is, as a session's file keeps it: enough to set the control stack up again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// Body: `sim`, `emulated` or `hardware`.
    pub robot: String,
    /// Seed of everything.
    pub seed: u64,
    /// Number of the combination.
    pub combination: usize,
    /// Number of the trial.
    pub trial: usize,
    pub condition: Condition,
    /// Whether images were taken throughout for a watcher: commands ask for them.
    pub watched: bool,
    /// Combinations that were drawn.
    pub combos: usize,
    /// The scenario's text.
    pub scenario: String,
    /// The robot's files, where it is not the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_model: Option<RobotSources>,
    /// Text of the file of the robot that body and control stack are, where they are not the drawing's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub individual: Option<String>,
    /// Text of the file of the calibration by which touch reads images, where it is not the one that comes with the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pads: Option<String>,
    /// Whether second grasps were played in a twin of the scene before one was chosen.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub foresees: bool,
    /// Whether a mirror looked on: of a real robot images were taken more often for it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mirrored: bool,
    /// How the robot knows where things are.
    #[serde(flatten)]
    pub places: Places,
}

impl Task {
    /// A trial of the built-in robot as it is drawn, in no scenario yet, with so many combinations drawn.
    pub fn new(robot: &str, seed: u64, [combination, trial, combos]: [usize; 3], condition: Condition) -> Self {
        Self {
            robot: robot.to_owned(),
            seed,
            combination,
            trial,
            condition,
            watched: false,
            combos,
            scenario: String::new(),
            robot_model: None,
            individual: None,
            pads: None,
            foresees: false,
            mirrored: false,
            places: Places::default(),
        }
    }

    /// A seed for what is drawn beside the trial's own errors: another one in every trial.
    pub fn unit_seed(&self) -> u64 {
        self.seed.wrapping_mul(1_000_003).wrapping_add((self.combination * 1009 + self.trial) as u64)
    }
}

/// How a robot knows where things are beside its scenario.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Places {
    /// Where the arm's base was registered, `world_from_base` as x, y, z, i, j, k, w; where it nominally stands without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<[f64; 7]>,
    /// Whether the first looks at the objects come from the body's own eyes too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub eyes: bool,
    /// Where an emulated robot's base is hidden: the seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<u64>,
}

impl Places {
    /// Lets the controller of `world` know where its base was registered, and puts a simulated base where it is hidden.
    pub fn set_up(&self, world: &mut World) -> Result<()> {
        if let Some(base) = &self.base {
            world.cell.world_from_base = pose(base);
        }
        if let Some(seed) = self.mount {
            world.stands = hidden_mount(&Plan::standard()?, seed);
        }
        Ok(())
    }
}
