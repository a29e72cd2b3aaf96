//! Errors in a table of figures, with their location.

use std::path::{Path, PathBuf};

/// An invalid field of the table.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}: {field}: found {found}, expected {expected}", file.display())]
pub struct FieldError {
    /// Path of the table.
    pub file: PathBuf,
    /// Line number, counted from 1; the header is line 1.
    pub line: u64,
    /// Name of the column, or `row` if no single column is at fault.
    pub field: &'static str,
    pub found: String,
    pub expected: String,
}

impl FieldError {
    pub fn new(
        (file, line): (&Path, u64),
        field: &'static str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self { file: file.to_owned(), line, field, found: found.into(), expected: expected.into() }
    }
}
