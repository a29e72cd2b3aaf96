//! What can be wrong with a model file.

use std::path::PathBuf;

/// An error that names the file, the element and the field, what was found and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is not well-formed.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message, with line and column where it gives them.
        message: String,
    },
    /// A field has a value the model cannot be built from.
    #[error("{path}: {element}.{field}: found {found}, expected {expected}")]
    Field {
        /// The file.
        path: PathBuf,
        /// Element, such as `joint[thumb_1]`.
        element: String,
        /// Field of that element.
        field: String,
        /// What the file says.
        found: String,
        /// What would be right.
        expected: String,
    },
}
