//! What is wrong with a table of figures, and where.

use std::path::{Path, PathBuf};

/// A field of the table that does not hold what it should.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}: {field}: found {found}, expected {expected}", file.display())]
pub struct FieldError {
    /// The table.
    pub file: PathBuf,
    /// Counted from 1; the header is line 1.
    pub line: u64,
    /// The column, or `row` where no single column is at fault.
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
