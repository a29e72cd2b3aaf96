//! Errors of the board.

use std::path::PathBuf;

use ftac_platform::DataError;
use scenarios::Condition;

/// Reason for which there is no entry.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// A file has an unusable value, or cannot be read or written.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The folder holds no readable run.
    #[error("{0:#}")]
    Run(anyhow::Error),
    /// The run cannot be a row.
    #[error("{folder}: {field}: found {found}, expected {expected}")]
    Unsuitable {
        /// Result folder of the run.
        folder: PathBuf,
        /// Field of the run.
        field: String,
        /// Value in the run.
        found: String,
        /// Expected value.
        expected: String,
    },
    /// Units of work are missing.
    #[error("{folder}: found {finished} of {total} units of work, expected all of them: {hint}")]
    Unfinished {
        /// Result folder of the run.
        folder: PathBuf,
        /// Number of finished units.
        finished: usize,
        /// Number of units of the run.
        total: usize,
        /// Way to finish it.
        hint: String,
    },
    /// The run has several policies, or none, and the row's was not named.
    #[error("--condition: found none, expected one of {}: a row shows one of the run's policies", names(.available))]
    ConditionNotNamed {
        /// Conditions of the run that can be a row.
        available: Vec<Condition>,
    },
    /// The run does not have the named condition.
    #[error("--condition: found {found}, expected one of {}, which the run has", names(.available))]
    ConditionMissing {
        /// The named condition.
        found: Condition,
        /// Conditions of the run that can be a row.
        available: Vec<Condition>,
    },
    /// An option has an unusable value.
    #[error("{option}: found {found}, expected {expected}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        found: String,
        /// Expected value.
        expected: String,
    },
    /// The entry cannot be written as TOML.
    #[error("the entry cannot be written: {0}")]
    Toml(#[from] toml::ser::Error),
    /// A part of the entry cannot be written as JSON.
    #[error("the entry cannot be written: {0}")]
    Json(#[from] serde_json::Error),
}

fn names(conditions: &[Condition]) -> String {
    conditions.iter().map(|condition| condition.name()).collect::<Vec<_>>().join(", ")
}
