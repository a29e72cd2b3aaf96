//! Axes of a sweep: the fields of a run, and any field of its scenario.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use bench::journal::RunRequest;
use control::uncertainty::Uncertainty;
use ftac_platform::data::{DataError, read_text};
use ftac_platform::file_access::FileAccess;
use hand_model::{RobotModel, RobotSources};
use scenarios::effects::Effect;
use scenarios::{Ablation, Condition, Scenario};
use toml::{Table, Value};

use crate::near::nearest_names;

/// Names of the axes that do not vary a field of the scenario.
const FIELD_NAMES: [&str; 9] =
    ["seed", "policy", "ablation", "robot", "robot_model", "scenario", "noise_scale", "without", "uncertainty"];
/// Prefix of the name of an axis over a field of the scenario.
const SCENARIO_PREFIX: &str = "scenario.";
/// Robot backends on which a sweep can be run: those that need no operator.
const ROBOT_BACKENDS: [&str; 3] = ["sim", "emulated", "direct"];

/// Name of the built-in robot.
const BUILTIN_ROBOT: &str = "builtin";

/// Quantity that an axis varies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AxisField {
    Seed,
    /// Conditions of a trial: they are run with the same errors and are compared trial by trial.
    Policy,
    /// Ablations: the policy `touch` without one of its capabilities, on the same trials.
    Ablation,
    Robot,
    /// Robot files.
    RobotModel,
    /// Scenario files.
    Scenario,
    /// Factor of the scenario's noise.
    NoiseScale,
    /// Effects that are switched off, as in `bench --without`.
    Without,
    /// Files with the errors that the controller expects.
    Uncertainty,
    /// A field of the scenario: its dotted path.
    OfScenario(String),
}

impl AxisField {
    /// Parses the name of an axis; `path` is used in errors.
    pub fn parse(name: &str, path: &Path) -> Result<Self, DataError> {
        Ok(match name {
            "seed" => Self::Seed,
            "policy" => Self::Policy,
            "ablation" => Self::Ablation,
            "robot" => Self::Robot,
            "robot_model" => Self::RobotModel,
            "scenario" => Self::Scenario,
            "noise_scale" => Self::NoiseScale,
            "without" => Self::Without,
            "uncertainty" => Self::Uncertainty,
            _ => match name.strip_prefix(SCENARIO_PREFIX) {
                Some(field) if !field.is_empty() => Self::OfScenario(field.to_owned()),
                _ => {
                    let fields = scenario_fields(&Scenario::benchmark());
                    let prefixed: Vec<String> =
                        fields.iter().map(|field| format!("{SCENARIO_PREFIX}{field}")).collect();
                    let near = nearest_names(name, FIELD_NAMES.into_iter().chain(prefixed.iter().map(String::as_str)));
                    let expected = format!(
                        "one of {}, or a field of the scenario such as scenario.noise.perception.xy_sigma; near it: {}",
                        FIELD_NAMES.join(", "),
                        near.join(", ")
                    );
                    return Err(DataError::field(path, format!("axes.{name}"), "an unknown field", expected));
                }
            },
        })
    }
}

/// A value of an axis.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(untagged)]
pub enum AxisLevel {
    Whole(i64),
    Number(f64),
    Flag(bool),
    Text(String),
    /// Value of a field that is a list.
    List(Vec<Value>),
}

impl AxisLevel {
    /// Converts a value in a file; none for a table or a date.
    pub fn from_value(value: &Value) -> Option<Self> {
        Some(match value {
            Value::Integer(whole) => Self::Whole(*whole),
            Value::Float(number) => Self::Number(*number),
            Value::Boolean(flag) => Self::Flag(*flag),
            Value::String(text) => Self::Text(text.clone()),
            Value::Array(list) => Self::List(list.clone()),
            Value::Table(_) | Value::Datetime(_) => return None,
        })
    }

