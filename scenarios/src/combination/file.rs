//! What a scenario file may leave out: with `extends = "benchmark"`, everything that it does not say is as in the benchmark.

use std::path::Path;

use serde::Deserialize;

use super::{BENCHMARK, Layout, Protocol, Scenario, ScenarioError};
use crate::disturbance::Disturbances;
use crate::noise::NoiseLevels;
use crate::referee::RefereeRules;

/// Scenarios that a file can extend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Base {
    Benchmark,
}

/// A scenario as its file has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ScenarioFile {
    version: u32,
    name: String,
    extends: Option<Base>,
    first: Option<Vec<String>>,
    second: Option<Vec<String>>,
    layout: Option<Layout>,
    noise: Option<NoiseLevels>,
    protocol: Option<Protocol>,
    referee: Option<RefereeRules>,
    #[serde(default)]
    disturbance: Disturbances,
}

impl ScenarioFile {
    /// The scenario, with what is missing taken from the one that it extends; `path` is used in errors.
    pub(super) fn complete(self, path: &Path) -> Result<Scenario, ScenarioError> {
        let base = match self.extends {
            Some(Base::Benchmark) => Some(Scenario::parse(BENCHMARK, Path::new("benchmark.toml"))?),
            None => None,
        };
        let base = base.as_ref();
        Ok(Scenario {
            version: self.version,
            name: self.name,
            first: given("first", self.first, base.map(|base| &base.first), path)?,
            second: given("second", self.second, base.map(|base| &base.second), path)?,
            layout: given("layout", self.layout, base.map(|base| &base.layout), path)?,
            noise: given("noise", self.noise, base.map(|base| &base.noise), path)?,
            protocol: given("protocol", self.protocol, base.map(|base| &base.protocol), path)?,
            referee: given("referee", self.referee, base.map(|base| &base.referee), path)?,
            disturbance: self.disturbance,
        })
    }
}

fn given<T: Clone>(field: &str, value: Option<T>, base: Option<&T>, path: &Path) -> Result<T, ScenarioError> {
    value.or_else(|| base.cloned()).ok_or_else(|| ScenarioError::Field {
        path: path.into(),
        field: field.into(),
        found: "nothing".into(),
        expected: format!("a value, or extends = \"benchmark\" to take the benchmark's {field}"),
    })
}
