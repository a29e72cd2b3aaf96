//! Schema of the results: the columns of a sweep's Parquet files for trials and tries, their meaning and their version.
//!
//! A file has these columns in this order, with one `axis_...` column per axis behind `seed`. All columns are optional
//! (null) in the schema; those not described as sometimes empty never are. The file's metadata name the version
//! (`ftac.schema`), the unit (`ftac.unit_path`) and the program.

use crate::axis::{AxisLevel, PlannedAxis};

/// Version of the tables. It changes when a column is added, renamed or changes its meaning.
pub const VERSION: u32 = 2;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// INT64.
    Whole,
    /// DOUBLE.
    Number,
    /// BOOLEAN.
    Flag,
    /// UTF-8.
    Text,
}

/// A column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableColumn {
    pub name: String,
    pub kind: ColumnKind,
    /// Meaning of the column; units SI unless its name says otherwise.
    pub description: &'static str,
}

/// Selects a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableKind {
    /// One row per trial and condition.
    Trials,
    /// One row per try.
    Tries,
}

impl TableKind {
    pub const ALL: [Self; 2] = [Self::Trials, Self::Tries];

    /// Returns the name of the table's folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Trials => "trials",
            Self::Tries => "tries",
        }
    }

    /// Returns the table's columns in a sweep with `axes`.
    pub fn columns(self, axes: &[PlannedAxis]) -> Vec<TableColumn> {
        let fixed = |&(name, kind, about): &(&'static str, ColumnKind, &'static str)| TableColumn {
            name: name.into(),
            kind,
            description: about,
        };
        let axis = |axis: &PlannedAxis| {
            let numbers = axis.levels.iter().all(|level| level.number().is_some());
            let flags = axis.levels.iter().all(|level| matches!(level, AxisLevel::Flag(_)));
            let kind = if numbers {
                ColumnKind::Number
            } else if flags {
                ColumnKind::Flag
            } else {
                ColumnKind::Text
            };
            TableColumn { name: axis.column.clone(), kind, description: "value of the axis" }
        };
        let own: Vec<TableColumn> = match self {
            Self::Trials => TRIAL_COLUMNS.iter().map(fixed).collect(),
            Self::Tries => TRY_COLUMNS.iter().map(fixed).chain(covariance()).collect(),
        };
        PLACE_COLUMNS.iter().map(fixed).chain(axes.iter().map(axis)).chain(own).collect()
    }
}

use ColumnKind::{Flag, Number, Text, Whole};

/// Columns of wall time: they differ from run to run and are excluded from a result's digest.
pub const WALL_TIME_COLUMNS: [&str; 1] = ["decision_ms"];

/// Columns that locate a row in the sweep.
pub const PLACE_COLUMNS: [(&str, ColumnKind, &str); 4] = [
    ("point", Whole, "number of the point, from 0: one value of each axis but seed, policy and ablation"),
    ("unit", Text, "unit of work of the trial"),
    ("robot", Text, "robot backend: sim, emulated or direct"),
    ("seed", Whole, "seed of everything random"),
];

const ID_COLUMNS: [(&str, ColumnKind, &str); 3] = [
    ("combination", Whole, "pair of objects, from 0"),
    ("trial", Whole, "number of the trial within its combination, from 0; 0 under ideal"),
    ("policy", Text, "condition: ideal, blind, reflex or touch"),
];