    fn value(&self) -> Value {
        match self {
            Self::Whole(whole) => Value::Integer(*whole),
            Self::Number(number) => Value::Float(*number),
            Self::Flag(flag) => Value::Boolean(*flag),
            Self::Text(text) => Value::String(text.clone()),
            Self::List(list) => Value::Array(list.clone()),
        }
    }

    /// Returns the level as a number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Whole(whole) => Some(*whole as f64),
            Self::Number(number) => Some(*number),
            Self::Flag(_) | Self::Text(_) | Self::List(_) => None,
        }
    }
}

impl std::fmt::Display for AxisLevel {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Whole(whole) => write!(formatter, "{whole}"),
            Self::Number(number) => write!(formatter, "{number}"),
            Self::Flag(flag) => write!(formatter, "{flag}"),
            Self::Text(text) => formatter.write_str(if text.is_empty() { "none" } else { text }),
            Self::List(list) => formatter.write_str(&Value::Array(list.clone()).to_string()),
        }
    }
}

/// A run under construction, to which one axis after the other is applied.
#[derive(Debug, Clone)]
pub struct RunDraft {
    /// Path of the sweep's file; files that it names are relative to it.
    pub file: PathBuf,
    pub request: RunRequest,
    /// Fields of the scenario that are set at the end: path and value.
    pub scenario_settings: Vec<(String, AxisLevel)>,
}

impl RunDraft {
    /// Creates an error about a value of axis `name`.
    fn value_error(&self, name: &str, found: impl ToString, expected: impl Into<String>) -> DataError {
        DataError::field(&self.file, format!("axes.{name}"), found, expected)
    }

    /// Resolves a file named in the sweep's file: it must lie below that file's folder.
    fn resolve_file(&self, axis: &str, name: &str) -> Result<PathBuf, DataError> {
        FileAccess::in_folder_of(&self.file).resolve(&self.file, &format!("axes.{axis}"), Path::new(name))
    }

    /// Returns the draft with `field` set to `level`.
    pub fn with(mut self, field: &AxisField, level: &AxisLevel) -> Result<Self, DataError> {
        match (field, level) {
            (AxisField::Seed, AxisLevel::Whole(seed)) if *seed >= 0 => self.request.seed = seed.unsigned_abs(),
            (AxisField::Seed, other) => return Err(self.value_error("seed", other, "whole numbers from 0 on")),
            (AxisField::Robot, AxisLevel::Text(robot)) if ROBOT_BACKENDS.contains(&robot.as_str()) => {
                self.request.robot = robot.clone()
            }
            (AxisField::Robot, other) => {
                return Err(self.value_error("robot", other, format!("one of {}", ROBOT_BACKENDS.join(", "))));
            }
            (AxisField::RobotModel, AxisLevel::Text(name)) => {
                self.request.robot_model = match name.as_str() {
                    BUILTIN_ROBOT => None,
                    file => {
                        let path = self.resolve_file("robot_model", file)?;
                        let sources = RobotSources::read(&path, FileAccess::in_folder_of(&self.file))?;
                        RobotModel::parse(&sources, &path)?;
                        Some(sources)
                    }
                };
            }
            (AxisField::RobotModel, other) => {
                return Err(self.value_error(
                    "robot_model",
                    other,
                    format!("names of robot files, or \"{BUILTIN_ROBOT}\""),
                ));
            }
            (AxisField::NoiseScale, level) => match level.number() {
                Some(scale) if (0.0..=10.0).contains(&scale) => self.request.noise_scale = scale,
                _ => return Err(self.value_error("noise_scale", level, "numbers from 0 to 10")),
            },
            (AxisField::Without, AxisLevel::Text(names)) => {
                let names: Vec<&str> = names.split(',').map(str::trim).filter(|name| !name.is_empty()).collect();
                self.request.without = match names[..] {
                    ["all"] => Effect::ALL.to_vec(),
                    _ => names
                        .iter()
                        .map(|name| {
                            name.parse::<Effect>().map_err(|error| self.value_error("without", name, error.to_string()))
                        })
                        .collect::<Result<BTreeSet<_>, _>>()?
                        .into_iter()
                        .collect(),
                };
            }
            (AxisField::Without, other) => {
                return Err(self.value_error(
                    "without",
                    other,
                    "texts with names of effects, such as \"detector,arm\"",
                ));
            }
            (AxisField::Uncertainty, AxisLevel::Text(file)) => {
                let path = self.resolve_file("uncertainty", file)?;
                let text = read_text(&path)?;
                Uncertainty::parse(&text, &path)?;
                self.request.uncertainty = Some(text);
            }
            (AxisField::Uncertainty, other) => return Err(self.value_error("uncertainty", other, "names of files")),
            (AxisField::Scenario, AxisLevel::Text(name)) => {
                self.request.scenario = match name.as_str() {
                    "benchmark" => scenarios::scenario::BENCHMARK_TOML.to_owned(),
                    file => {
                        let path = self.resolve_file("scenario", file)?;
                        Scenario::self_contained(&read_text(&path)?, &path, FileAccess::in_folder_of(&self.file))?
                    }
                };
            }
            (AxisField::Scenario, other) => {
                return Err(self.value_error("scenario", other, "names of scenario files, or \"benchmark\""));
            }
            (AxisField::OfScenario(field), level) => self.scenario_settings.push((field.clone(), level.clone())),
            // All of these are run together.
            (AxisField::Policy | AxisField::Ablation, _) => {}
        }
        Ok(self)
    }

