//! Reading of scenario files.
//!
//! With `extends = "benchmark"`, fields that a file omits are as in the benchmark. Without it, a file must state all
//! fields but the user's objects, the start pose, the effects and the disturbances; omitted effects are then off.

use std::path::{Path, PathBuf};

use ftac_platform::data::{DataError, parse_toml, read_text};
use ftac_platform::file_access::FileAccess;
use serde::Deserialize;
use toml::{Table, Value};

use super::definition::{Scenario, StartPose, TrialProtocol};
use crate::disturbance::Disturbances;
use crate::effects::{Effect, Effects};
use crate::noise::NoiseLevels;
use crate::referee::RefereeRules;
use world::layout::Layout;
use world::objects::{ObjectFile, ObjectSet};

/// Text of the built-in benchmark, which is also its documentation.
pub const BENCHMARK_TOML: &str = include_str!("../../data/benchmark.toml");

/// Base scenarios that a file can extend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum BaseScenario {
    Benchmark,
}

/// Contents of a scenario file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScenarioFile {
    version: u32,
    name: String,
    /// Base scenario; already merged in.
    #[serde(rename = "extends")]
    _extends: Option<BaseScenario>,
    /// Paths of files with the user's objects, relative to this file.
    #[serde(default)]
    objects: Vec<PathBuf>,
    /// The user's objects, given in the file itself.
    #[serde(default)]
    object: Vec<ObjectFile>,
    first: Option<Vec<String>>,
    #[serde(default)]
    second: Vec<String>,
    #[serde(default)]
    third: Vec<String>,
    layout: Option<Layout>,
    noise: Option<NoiseLevels>,
    start: Option<StartPose>,
    protocol: Option<TrialProtocol>,
    referee: Option<RefereeRules>,
    /// Effects; all off if the file omits them.
    effects: Option<Effects>,
    /// Effects of the extended scenario that are off.
    #[serde(default)]
    without: Vec<Effect>,
    #[serde(default)]
    disturbance: Disturbances,
    #[serde(default)]
    effort: u32,
}

/// Fields inherited from the benchmark. Of a table, the extending file may state some fields only, at any depth.
const INHERITED_FIELDS: [&str; 8] = ["first", "second", "layout", "noise", "start", "protocol", "referee", "effects"];

/// Adds to `own` the fields that only `base` has.
fn merge(own: &mut Table, base: &Table) {
    for (key, value) in base {
        match (own.get_mut(key), value) {
            (None, _) => {
                own.insert(key.clone(), value.clone());
            }
            (Some(Value::Table(own)), Value::Table(base)) => merge(own, base),
            _ => {}
        }
    }
}

impl ScenarioFile {
    /// Parses the file and merges in the fields that it inherits.
    fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let mut own: Table = parse_toml(text, path)?;
        if !own.contains_key("extends") {
            return parse_toml(text, path);
        }
        let mut base: Table = parse_toml(BENCHMARK_TOML, Path::new("benchmark.toml"))?;
        base.retain(|key, _| INHERITED_FIELDS.contains(&key));
        merge(&mut own, &base);
        // The merged text is parsed like any other: another deserialiser for all these types would take long to compile.
        match parse_toml(&own.to_string(), path) {
            Err(DataError::Syntax { message, .. }) => match parse_toml::<Self>(text, path) {
                // Parsing the text itself gives an error with its line, unless a field is missing that the benchmark has.
                Err(at_line) if !at_line.to_string().contains("missing field") => Err(at_line),
                _ => Err(DataError::field(path, "scenario", message, "fields as in benchmark.toml")),
            },
            parsed => parsed,
        }
    }

    /// Builds the scenario, with the object files that are within `reach`; `path` is named in errors.
    fn into_scenario(mut self, path: &Path, reach: FileAccess) -> Result<Scenario, DataError> {
        // Recordings without a start pose began at that of the benchmark.
        let start = self.start.map_or_else(|| built_in().map(|base| base.start), Ok)?;
        for (n, file) in self.objects.iter().enumerate() {
            let file = reach.resolve(path, &format!("objects[{n}]"), file)?;
            let object = ObjectFile::read(&file, reach)?;
            // Checked here, where an error can still name the object's file.
            object.model(&file)?;
            self.object.push(object);
        }
        let names = |given: Vec<String>| -> Vec<String> {
            let own = |name: &String| self.object.iter().any(|object| object.name == *name);
            given.into_iter().map(|name| if own(&name) { name } else { built_in_name(name) }).collect()
        };
        let first = names(required("first", self.first, path)?);
        let [second, third] = [self.second, self.third].map(names);
        Ok(Scenario {
            version: self.version,
            name: self.name,
            object: self.object,
            first,
            second,
            third,
            layout: required("layout", self.layout, path)?,
            noise: required("noise", self.noise, path)?,
            start,
            protocol: required("protocol", self.protocol, path)?,
            referee: required("referee", self.referee, path)?,
            effects: self
                .without
                .iter()
                .fold(self.effects.unwrap_or_default(), |effects, effect| effects.without(*effect)),
            disturbance: self.disturbance,
            effort: self.effort,
        })
    }
}

/// Returns the name of a built-in object as files write it: `salt_mill` for `salt mill`. Other names are returned
/// unchanged.
fn built_in_name(name: String) -> String {
    if !name.contains([' ', '-']) {
        return name;
    }
    let set = ObjectSet::standard();
    let written = name.replace([' ', '-'], "_");
    if set.get(&name).is_none() && set.get(&written).is_some() { written } else { name }
}

fn built_in() -> Result<Scenario, DataError> {
    Scenario::parse(BENCHMARK_TOML, Path::new("benchmark.toml"))
}

fn required<T>(field: &str, value: Option<T>, path: &Path) -> Result<T, DataError> {
    value.ok_or_else(|| {
        let expected = format!("a value, or extends = \"benchmark\" to take the benchmark's {field}");
        DataError::field(path, field, "nothing", expected)
    })
}

impl Scenario {
    /// Returns the built-in benchmark, `scenarios/data/benchmark.toml`.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn benchmark() -> Self {
        built_in().expect("the built-in scenario is valid")
    }

    /// Reads and checks the text of a scenario that refers to no other files, as sessions and results store it. `path`
    /// is named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        Self::parse_within(text, path, FileAccess::Nothing)
    }

    /// Like [`Self::parse`], for a text that may refer to object files within `reach`, relative to `path`.
    pub fn parse_within(text: &str, path: &Path, reach: FileAccess) -> Result<Self, DataError> {
        let file = ScenarioFile::parse(text, path)?;
        let scenario = file.into_scenario(path, reach)?;
        scenario.check(path)?;
        Ok(scenario)
    }

    /// Reads and checks a scenario file. Its object files must be below its folder.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        Self::parse_within(&read_text(path)?, path, FileAccess::in_folder_of(path))
    }

    /// Returns a text of the same scenario that needs no other file: `text` itself or, if it refers to object files, a
    /// text that contains these and their meshes. A run stores this text, so that it can be continued or replayed
    /// elsewhere.
    pub fn self_contained(text: &str, path: &Path, reach: FileAccess) -> Result<String, DataError> {
        let scenario = Self::parse_within(text, path, reach)?;
        if scenario.object.is_empty() {
            return Ok(text.to_owned());
        }
        toml::to_string(&scenario).map_err(|error| DataError::field(path, "objects", error, "what TOML can hold"))
    }
}
