//! Definition of a scenario, as trials use it.

use std::path::Path;

use ftac_platform::data::DataError;
use serde::{Deserialize, Serialize};

use crate::disturbance::Disturbances;
use crate::effects::Effects;
use crate::noise::NoiseLevels;
use crate::referee::RefereeRules;
use world::layout::Layout;
use world::objects::{ObjectFile, ObjectSet};

/// Version of scenario files that this crate reads.
pub const VERSION: u32 = 1;

/// Heights, distances and times of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialProtocol {
    /// Height by which an object is lifted, m.
    pub lift_height: f64,
    /// Distance over which the held objects are carried, m.
    pub carry_distance: f64,
    /// Duration of the hold at the end, s.
    pub hold_time: f64,
    /// Time limit of a trial, s.
    pub time_limit: f64,
}

/// Start pose of the hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartPose {
    /// Position of the palm in the world frame, m. The palm points away from the arm, level unless the robot's file
    /// pitches it.
    pub palm: [f64; 3],
}

/// A benchmark: objects, layout, noise, protocol, rules, disturbances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scenario {
    /// Version of the file format, [`VERSION`].
    pub version: u32,
    /// Name for people.
    pub name: String,
    /// The user's objects.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub object: Vec<ObjectFile>,
    /// Names of the objects that may come first.
    pub first: Vec<String>,
    /// Names of the objects that may come second; empty in a trial of one object.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub second: Vec<String>,
    /// Names of the objects that may come third; empty in a trial of two.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub third: Vec<String>,
    /// Nominal poses of the objects on the table.
    pub layout: Layout,
    /// Standard deviations of execution and perception errors.
    pub noise: NoiseLevels,
    /// Start pose of the hand.
    pub start: StartPose,
    /// Heights, distances and times.
    pub protocol: TrialProtocol,
    /// Thresholds of the referee.
    pub referee: RefereeRules,
    /// Effects of a real robot and table that an ideal one does not have.
    pub effects: Effects,
    /// Disturbances beside the noise.
    pub disturbance: Disturbances,
    /// Effort level of the search for second grasps of pairs without a plan. At levels above 0, they are searched for
    /// and verified in randomly drawn conditions. At 0, they are planned and tested under aiming errors alone.
    #[serde(skip_serializing_if = "is_zero")]
    pub effort: u32,
}

fn is_zero(level: &u32) -> bool {
    *level == 0
}

impl Scenario {
    /// Returns the built-in objects and the user's. Errors name the scenario, because its file is unknown here.
    pub fn object_set(&self) -> Result<ObjectSet, DataError> {
        self.object_set_at(Path::new(&self.name))
    }

    /// Like [`Self::object_set`]; `path` is named in errors.
    pub(super) fn object_set_at(&self, path: &Path) -> Result<ObjectSet, DataError> {
        let mut set = ObjectSet::standard();
        for object in &self.object {
            if set.get(&object.name).is_some() {
                let found = format!("{:?}", object.name);
                return Err(DataError::field(path, "object.name", found, "a name that no other object has"));
            }
            set.insert(object.model(path).map_err(|error| error.within(&format!("object[{}]", object.name)))?);
        }
        Ok(set)
    }

    /// Returns the lists of objects with their field names, in picking order: one to three, of which a combination
    /// takes one name each.
    pub fn object_lists(&self) -> Vec<(&'static str, &[String])> {
        let all = [("first", &self.first[..]), ("second", &self.second[..]), ("third", &self.third[..])];
        all.into_iter()
            .enumerate()
            .filter(|(n, (_, names))| *n == 0 || !names.is_empty())
            .map(|(_, list)| list)
            .collect()
    }

    /// Returns the names of all objects of all lists, each once, in alphabetical order.
    pub fn object_names(&self) -> Vec<String> {
        let names: std::collections::BTreeSet<&String> =
            self.object_lists().into_iter().flat_map(|(_, names)| names).collect();
        names.into_iter().cloned().collect()
    }

    /// True if the scenario has neither noise nor effects: an ideal robot at an ideal table, with nothing drawn at
    /// random.
    pub fn is_ideal(&self) -> bool {
        self.noise == self.noise.scaled(0.0) && self.effects == Effects::default()
    }

    /// Returns the number of different combinations.
    pub fn combination_count(&self) -> usize {
        self.object_lists().into_iter().map(|(_, names)| names.len()).product()
    }
}