    /// Checks the run and returns its request.
    pub fn finish(mut self) -> Result<RunRequest, DataError> {
        if !self.scenario_settings.is_empty() {
            self.request.scenario = self.scenario_text()?;
        }
        let scenario = Scenario::parse(&self.request.scenario, &self.file)?;
        let request = &self.request;
        if request.combos > scenario.combination_count() {
            let expected = format!("at most the scenario's {} pairs", scenario.combination_count());
            return Err(DataError::field(&self.file, "combos", request.combos, expected));
        }
        if request.robot != "sim" {
            let other = [
                (request.noise_scale != 1.0, "noise_scale"),
                (!request.ablations.is_empty(), "ablation"),
                (!scenario.disturbance.is_none(), "a scenario with a [disturbance]"),
            ];
            if let Some((_, what)) = other.iter().find(|(is, _)| *is) {
                let found = format!("{} with {what}", request.robot);
                return Err(self.value_error("robot", found, "sim"));
            }
        }
        if !request.ablations.is_empty() && !scenario.disturbance.disabled().is_empty() {
            return Err(self.value_error("ablation", "a scenario with disabled_digits", "one of the two"));
        }
        Ok(self.request)
    }

    /// Returns the text of the scenario with the changed fields.
    fn scenario_text(&self) -> Result<String, DataError> {
        let scenario = Scenario::parse(&self.request.scenario, &self.file)?;
        let table = |scenario: &Scenario| {
            Table::try_from(scenario)
                .map_err(|error| DataError::field(&self.file, "scenario", error, "a TOML document"))
        };
        let mut edited = table(&scenario)?;
        for (field, level) in &self.scenario_settings {
            if set_value(&mut edited, field, level.value()).is_none() {
                return Err(self.unknown_field_error(&scenario, field));
            }
        }
        let text = edited.to_string();
        let names: Vec<String> =
            self.scenario_settings.iter().map(|(field, _)| format!("axes.{SCENARIO_PREFIX}{field}")).collect();
        let parsed = Scenario::parse(&text, Path::new("scenario")).map_err(|error| {
            let unknown = error.to_string().contains("unknown field");
            match self.scenario_settings.iter().find(|(field, _)| unknown && !has_field(&scenario, field)) {
                Some((field, _)) => self.unknown_field_error(&scenario, field),
                None => DataError::field(&self.file, names.join(", "), error, "values valid in the scenario"),
            }
        })?;
        // A field unknown to the scenario would be swept without effect.
        let mut read_back = table(&parsed)?;
        for (field, level) in &self.scenario_settings {
            let found = set_value(&mut read_back, field, level.value());
            let same = found.is_some_and(|found| match (&found, level.number()) {
                (Some(Value::Float(found)), Some(number)) => *found == number,
                (Some(found), _) => *found == level.value(),
                (None, _) => false,
            });
            if !same {
                return Err(self.unknown_field_error(&scenario, field));
            }
        }
        Ok(text)
    }

