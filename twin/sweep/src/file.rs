//! The file of a sweep: the trials at every point, and the axes that span the points.

use std::path::{Path, PathBuf};

use ftac_platform::data::{DataError, parse_toml, read_text};
use serde::Deserialize;
use toml::{Table, Value};

use crate::axis::{AxisField, AxisLevel};

/// Version of sweep files that this crate reads.
pub const VERSION: u32 = 1;
/// Largest number of values of an axis.
const MAX_LEVELS: usize = 100_000;

/// A sweep as in its file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SweepFile {
    version: u32,
    name: String,
    #[serde(default = "default_combinations")]
    combos: usize,
    trials: usize,
    #[serde(default = "default_unit_minutes")]
    unit_minutes: f64,
    #[serde(default)]
    axes: Table,
}

/// Default number of combinations: that of the benchmark.
fn default_combinations() -> usize {
    60
}

fn default_unit_minutes() -> f64 {
    3.0
}

/// An axis and its values.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepAxis {
    /// Name as in the file.
    pub name: String,
    pub field: AxisField,
    /// Distinct values, in the file's order.
    pub levels: Vec<AxisLevel>,
}

/// A sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// Path of the file, for errors and for files named in it.
    pub file: PathBuf,
    /// Name for display.
    pub name: String,
    /// Number of pairs of objects at every point.
    pub combos: usize,
    /// Number of trials of each pair.
    pub trials: usize,
    /// Approximate duration of a unit of work on one core, min.
    pub unit_minutes: f64,
    /// Axes, in the order of their names.
    pub axes: Vec<SweepAxis>,
}

impl Sweep {
    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        Self::parse(&read_text(path)?, path)
    }

    /// Parses a file's text; `path` is used in errors, and files named in it are relative to its folder.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let file: SweepFile = parse_toml(text, path)?;
        let wrong = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if file.version != VERSION {
            return wrong("version", file.version.to_string(), &VERSION.to_string());
        }
        for (field, value) in [("combos", file.combos), ("trials", file.trials)] {
            if value == 0 {
                return wrong(field, "0: an empty sweep".to_owned(), "at least 1");
            }
        }
        if !(file.unit_minutes > 0.0 && file.unit_minutes <= 1440.0) {
            return wrong("unit_minutes", file.unit_minutes.to_string(), "more than 0 and at most 1440");
        }
        let axes = file.axes.iter().map(|(name, value)| axis(name, value, path)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            file: path.to_owned(),
            name: file.name,
            combos: file.combos,
            trials: file.trials,
            unit_minutes: file.unit_minutes,
            axes: axes.into_iter().flatten().collect(),
        })
    }

    /// Returns the values of an axis; none if it is not swept.
    pub fn levels(&self, field: &AxisField) -> Option<&[AxisLevel]> {
        self.axes.iter().find(|axis| axis.field == *field).map(|axis| axis.levels.as_slice())
    }
}

/// Parses the axes below a name: `[axes.scenario.noise]` is another way to write fields of the scenario.
fn axis(name: &str, value: &Value, path: &Path) -> Result<Vec<SweepAxis>, DataError> {
    let levels = match value {
        Value::Array(values) => values
            .iter()
            .map(|value| {
                let kinds = "numbers, texts, true, false or lists";
                AxisLevel::from_value(value).ok_or_else(|| DataError::field(path, format!("axes.{name}"), value, kinds))
            })
            .collect::<Result<Vec<_>, _>>()?,
        Value::Table(table) if table.keys().all(|key| ["from", "to", "steps"].contains(&key.as_str())) => range(table)
            .ok_or_else(|| {
                let expected = "{ from = A, to = B, steps = N } with N of at least 2 and at most 100000";
                DataError::field(path, format!("axes.{name}"), value, expected)
            })?,
        Value::Table(table) => {
            let below = |(key, value): (&String, &Value)| axis(&format!("{name}.{key}"), value, path);
            return Ok(table.iter().map(below).collect::<Result<Vec<_>, _>>()?.concat());
        }
        other => {
            let expected = "a list of values, or { from = A, to = B, steps = N }";
            return Err(DataError::field(path, format!("axes.{name}"), other, expected));
        }
    };
    let field = AxisField::parse(name, path)?;
    let wrong = |found: String, expected: &str| Err(DataError::field(path, format!("axes.{name}"), found, expected));
    if levels.is_empty() {
        return wrong("no value: an empty sweep".to_owned(), "at least one");
    }
    if levels.iter().any(|level| level.number().is_some_and(|number| !number.is_finite())) {
        return wrong("a number that is not finite".to_owned(), "finite numbers");
    }
    let same = |one: &AxisLevel, other: &AxisLevel| {
        // 1 and 1.0 are one value.
        one == other || one.number().zip(other.number()).is_some_and(|(one, other)| one == other)
    };
    if let Some(n) = (1..levels.len()).find(|&n| levels[..n].iter().any(|level| same(level, &levels[n]))) {
        return wrong(format!("{} twice", levels[n]), "every value once");
    }
    Ok(vec![SweepAxis { name: name.to_owned(), field, levels }])
}

/// Returns equidistant values from one value to another: integers if all of them are.
fn range(table: &Table) -> Option<Vec<AxisLevel>> {
    let steps =
        usize::try_from(table.get("steps")?.as_integer()?).ok().filter(|steps| (2..=MAX_LEVELS).contains(steps))?;
    let (from, to) = (AxisLevel::from_value(table.get("from")?)?, AxisLevel::from_value(table.get("to")?)?);
    let intervals = steps as i64 - 1;
    if let (AxisLevel::Whole(from), AxisLevel::Whole(to)) = (&from, &to) {
        let span = to.checked_sub(*from)?;
        if span % intervals == 0 {
            return Some((0..=intervals).map(|n| AxisLevel::Whole(from + n * (span / intervals))).collect());
        }
    }
    let (from, to) = (from.number()?, to.number()?);
    Some((0..steps).map(|n| AxisLevel::Number(from + (to - from) * n as f64 / intervals as f64)).collect())
}
