//! A scenario as trials use it.

use std::path::Path;

use platform::data::DataError;
use serde::{Deserialize, Serialize};

use crate::disturbance::Disturbances;
use crate::effects::Effects;
use crate::noise::NoiseLevels;
use crate::referee::RefereeRules;
use world::layout::Layout;
use world::objects::{ObjectFile, ObjectSet};

/// The version of scenario files this crate reads.
pub const VERSION: u32 = 1;

/// Heights, distances and times of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protocol {
    /// How far an object is lifted, m.
    pub lift_height: f64,
    /// How far both are carried, m.
    pub carry_distance: f64,
    /// How long both are held at the end, s.
    pub hold_time: f64,
    /// How long a trial may take, s.
    pub time_limit: f64,
}

/// Where the hand is when a trial begins.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// The palm, m, world; it points away from the arm, level unless the robot's file pitches it.
    pub palm: [f64; 3],
}

/// A benchmark: objects, layout, noise, protocol, rules, disturbances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scenario {
    /// [`VERSION`].
    pub version: u32,
    /// For people.
    pub name: String,
    /// The user's own objects.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub object: Vec<ObjectFile>,
    /// Objects that may come first.
    pub first: Vec<String>,
    /// Objects that may come second; none in a trial of one object.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub second: Vec<String>,
    /// Objects that may come third; none in a trial of two.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub third: Vec<String>,
    /// Where they stand.
    pub layout: Layout,
    /// What goes wrong.
    pub noise: NoiseLevels,
    /// Where the hand is when a trial begins.
    pub start: Start,
    /// Heights, distances and times.
    pub protocol: Protocol,
    /// How it is judged.
    pub referee: RefereeRules,
    /// What reality adds to an ideal robot.
    pub effects: Effects,
    /// What happens beside noise.
    pub disturbance: Disturbances,
    /// Level of the effort with which second grasps of pairs that come without a plan are searched for and proven in drawn circumstances; 0: they are
    /// planned and tried under errors of their aim alone.
    #[serde(skip_serializing_if = "is_zero")]
    pub effort: u32,
}

fn is_zero(level: &u32) -> bool {
    *level == 0
}

impl Scenario {
    /// The built-in objects and the scenario's own. An error names the scenario where its file is not known.
    pub fn object_set(&self) -> Result<ObjectSet, DataError> {
        self.object_set_at(Path::new(&self.name))
    }

    /// The same; `path` is used in errors.
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

    /// The fields that list the objects of a trial, in the order in which they are taken: one to three, of which a combination takes one name each.
    pub fn lists(&self) -> Vec<(&'static str, &[String])> {
        let all = [("first", &self.first[..]), ("second", &self.second[..]), ("third", &self.third[..])];
        all.into_iter()
            .enumerate()
            .filter(|(n, (_, names))| *n == 0 || !names.is_empty())
            .map(|(_, list)| list)
            .collect()
    }

    /// Names of all objects of all lists, each once, in alphabetical order.
    pub fn objects(&self) -> Vec<String> {
        let names: std::collections::BTreeSet<&String> =
            self.lists().into_iter().flat_map(|(_, names)| names).collect();
        names.into_iter().cloned().collect()
    }

    /// Whether nothing is drawn and nothing differs from an ideal robot at an ideal table: no noise and no effects.
    pub fn is_exact(&self) -> bool {
        self.noise == self.noise.scaled(0.0) && self.effects == Effects::default()
    }

    /// How many different combinations there are.
    pub fn combinations(&self) -> usize {
        self.lists().into_iter().map(|(_, names)| names.len()).product()
    }
}
