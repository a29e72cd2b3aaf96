//! Errors of writing or reading a session.

use std::path::{Path, PathBuf};

use mcap::McapError;

#[derive(Debug, thiserror::Error)]
pub enum SessionLogError {
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        source: std::io::Error,
    },
    /// Not an MCAP file, or a damaged one.
    #[error("{}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        source: McapError,
    },
    /// An MCAP file of something else, or of another version of this program.
    #[error("{}: {field} is {found}, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        field: String,
        found: String,
        expected: String,
    },
}

impl SessionLogError {
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Io { path, source }
    }

    pub(super) fn mcap(path: &Path) -> impl FnOnce(McapError) -> Self {
        let path = path.to_owned();
        |source| match source {
            McapError::Io(source) => Self::Io { path, source },
            source => Self::Mcap { path, source },
        }
    }

    pub(super) fn field(path: &Path, field: &str, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Field { path: path.to_owned(), field: field.to_owned(), found: found.into(), expected: expected.into() }
    }
}
