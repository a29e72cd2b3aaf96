//! Table of an emulated robot in real time: the objects on it, and changes to them while it runs.

use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, bail};
use hand_model::RobotModel;
use nalgebra::Isometry3;
use scenarios::Scenario;
use scenarios::noise::TrialNoise;
use sim::{ObjectPlacement, SimulatedRobot};

use bench::builtin::{COMBINATIONS, make_individual};
use bench::trial::Bench;
use registration::{Plan, Registrar, hidden_mount};
use robot_backends::emulated::SharedPlant;

/// Requested objects on the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// The present objects, back at their places.
    Back,
    /// The objects of another combination.
    Combination(usize),
    /// The balls of the registration on their marks, fastened.
    Balls,
}

impl FromStr for Wish {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "back" => Ok(Self::Back),
            "balls" => Ok(Self::Balls),
            number => number
                .parse()
                .map(Self::Combination)
                .map_err(|_| format!("found `{text}`, expected back, balls or the number of a combination")),
        }
    }
}

/// The objects on the table, with the request that put them there.
struct Standing {
    wish: Wish,
    names: Vec<String>,
    places: Vec<Isometry3<f64>>,
    /// Number of times that the objects were replaced.
    version: u64,
}

/// The table of a running emulated robot.
#[derive(Clone)]
pub struct EmulatedTable {
    bench: Arc<Bench>,
    plan: Arc<Plan>,
    plant: SharedPlant,
    standing: Arc<Mutex<Standing>>,
}

impl EmulatedTable {
    /// Builds the table and robot `individual` (0 is the nominal robot), with the objects of `wish`. If seed `mount` is
    /// given, the base stands at a hidden pose drawn from it.
    pub fn new(robot: &RobotModel, wish: Wish, (mount, individual): (Option<u64>, u64), seed: u64) -> Result<Self> {
        let mut bench = make_individual(individual, robot, Scenario::benchmark(), COMBINATIONS, seed, true)?;
        let plan = Plan::standard()?;
        if let Some(seed) = mount {
            bench.world.stands = hidden_mount(&plan, seed);
        }
        let setup = bench.world.bare_scene(bench.world.cell.ready, &TrialNoise::none());
        let robot = SimulatedRobot::new(&bench.world.cell.robot, &setup, bench.board.with_noise(0));
        let standing = Standing { wish: Wish::Back, names: Vec::new(), places: Vec::new(), version: 0 };
        let plant = SharedPlant::new(robot);
        let table =
            Self { bench: Arc::new(bench), plan: Arc::new(plan), plant, standing: Arc::new(Mutex::new(standing)) };
        table.set(wish)?;
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

    /// Carries out `wish` at once, whatever the robot does, and describes the objects now on the table.
    pub fn set(&self, wish: Wish) -> Result<String> {
        let mut standing = self.standing.lock().unwrap_or_else(PoisonError::into_inner);
        if wish == Wish::Back || wish == standing.wish {
            let mut robot = self.plant.lock();
            standing.places.iter().enumerate().for_each(|(object, place)| robot.put(object, place));
            return Ok(format!("back in place: {}", standing.names.join(", ")));
        }
        let placements = self.placements(wish)?;
        let mut robot = self.plant.lock();
        robot.replace_objects(&placements);
        if wish == Wish::Balls {
            (0..placements.len()).for_each(|object| robot.fasten(object));
        }
        standing.names = placements.iter().map(|placement| placement.model.name.clone()).collect();
        standing.places = placements.iter().map(|placement| placement.pose).collect();
        standing.version += 1;
        standing.wish = wish;
        Ok(format!("on the table: {}", standing.names.join(", ")))
    }

    /// Returns the names of the objects on the table, and the number of times that they were replaced.
    pub fn standing(&self) -> (Vec<String>, u64) {
        let standing = self.standing.lock().unwrap_or_else(PoisonError::into_inner);
        (standing.names.clone(), standing.version)
    }

    fn placements(&self, wish: Wish) -> Result<Vec<ObjectPlacement>> {
        let world = &self.bench.world;
        let Wish::Combination(combination) = wish else {
            return Ok(Registrar::new(world, &self.plan, &self.bench.repertoire)?.placements());
        };
        let Some(plan) = self.bench.plans.plans.get(combination) else {
            bail!("combination: found {combination}, expected 0 to {}", self.bench.plans.plans.len() - 1);
        };
        let objects = world.models(&plan.objects())?;
        let places = world.places(&objects, &TrialNoise::none());
        Ok(objects.into_iter().zip(places).map(|(model, pose)| ObjectPlacement { model, pose }).collect())
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    #[test]
    fn wishes_are_read() {
        assert_eq!(
            ["back", "balls", "12"].map(|text| text.parse::<Wish>().expect("good")),
            [Wish::Back, Wish::Balls, Wish::Combination(12)]
        );
        assert!("-1".parse::<Wish>().expect_err("bad").contains("found `-1`, expected back, balls"));
    }

    /// Pushed objects return to their places. Another combination stands where its plan has it. Balls do not move when
    /// pushed.
    #[test]
    fn objects_are_put_back_replaced_and_fastened() {
        let table = EmulatedTable::new(&RobotModel::ftac_gen3(), Wish::Combination(0), (None, 0), 1).expect("a table");
        let wait = |ticks: usize| {
            for _ in 0..ticks {
                table.plant().lock().wait_for_tick();
            }
        };
        wait(30);
        let before = table.plant().lock().truth().objects;
        table.plant().lock().push(0, &nalgebra::Vector3::new(0.8, 0.0, 0.0));
        wait(60);
        let off = |one: &[Isometry3<f64>], other: &[Isometry3<f64>]| {
            (one[0].translation.vector - other[0].translation.vector).norm()
        };
        assert!(off(&table.plant().lock().truth().objects, &before) > 0.02);
        assert!(table.set(Wish::Back).expect("done").starts_with("back in place"));
        wait(30);
        assert!(off(&table.plant().lock().truth().objects, &before) < 0.003);

        let (names, version) = table.standing();
        assert!(table.set(Wish::Combination(7)).expect("done").starts_with("on the table"));
        wait(30);
        let (others, newer) = table.standing();
        assert!(names != others && newer > version && others.len() == 2, "{names:?} {others:?}");
        assert_eq!(table.plant().lock().truth().on_table, [true, true]);

        table.set(Wish::Balls).expect("done");
        let before = table.plant().lock().truth().objects;
        table.plant().lock().push(0, &nalgebra::Vector3::new(0.8, 0.0, 0.0));
        wait(60);
        let after = table.plant().lock().truth().objects;
        assert_eq!((after.len(), off(&after, &before)), (3, 0.0));
        assert!(table.set(Wish::Combination(60)).expect_err("none").to_string().contains("expected 0 to 59"));
    }
}
