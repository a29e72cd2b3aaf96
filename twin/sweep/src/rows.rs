//! Rows of a unit's tables from the records of its trials.

use anyhow::{Context as _, Result};
use bench::trial::TrialResults;
use scenarios::record::TrialRecord;
use scenarios::tries::TryRecord;
use serde_json::{Map, Value};

use crate::axis::AxisLevel;
use crate::columns::{ColumnKind, POSE_COORDINATES, TableColumn, TableKind};
use crate::plan::{SweepPlan, SweepUnit};
use crate::table::{Cell, ColumnTable};

/// Tables of a unit.
pub struct UnitTables {
    pub trials: ColumnTable,
    pub tries: ColumnTable,
    /// Common fields at the start of every row.
    common_fields: Map<String, Value>,
}

impl UnitTables {
    /// Creates the empty tables of a unit.
    pub fn new(plan: &SweepPlan, unit: &SweepUnit) -> Result<Self> {
        let run = plan.runs.get(unit.run).context("a unit of no run")?;
        let mut place = Map::new();
        place.insert("point".into(), run.point.into());
        place.insert("unit".into(), unit.id.clone().into());
        place.insert("robot".into(), run.request.robot.clone().into());
        place.insert("seed".into(), run.request.seed.into());
        let [trials, tries] = TableKind::ALL.map(|which| ColumnTable::new(which.columns(&plan.axes)));
        for (axis, level) in plan.axes.iter().zip(&run.at) {
            let texts =
                trials.columns.iter().any(|column| column.name == axis.column && column.kind == ColumnKind::Text);
            let level = axis.levels.get(*level).context("a level that the axis does not have")?;
            let value = match level {
                level if texts => level.to_string().into(),
                AxisLevel::Flag(flag) => Value::from(*flag),
                level => level.number().map_or(Value::Null, Value::from),
            };
            place.insert(axis.column.clone(), value);
        }
        Ok(Self { trials, tries, common_fields: place })
    }

    /// Adds the records of a trial.
    pub fn add(&mut self, results: &TrialResults) -> Result<()> {
        for record in &results.records {
            self.trial(record, None)?;
        }
        for ablated in &results.ablated {
            self.trial(&ablated.record, Some(ablated.ablation.name()))?;
        }
        results.tries.iter().try_for_each(|one| self.add_try(one))
    }

    fn trial(&mut self, record: &TrialRecord, ablation: Option<&str>) -> Result<()> {
        let mut row = self.row(serde_json::to_value(record)?);
        row.insert("ablation".into(), ablation.into());
        self.trials.push(cells(&row, &self.trials.columns.clone()))
    }

    fn add_try(&mut self, record: &TryRecord) -> Result<()> {
        let mut row = self.row(serde_json::to_value(record)?);
        split(&mut row, "felt", POSE_COORDINATES.iter().map(|axis| format!("felt_{axis}")));
        split(&mut row, "contact_at", ["x", "y", "z"].iter().map(|axis| format!("contact_{axis}")));
        let pairs =
            (0..6).flat_map(|a| (a..6).map(move |b| format!("cov_{}_{}", POSE_COORDINATES[a], POSE_COORDINATES[b])));
        split(&mut row, "covariance", pairs);
        for name in ["contact_with", "contact_by", "contact_phase"] {
            if row.get(name).is_some_and(|text| text == "") {
                row.insert(name.into(), Value::Null);
            }
        }
        self.tries.push(cells(&row, &self.tries.columns.clone()))
    }

    /// Returns the record's fields, preceded by the unit's.
    fn row(&self, record: Value) -> Map<String, Value> {
        let mut row = self.common_fields.clone();
        if let Value::Object(fields) = record {
            row.extend(fields);
        }
        if let Some(condition) = row.remove("condition") {
            row.insert("policy".into(), condition);
        }
        row
    }
}

/// Splits a text of numbers into separate fields.
fn split(row: &mut Map<String, Value>, field: &str, names: impl Iterator<Item = String>) {
    let text = row.remove(field);
    let mut numbers = text.as_ref().and_then(Value::as_str).unwrap_or_default().split(' ').map(str::parse::<f64>);
    for name in names {
        row.insert(name, numbers.next().and_then(Result::ok).map_or(Value::Null, Value::from));
    }
}

fn cells(row: &Map<String, Value>, columns: &[TableColumn]) -> Vec<Cell> {
    columns.iter().map(|column| cell(row.get(&column.name).unwrap_or(&Value::Null), column.kind)).collect()
}

fn cell(value: &Value, kind: ColumnKind) -> Cell {
    match (value, kind) {
        (Value::Null, _) => Cell::None,
        (Value::Bool(flag), _) => Cell::Flag(*flag),
        (Value::String(text), _) => Cell::Text(text.clone()),
        (Value::Number(number), ColumnKind::Number) => number.as_f64().map_or(Cell::None, Cell::Number),
        (Value::Number(number), _) => number.as_i64().map_or(Cell::None, Cell::Whole),
        (Value::Array(_) | Value::Object(_), _) => Cell::Text(value.to_string()),
    }
}