    fn unknown_field_error(&self, scenario: &Scenario, field: &str) -> DataError {
        let fields = scenario_fields(scenario);
        let expected = format!(
            "a field of the scenario; near it: {}",
            nearest_names(field, fields.iter().map(String::as_str)).join(", ")
        );
        DataError::field(&self.file, format!("axes.{SCENARIO_PREFIX}{field}"), "an unknown field", expected)
    }
}

/// Sets `value` at `path` and returns the previous value. The outer option is none if the path leads through anything
/// but tables and lists.
fn set_value(table: &mut Table, path: &str, value: Value) -> Option<Option<Value>> {
    match path.split_once('.') {
        None => Some(match (table.get(path), value) {
            // An integer is accepted for a float.
            (Some(Value::Float(_)), Value::Integer(whole)) => table.insert(path.to_owned(), Value::Float(whole as f64)),
            (_, value) => table.insert(path.to_owned(), value),
        }),
        Some((first, rest)) => match table.entry(first.to_owned()).or_insert_with(|| Value::Table(Table::new())) {
            Value::Table(inner) => set_value(inner, rest, value),
            Value::Array(list) => {
                let slot = list.get_mut(rest.parse::<usize>().ok()?)?;
                Some(Some(std::mem::replace(slot, value)))
            }
            _ => None,
        },
    }
}

fn has_field(scenario: &Scenario, field: &str) -> bool {
    scenario_fields(scenario).iter().any(|known| known == field)
}

/// Returns the paths of all fields of a scenario.
fn scenario_fields(scenario: &Scenario) -> Vec<String> {
    fn leaves(table: &Table, prefix: &str, into: &mut Vec<String>) {
        for (key, value) in table {
            let path = format!("{prefix}{key}");
            match value {
                Value::Table(inner) => leaves(inner, &format!("{path}."), into),
                _ => into.push(path),
            }
        }
    }
    let mut fields = Vec::new();
    if let Ok(table) = Table::try_from(scenario) {
        leaves(&table, "", &mut fields);
    }
    fields
}

/// Parses the names of an axis over policies or ablations, and sorts them in the order of the benchmark.
pub fn parse_names<T: std::str::FromStr + Ord>(
    name: &str,
    levels: &[AxisLevel],
    file: &Path,
) -> Result<Vec<T>, DataError>
where
    T::Err: std::fmt::Display,
{
    let wrong = |found: &AxisLevel, expected: String| DataError::field(file, format!("axes.{name}"), found, expected);
    let mut found = levels
        .iter()
        .map(|level| match level {
            AxisLevel::Text(text) => text.parse::<T>().map_err(|error| wrong(level, error.to_string())),
            other => Err(wrong(other, "texts".to_owned())),
        })
        .collect::<Result<Vec<T>, _>>()?;
    found.sort();
    found.dedup();
    Ok(found)
}

/// Parses [`parse_names`] of built-in conditions: a sweep has no external policy.
pub fn policies(levels: &[AxisLevel], file: &Path) -> Result<Vec<Condition>, DataError> {
    let policies = parse_names("policy", levels, file)?;
    if policies.contains(&Condition::External) {
        let expected = Condition::BUILT_IN.map(Condition::name).join(", ");
        return Err(DataError::field(file, "axes.policy", "external", format!("one of {expected}")));
    }
    Ok(policies)
}

/// Parses [`parse_names`] of ablations.
pub fn ablations(levels: &[AxisLevel], file: &Path) -> Result<Vec<Ablation>, DataError> {
    parse_names("ablation", levels, file)
}

/// An axis of the plan: its name and values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedAxis {
    /// Name as in the sweep's file.
    pub name: String,
    /// Name of the column that holds its value.
    pub column: String,
    pub levels: Vec<AxisLevel>,
}
