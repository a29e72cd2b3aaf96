//! Reading data files, and the one error that says what is wrong with one: file, field, what was found, what was expected.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// What can be wrong with a data file.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is not well-formed TOML, has an unknown field, lacks a needed one, or a value is of the wrong kind.
    #[error("{path}:{line}: `{found}`: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The line.
        found: String,
        /// The parser's message, which says what it expected.
        message: String,
    },
    /// A line of a file without named fields is not what it should be.
    #[error("{path}:{line}: found {found}, expected {expected}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What the line says.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A field has a value that nothing can be built from.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    Field {
        /// The file.
        path: PathBuf,
        /// The field with what it belongs to, such as `layout.first.x` or `joint[thumb_1].mass`.
        field: String,
        /// What the file says.
        found: String,
        /// What would be right.
        expected: String,
    },
}

impl DataError {
    /// A [`Self::Field`] error.
    pub fn field(path: &Path, field: impl Into<String>, found: impl ToString, expected: impl Into<String>) -> Self {
        Self::Field { path: path.into(), field: field.into(), found: found.to_string(), expected: expected.into() }
    }

    /// The same error of a field inside of `element`.
    #[must_use]
    pub fn within(mut self, element: &str) -> Self {
        if let Self::Field { field, .. } = &mut self {
            *field = format!("{element}.{field}");
        }
        self
    }
}

/// The text of a file.
pub fn read_text(path: &Path) -> Result<String, DataError> {
    std::fs::read_to_string(path).map_err(|source| DataError::Io { path: path.into(), source })
}

/// The value of a TOML text; `path` is used in errors only.
pub fn parse_toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, DataError> {
    toml::from_str(text).map_err(|error| {
        let at = error.span().map_or(0, |span| span.start).min(text.len());
        let line = text.get(..at).unwrap_or_default().matches('\n').count();
        DataError::Syntax {
            path: path.into(),
            line: line + 1,
            found: text.lines().nth(line).unwrap_or_default().trim().into(),
            message: error.message().into(),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Ball {
        #[allow(dead_code)]
        radius: f64,
    }

    #[test]
    fn an_error_names_the_line_and_what_stands_there() {
        let error =
            parse_toml::<Ball>("# a ball\nradius = \"2 cm\"\n", Path::new("ball.toml")).unwrap_err().to_string();
        assert_eq!(error, "ball.toml:2: `radius = \"2 cm\"`: invalid type: string \"2 cm\", expected f64");
        let unknown =
            parse_toml::<Ball>("radius = 1.0\nradios = 2.0\n", Path::new("ball.toml")).unwrap_err().to_string();
        assert!(unknown.starts_with("ball.toml:2: `radios = 2.0`: unknown field `radios`"), "{unknown}");
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read_text(Path::new("/nowhere/ball.toml")).unwrap_err().to_string();
        assert!(error.starts_with("/nowhere/ball.toml: "), "{error}");
    }
}
