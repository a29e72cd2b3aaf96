//! A taxonomy of 19 grasp types: the GRASP taxonomy's 33 types (Feix et al. 2016), merged where hand and opposition are the
//! same, as in the F-TAC Hand's paper. The table is data (`data/types.toml`). [`attributes`] measures a held grasp, and
//! [`rules`] decides on its type.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use serde::{Deserialize, Serialize};

use crate::synthesis::hand_use::HandUse;

pub mod attributes;
pub mod rules;

/// Feix's three broad kinds of grasps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
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

    /// Returns the name: `power`, `intermediate` or `precision`.
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
    /// Power, intermediate or precision.
    pub category: Category,
    /// Definition in one sentence.
    pub definition: String,
    /// Limits of a search for grasps of this type.
    pub form: HandUse,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "type")]
    types: Vec<GraspType>,
}

/// The table of types.
///
/// ```
/// use dexterous_grasping::taxonomy::{Category, Taxonomy};
///
/// let taxonomy = Taxonomy::paper();
/// let hook = taxonomy.find("Fixed Hook").expect("a type of the table");
/// assert_eq!(taxonomy.types[hook].category, Category::Power);
/// ```
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
    ///
    /// # Errors
    /// [`DataError`] for a text that is not TOML, an unknown or missing field, a type without digits, or two types of
    /// the same name.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let File { types } = parse_toml(text, path)?;
        for (n, kind) in types.iter().enumerate() {
            if kind.form.digits.is_empty() {
                return Err(DataError::field(path, format!("type[{n}].form.digits"), "none", "at least one"));
            }
            if types[..n].iter().any(|other| other.name == kind.name) {
                let found = format!("{:?} twice", kind.name);
                return Err(DataError::field(path, format!("type[{n}].name"), found, "unique names"));
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
