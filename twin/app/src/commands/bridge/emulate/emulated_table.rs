//! Table of an emulated robot in real time: the objects on it, and changes to them while it runs.

use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, bail};
use hand_model::RobotModel;
use nalgebra::Isometry3;
use scenarios::Scenario;
use scenarios::noise::TrialNoise;
use sim::{ObjectPlacement, SimulatedRobot};

use bench::builtin::{COMBINATION_COUNT, make_instance_bench};
use bench::trial::Bench;
use registration::{Registrar, RegistrationPlan, hidden_mount};
use robot_backends::wire_emulation::SharedPlant;

/// Requested objects on the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableCommand {
    /// The present objects, back at their places.
    ResetObjects,
    /// The objects of another combination.
    Combination(usize),
    /// The balls of the registration on their marks, fastened.
    Balls,
}

impl FromStr for TableCommand {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "back" => Ok(Self::ResetObjects),
            "balls" => Ok(Self::Balls),
            number => number
                .parse()
                .map(Self::Combination)
                .map_err(|_| format!("found `{text}`, expected back, balls or the number of a combination")),
        }
    }
}

/// The objects on the table, with the request that put them there.
struct PlacedObjects {
    command: TableCommand,
    names: Vec<String>,
    poses: Vec<Isometry3<f64>>,
    /// Number of times that the objects were replaced.
    version: u64,
}

/// The table of a running emulated robot.
#[derive(Clone)]
pub struct EmulatedTable {
    bench: Arc<Bench>,
    registration_plan: Arc<RegistrationPlan>,
    plant: SharedPlant,
    placed: Arc<Mutex<PlacedObjects>>,
}

impl EmulatedTable {
    /// Builds the table and robot `instance` (0 is the nominal robot), with the objects of `command`. If seed `mount` is
    /// given, the base stands at a hidden pose drawn from it.
    pub fn new(
        robot: &RobotModel,
        command: TableCommand,
        (mount, instance): (Option<u64>, u64),
        seed: u64,
    ) -> Result<Self> {
        let mut bench = make_instance_bench(instance, robot, Scenario::benchmark(), COMBINATION_COUNT, seed, true)?;
        let plan = RegistrationPlan::standard()?;
        if let Some(seed) = mount {
            bench.world.true_world_from_base = hidden_mount(&plan, seed);
        }
        let setup = bench.world.bare_scene(bench.world.cell.ready_posture, &TrialNoise::none());
        let robot = SimulatedRobot::new(&bench.world.cell.robot, &setup, bench.cameras.with_noise(0));
        let standing =
            PlacedObjects { command: TableCommand::ResetObjects, names: Vec::new(), poses: Vec::new(), version: 0 };
        let plant = SharedPlant::new(robot);
        let table = Self {
            bench: Arc::new(bench),
            registration_plan: Arc::new(plan),
            plant,
            placed: Arc::new(Mutex::new(standing)),
        };
        table.place_objects(command)?;
        Ok(table)
    }

    /// Returns the simulated robot at this table.
    pub fn plant(&self) -> &SharedPlant {
        &self.plant
    }

    /// Returns the data shared by all trials at this table.
    pub fn bench(&self) -> &Bench {
        &self.bench
    }

    /// Carries out `command` at once, regardless of the robot, and describes the objects now on the table.
    pub fn place_objects(&self, command: TableCommand) -> Result<String> {
        let mut standing = self.placed.lock().unwrap_or_else(PoisonError::into_inner);
        if command == TableCommand::ResetObjects || command == standing.command {
            let mut robot = self.plant.lock();
            standing.poses.iter().enumerate().for_each(|(object, place)| robot.set_object_pose(object, place));
            return Ok(format!("back in place: {}", standing.names.join(", ")));
        }
        let placements = self.placements(command)?;
        let mut robot = self.plant.lock();
        robot.replace_objects(&placements);
        if command == TableCommand::Balls {
            (0..placements.len()).for_each(|object| robot.fix_object(object));
        }
        standing.names = placements.iter().map(|placement| placement.model.name.clone()).collect();
        standing.poses = placements.iter().map(|placement| placement.pose).collect();
        standing.version += 1;
        standing.command = command;
        Ok(format!("on the table: {}", standing.names.join(", ")))
    }

    /// Returns the names of the objects on the table, and the number of times that they were replaced.
    pub fn placed_objects(&self) -> (Vec<String>, u64) {
        let standing = self.placed.lock().unwrap_or_else(PoisonError::into_inner);
        (standing.names.clone(), standing.version)
    }

    fn placements(&self, command: TableCommand) -> Result<Vec<ObjectPlacement>> {
        let world = &self.bench.world;
        let TableCommand::Combination(combination) = command else {
            return Ok(Registrar::new(world, &self.registration_plan, &self.bench.repertoire)?.placements());
        };
        let Some(plan) = self.bench.grasp_pairs.pairs.get(combination) else {
            bail!("combination: found {combination}, expected 0 to {}", self.bench.grasp_pairs.pairs.len() - 1);
        };
        let objects = world.models(&plan.objects())?;
        let places = world.object_poses(&objects, &TrialNoise::none());
        Ok(objects.into_iter().zip(places).map(|(model, pose)| ObjectPlacement { model, pose }).collect())
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    #[test]
    fn table_commands_are_read() {
        assert_eq!(
            ["back", "balls", "12"].map(|text| text.parse::<TableCommand>().expect("good")),
            [TableCommand::ResetObjects, TableCommand::Balls, TableCommand::Combination(12)]
        );
        assert!("-1".parse::<TableCommand>().expect_err("bad").contains("found `-1`, expected back, balls"));
    }

    /// Pushed objects return to their places. Another combination stands as its grasp pair prescribes. Balls do not
    /// move when pushed.
    #[test]
    fn objects_are_put_back_replaced_and_fastened() {
        let table =
            EmulatedTable::new(&RobotModel::ftac_gen3(), TableCommand::Combination(0), (None, 0), 1).expect("a table");
        let wait = |ticks: usize| {
            for _ in 0..ticks {
                table.plant().lock().wait_for_tick();
            }
        };
        wait(30);
        let before = table.plant().lock().truth().objects;
        table.plant().lock().add_velocity(0, &nalgebra::Vector3::new(0.8, 0.0, 0.0));
        wait(60);
        let off = |one: &[Isometry3<f64>], other: &[Isometry3<f64>]| {
            (one[0].translation.vector - other[0].translation.vector).norm()
        };
        assert!(off(&table.plant().lock().truth().objects, &before) > 0.02);
        assert!(table.place_objects(TableCommand::ResetObjects).expect("done").starts_with("back in place"));
        wait(30);
        assert!(off(&table.plant().lock().truth().objects, &before) < 0.003);

        let (names, version) = table.placed_objects();
        assert!(table.place_objects(TableCommand::Combination(7)).expect("done").starts_with("on the table"));
        wait(30);
        let (others, newer) = table.placed_objects();
        assert!(names != others && newer > version && others.len() == 2, "{names:?} {others:?}");
        assert_eq!(table.plant().lock().truth().on_table, [true, true]);

        table.place_objects(TableCommand::Balls).expect("done");
        let before = table.plant().lock().truth().objects;
        table.plant().lock().add_velocity(0, &nalgebra::Vector3::new(0.8, 0.0, 0.0));
        wait(60);
        let after = table.plant().lock().truth().objects;
        assert_eq!((after.len(), off(&after, &before)), (3, 0.0));
        assert!(
            table
                .place_objects(TableCommand::Combination(60))
                .expect_err("none")
                .to_string()
                .contains("expected 0 to 59")
        );
    }
}
