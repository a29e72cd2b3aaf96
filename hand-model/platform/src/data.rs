//! Reading and writing of data files. Their one error type, [`DataError`], names the file, the field, what was found
//! and what was expected.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::file;

/// A fault of a data file.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("cannot write {path}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is not well-formed TOML, has an unknown field, lacks a required one, or has a value of the wrong type.
    #[error("{path}:{line}: `{found}`: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Text of the line.
        found: String,
        /// The parser's message, which states what it expected.
        message: String,
    },
    /// A line of a file without named fields is malformed.
    #[error("{path}:{line}: found {found}, expected {expected}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Content of the line.
        found: String,
        /// Expected content.
        expected: String,
    },
    /// A field has an unusable value.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    Field {
        /// The file.
        path: PathBuf,
        /// The field with its parents, such as `layout.first.x` or `joint[thumb_1].mass`.
        field: String,
        /// Value in the file.
        found: String,
        /// Expected value.
        expected: String,
    },
}

impl DataError {
    /// Builds a [`Self::Field`] error.
    pub fn field(path: &Path, field: impl Into<String>, found: impl ToString, expected: impl Into<String>) -> Self {
        Self::Field { path: path.into(), field: field.into(), found: found.to_string(), expected: expected.into() }
    }

    /// Returns the same error with `element` as the parent of the field.
    #[must_use]
    pub fn within(mut self, element: &str) -> Self {
        if let Self::Field { field, .. } = &mut self {
            *field = format!("{element}.{field}");
        }
        self
    }
}

/// Calls [`file::write_atomically`]; the error names the file.
///
/// # Errors
/// [`DataError::Write`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), DataError> {
    file::write_atomically(path, bytes).map_err(|source| DataError::Write { path: path.into(), source })
}

/// Reads the text of a regular file of at most [`file::MAX_TEXT_SIZE`] bytes.
///
/// # Errors
/// [`DataError::Io`].
pub fn read_text(path: &Path) -> Result<String, DataError> {
    file::read_text(path).map_err(|source| DataError::Io { path: path.into(), source })
}

/// Parses a TOML text; `path` is used in errors only.
///
/// The error shows the offending line only if the target type has that field. For an unknown field it shows the field's
/// name alone, and for a text that is not TOML it shows no content: such a file may be anything, and its content is not
/// for whoever reads the error.
///
/// # Errors
/// [`DataError::Syntax`], or [`DataError::Line`] for a text that is not TOML.
///
/// ```
/// use std::path::Path;
///
/// use ftac_platform::data::parse_toml;
///
/// #[derive(Debug, serde::Deserialize)]
/// struct Ball {
///     radius: f64,
/// }
///
/// let ball: Ball = parse_toml("radius = 0.02", Path::new("ball.toml"))?;
/// assert_eq!(ball.radius, 0.02);
/// let error = parse_toml::<Ball>("\nradius = \"2 cm\"\n", Path::new("ball.toml")).expect_err("a text");
/// assert!(error.to_string().starts_with("ball.toml:2: `radius = \"2 cm\"`: invalid type"));
/// # Ok::<(), ftac_platform::DataError>(())
/// ```
pub fn parse_toml<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, DataError> {
    toml::from_str(text).map_err(|error| {
        let span = error.span().unwrap_or_default();
        let before = text.get(..span.start).unwrap_or_default();
        let number = before.matches('\n').count();
        let line = text.lines().nth(number).unwrap_or_default().trim();
        if text.parse::<toml::Table>().is_err() {
            let column = before.lines().next_back().map_or(0, |line| line.chars().count());
            let column = if before.ends_with('\n') { 0 } else { column };
            return DataError::Line {
                path: path.into(),
                line: number + 1,
                found: format!("no TOML from column {} on", column + 1),
                expected: "TOML: name = value".into(),
            };
        }
        let name = text.get(span).unwrap_or_default();
        let names = |rest: &str| rest.trim_start().starts_with('=');
        let found = if !name.is_empty() && line.strip_prefix(name).is_some_and(names) { name } else { line };
        let message = truncate_text(error.message(), MAX_MESSAGE);
        DataError::Syntax { path: path.into(), line: number + 1, found: truncate_text(found, MAX_EXCERPT), message }
    })
}

/// Longest excerpt of a file in an error, characters.
const MAX_EXCERPT: usize = 80;
/// Longest parser message in an error, characters; a message may repeat a value.
const MAX_MESSAGE: usize = 1000;

/// Returns the first `most` characters of `text`, with an ellipsis if it is longer.
fn truncate_text(text: &str, most: usize) -> String {
    let mut letters = text.chars();
    let shown: String = letters.by_ref().take(most).collect();
    if letters.next().is_some() { shown + "..." } else { shown }
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
        assert!(unknown.starts_with("ball.toml:2: `radios`: unknown field `radios`"), "{unknown}");
        let missing = parse_toml::<Ball>("\n", Path::new("ball.toml")).unwrap_err().to_string();
        assert!(missing.contains("missing field `radius`"), "{missing}");
    }

    #[test]
    fn a_file_of_another_kind_is_not_echoed() {
        for (text, at) in [
            ("root:$6$salt$hash:19000:0:99999:7:::\n", "ball.toml:1: found no TOML from column "),
            ("radius = 1.0\nhunter2\n", "ball.toml:2: found no TOML from column "),
            ("password = \"hunter2\"\n", "ball.toml:1: `password`: unknown field `password`"),
            ("password = { of_the = \"hunter2\" }\n", "ball.toml:1: `password`: unknown field `password`"),
            ("[secrets]\ntoken = \"hunter2\"\n", "ball.toml:1: `[secrets]`: unknown field `secrets`"),
        ] {
            let error = parse_toml::<Ball>(text, Path::new("ball.toml")).unwrap_err().to_string();
            assert!(error.starts_with(at), "{error}");
            assert!(!error.contains("hunter2") && !error.contains("hash") && !error.contains("root"), "{error}");
        }
        let long = format!("radius = \"{}\"\n", "x".repeat(1000));
        let error = parse_toml::<Ball>(&long, Path::new("ball.toml")).unwrap_err();
        let DataError::Syntax { found, .. } = error else { panic!("{error}") };
        assert_eq!(found.chars().count(), MAX_EXCERPT + 3);
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read_text(Path::new("/nowhere/ball.toml")).unwrap_err().to_string();
        assert!(error.starts_with("/nowhere/ball.toml: "), "{error}");
    }
}