/// Columns of a trial, as in `trials.csv`.
const TRIAL_COLUMNS: [(&str, ColumnKind, &str); 25] = [
    ID_COLUMNS[0],
    ID_COLUMNS[1],
    ID_COLUMNS[2],
    ("ablation", Text, "capability removed from touch; empty if none was"),
    ("first", Text, "first object"),
    ("second", Text, "second object"),
    ("contact", Flag, "an unwanted contact in any try"),
    ("contact_with", Text, "part in the first unwanted contact; empty without"),
    ("contact_s", Number, "time of the contact, s since the start of the trial; empty without"),
    ("contact_n", Number, "maximum force of the contact, N; empty without"),
    ("success", Flag, "both objects held at the end"),
    ("clean_success", Flag, "success without any unwanted contact"),
    ("cause", Text, "cause of a failure; empty on success"),
    ("switched", Flag, "the policy left the planned strategy"),
    ("retries", Whole, "number of repeated tries of a grasp"),
    ("reason", Text, "reason for switching and trying again, or for not doing so"),
    ("disturbance", Text, "disturbances of the trial in addition to noise"),
    ("risk", Number, "predicted probability of an unwanted contact; empty if none was made"),
    (
        "plan_separation_mm",
        Number,
        "predicted between the objects at the planned grasp, mm; negative is a collision; empty if none was made",
    ),
    ("chosen_separation_mm", Number, "the same at the chosen grasp; empty if none was chosen"),
    ("pose_error_mm", Number, "error of the estimate of the first object in the hand, mm; empty without an estimate"),
    ("pose_error_deg", Number, "the same, deg"),
    ("prior_error_mm", Number, "error of the planned pose, mm"),
    ("sim_seconds", Number, "simulated time, s"),
    ("decision_ms", Number, "slowest decision, ms of wall time: differs from run to run; empty without a decision"),
];

/// Columns of a try, as in `tries.csv`, with lists split into columns. The covariance follows.
const TRY_COLUMNS: [(&str, ColumnKind, &str); 26] = [
    ID_COLUMNS[0],
    ID_COLUMNS[1],
    ID_COLUMNS[2],
    ("try", Whole, "number within its trial, from 0"),
    ("object", Text, "first or second"),
    ("grasp", Whole, "number of the grasp"),
    ("why", Text, "reason for this grasp"),
    ("clearance_mm", Number, "predicted, mm; may be empty"),
    ("risk", Number, "predicted probability of an unwanted contact; may be empty"),
    ("felt_x", Number, "estimated pose of the first object, m, palm frame; the six are empty without an estimate"),
    ("felt_y", Number, "m"),
    ("felt_z", Number, "m"),
    ("felt_rx", Number, "rotation vector, rad"),
    ("felt_ry", Number, "rad"),
    ("felt_rz", Number, "rad"),
    ("contact_with", Text, "part in the first unwanted contact; empty without, as are the next"),
    ("contact_by", Text, "touching part: first_object, palm, or a link by its number"),
    ("contact_s", Number, "time of the contact, s since the start of the trial"),
    ("contact_phase", Text, "phase of the contact"),
    ("contact_x", Number, "position of the contact, m, world"),
    ("contact_y", Number, "m"),
    ("contact_z", Number, "m"),
    ("contact_n", Number, "maximum force of the contact, N"),
    ("picked", Flag, "the object was in the hand at the end of its lift; empty if it was not lifted"),
    ("begun_s", Number, "start, s since the start of the trial"),
    ("ended_s", Number, "end, s since the start of the trial"),
];

/// Names of the estimated pose's six coordinates.
pub const POSE_COORDINATES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// Returns the columns of the upper triangle of the estimated pose's covariance, row by row.
fn covariance() -> impl Iterator<Item = TableColumn> {
    let pairs = (0..6).flat_map(|row| (row..6).map(move |column| (POSE_COORDINATES[row], POSE_COORDINATES[column])));
    pairs.map(|(row, column)| TableColumn {
        name: format!("cov_{row}_{column}"),
        kind: ColumnKind::Number,
        description: "covariance of the estimated pose, m and rad",
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The tables keep every column of `trials.csv`.
    #[test]
    fn no_column_of_a_trial_is_left_out() {
        let own: BTreeSet<String> = TableKind::Trials.columns(&[]).into_iter().map(|column| column.name).collect();
        for name in scenarios::record::COLUMNS {
            // The sweep's name of the benchmark's conditions.
            let name = if name == "condition" { "policy" } else { name };
            assert!(own.contains(name), "{name}");
        }
        assert_eq!(own.len(), scenarios::record::COLUMNS.len() + PLACE_COLUMNS.len() + 1);
    }

    #[test]
    fn names_are_there_once() {
        for which in TableKind::ALL {
            let columns = which.columns(&[]);
            let names: BTreeSet<&str> = columns.iter().map(|column| column.name.as_str()).collect();
            assert_eq!(names.len(), columns.len());
        }
    }
}
