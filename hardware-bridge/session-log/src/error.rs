//! Errors of writing or reading a session.

use std::path::{Path, PathBuf};

use mcap::McapError;

/// A fault of a session's file. The message names the file.
#[derive(Debug, thiserror::Error)]
pub enum SessionLogError {
    /// The file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Not an MCAP file, or a damaged one.
    #[error("{}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Error of the MCAP reader or writer.
        source: McapError,
    },
    /// A field that is not as expected, for example in an MCAP file of another program or of another format version.
    #[error("{}: {field} is {found}, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Name of the field.
        field: String,
        /// Value in the file.
        found: String,
        /// Expected value.
        expected: String,
    },
}

impl SessionLogError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        |source| Self::Io { path, source }
    }

    pub(crate) fn mcap(path: &Path) -> impl FnOnce(McapError) -> Self {
        let path = path.to_owned();
        |source| match source {
            McapError::Io(source) => Self::Io { path, source },
            source => Self::Mcap { path, source },
        }
    }

    pub(crate) fn field(path: &Path, field: &str, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Field { path: path.to_owned(), field: field.to_owned(), found: found.into(), expected: expected.into() }
    }
}
