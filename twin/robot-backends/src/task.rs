//! Definition of a trial, and the source of its robot's object and base poses.

use anyhow::Result;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::RobotSources;
use scenarios::record::Condition;
use serde::{Deserialize, Serialize};

use super::driver::RobotDriver;
use super::pose_from_numbers;
use super::registration_plan::{RegistrationPlan, hidden_mount};

/// Name of the backend with real devices behind the hardware bridge.
pub const HARDWARE_BACKEND: &str = "hardware";
/// Name of the backend with a robot behind a driver of its owner.
pub const DRIVER_BACKEND: &str = "python";
/// Name of the backend with a robot on ROS 2 topics.
pub const ROS2_BACKEND: &str = "ros2";

/// True if time passes on the wall clock on the backend `robot`, with this driver if it has one: its trials cannot be
/// repeated, and they need an operator.
pub fn keeps_wall_time(robot: &str, driver: Option<&RobotDriver>) -> bool {
    robot == HARDWARE_BACKEND || robot == ROS2_BACKEND || driver.is_some_and(|driver| !driver.lockstep)
}

/// Definition of a trial as stored in a session file: enough to set the control stack up again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialTask {
    /// Robot backend: `sim`, `direct`, `emulated`, `hardware`, `ros2` or `python`.
    pub robot: String,
    /// Driver of the robot, on the backend `python`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<RobotDriver>,
    /// Seed of all random draws.
    pub seed: u64,
    /// Number of the combination.
    pub combination: usize,
    /// Number of the trial.
    pub trial: usize,
    pub condition: Condition,
    /// True if images were taken throughout for a watcher: commands request them.
    #[serde(alias = "watched")]
    pub images_throughout: bool,
    /// Number of combinations that were drawn.
    pub combos: usize,
    /// Text of the scenario.
    pub scenario: String,
    /// The robot's files, if it is not the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_model: Option<RobotSources>,
    /// Text of the file of an identified robot, used by backend and control stack; none for the nominal model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "individual")]
    pub instance: Option<String>,
    /// Text of the file with the photometric calibration of the pads; none for the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pads: Option<String>,
    /// True if second grasps were simulated (rollouts) before one was chosen.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[serde(alias = "foresees")]
    pub looks_ahead: bool,
    /// True if fault detection ran. On a real robot images were then taken more often.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[serde(alias = "mirrored")]
    pub detects_faults: bool,
    /// Source of the object and base poses.
    #[serde(flatten)]
    pub places: PoseSources,
}

impl TrialTask {
    /// Creates a trial of the nominal built-in robot, without a scenario, with this many combinations drawn.
    pub fn new(robot: &str, seed: u64, [combination, trial, combos]: [usize; 3], condition: Condition) -> Self {
        Self {
            robot: robot.to_owned(),
            driver: None,
            seed,
            combination,
            trial,
            condition,
            images_throughout: false,
            combos,
            scenario: String::new(),
            robot_model: None,
            instance: None,
            pads: None,
            looks_ahead: false,
            detects_faults: false,
            places: PoseSources::default(),
        }
    }

    /// True if the objects are where an operator or the robot's driver has put them: the draw of poses and errors does
    /// not apply.
    pub fn is_real(&self) -> bool {
        self.robot == HARDWARE_BACKEND || self.robot == ROS2_BACKEND || self.driver.is_some()
    }

    /// True if the backend's time passes on the wall clock.
    pub fn keeps_wall_time(&self) -> bool {
        keeps_wall_time(&self.robot, self.driver.as_ref())
    }

    /// Returns a seed for draws other than the trial's own errors. It differs from trial to trial.
    pub fn unit_seed(&self) -> u64 {
        self.seed.wrapping_mul(1_000_003).wrapping_add((self.combination * 1009 + self.trial) as u64)
    }
}

/// Source of the base and object poses, apart from the scenario.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseSources {
    /// Registered pose of the arm's base, `world_from_base` as x, y, z, i, j, k, w; none for the nominal pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<[f64; 7]>,
    /// True if the first detections, too, come from the backend's own object detector.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[serde(alias = "eyes")]
    pub detector: bool,
    /// Seed of the hidden base pose of an emulated robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<u64>,
}

impl PoseSources {
    /// Gives the controller of `world` the registered base pose, and moves a simulated base to its hidden pose.
    pub fn apply_to(&self, world: &mut SimulatedWorld) -> Result<()> {
        if let Some(base) = &self.base {
            world.cell.world_from_base = pose_from_numbers(base);
        }
        if let Some(seed) = self.mount {
            world.true_world_from_base = hidden_mount(&RegistrationPlan::standard()?, seed);
        }
        Ok(())
    }
}
