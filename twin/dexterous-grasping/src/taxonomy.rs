//! The paper's 19 grasp types: Feix's 33, merged where hand and opposition are the same. The table is data
//! (`data/types.toml`). [`attributes`] measures a held grasp, and [`rules`] decides on its type.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::synthesis::hand_use::HandUse;

pub mod attributes;
pub mod rules;

/// Feix's three broad kinds of grasps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Category {
    /// Held rigidly: only the arm moves the object.
    Power,
    /// Between power and precision.
    Intermediate,
    /// Held between fingertips, which can move the object.
    Precision,
}

impl Category {
    /// All categories, in the order of the paper's table.
    pub const ALL: [Category; 3] = [Category::Power, Category::Intermediate, Category::Precision];

    pub fn name(self) -> &'static str {
        match self {
            Self::Power => "power",
            Self::Intermediate => "intermediate",
            Self::Precision => "precision",
        }
    }
}

/// One of the 19 types.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GraspType {
    /// Name in the paper's table.
    pub name: String,
    /// Feix's types that it includes.
    pub includes: Vec<String>,
    pub category: Category,
    /// Definition in one sentence.
    pub definition: String,
    /// Limits of a search for grasps of this type.
    pub form: HandUse,
}

/// Errors of the taxonomy's data files, and of files of people's labels.
#[derive(Debug, thiserror::Error)]
pub enum TaxonomyError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{path}: {message}")]
    Format { path: PathBuf, message: String },
    /// Invalid value.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    Field { path: PathBuf, field: String, found: String, expected: String },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "type")]
    types: Vec<GraspType>,
}

/// The table of types.
#[derive(Debug, Clone, PartialEq)]
pub struct Taxonomy {
    /// Types in the table's order.
    pub types: Vec<GraspType>,
}

impl Taxonomy {
    /// Returns the paper's 19 types.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn paper() -> Self {
        Self::parse(include_str!("../data/types.toml"), Path::new("types.toml")).expect("the built-in types are valid")
    }

    /// Parses a table; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, TaxonomyError> {
        let File { types } = toml::from_str(text)
            .map_err(|error| TaxonomyError::Format { path: path.into(), message: error.to_string() })?;
        for (n, kind) in types.iter().enumerate() {
            if kind.form.digits.is_empty() {
                return Err(TaxonomyError::Field {
                    path: path.into(),
                    field: format!("type[{n}].form.digits"),
                    found: "none".into(),
                    expected: "at least one".into(),
                });
            }
            if types[..n].iter().any(|other| other.name == kind.name) {
                return Err(TaxonomyError::Field {
                    path: path.into(),
                    field: format!("type[{n}].name"),
                    found: format!("{:?} twice", kind.name),
                    expected: "unique names".into(),
                });
            }
        }
        Ok(Self { types })
    }

    /// Returns the index of the type called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.types.iter().position(|kind| kind.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The totals of the paper's table: 19 types from 31 of Feix's 33 (it leaves out Tripod Variation and Adduction Grip, and
    /// splits none), 10 power, 3 intermediate, 6 precision.
    #[test]
    fn totals_of_the_table() {
        let taxonomy = Taxonomy::paper();
        let count = |category| taxonomy.types.iter().filter(|kind| kind.category == category).count();
        assert_eq!(taxonomy.types.len(), 19);
        assert_eq!(Category::ALL.map(count), [10, 3, 6]);
        let mut included: Vec<&String> = taxonomy.types.iter().flat_map(|kind| &kind.includes).collect();
        assert_eq!(included.len(), 31);
        included.sort();
        included.dedup();
        assert_eq!(included.len(), 31, "no type is in two");
    }

    #[test]
    fn a_name_twice_is_refused() {
        let text = include_str!("../data/types.toml").replace("name = \"Ring\"", "name = \"Palmar\"");
        let error = Taxonomy::parse(&text, Path::new("t.toml")).expect_err("twice").to_string();
        assert!(error.contains("t.toml") && error.contains("Palmar") && error.contains("unique"), "{error}");
    }
}
