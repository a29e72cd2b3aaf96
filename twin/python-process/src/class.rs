//! A Python class: its file, its name, and the arguments of its constructor.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use ftac_platform::digest::sha256;
use ftac_platform::file::{MAX_TEXT_SIZE, read_regular};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::Role;

/// A class of a Python file, or a function that makes the object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PythonClass {
    pub file: PathBuf,
    pub class: String,
    /// SHA-256 of the file, hexadecimal: a run is continued with the same file only.
    pub sha256: String,
    /// Arguments of the constructor, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub arguments: BTreeMap<String, Value>,
}

/// A class that cannot be used, with the option that names it.
#[derive(Debug, thiserror::Error)]
pub enum ClassError {
    #[error("--{role}: found `{found}`, expected FILE.py:CLASS, such as {example}")]
    Name { role: &'static str, found: String, example: &'static str },
    #[error("--{role}-arg: found `{found}`, expected KEY=VALUE, such as weights=mine.pt or gain=0.5")]
    Argument { role: &'static str, found: String },
    #[error("--{role}-arg: found {name} twice, expected every name once")]
    Repeated { role: &'static str, name: String },
    #[error("--{role}: cannot read {}: {source}", file.display())]
    File { role: &'static str, file: PathBuf, source: io::Error },
    #[error("--{role} {}: found a file of SHA-256 {found}, expected {expected}, with which the run began", file.display())]
    Changed { role: &'static str, file: PathBuf, found: String, expected: String },
}

impl PythonClass {
    /// Parses `FILE.py:CLASS` and the arguments of the constructor, each `KEY=VALUE`.
    pub fn parse(role: Role, text: &str, arguments: &[String]) -> Result<Self, ClassError> {
        let parts = text.rsplit_once(':').filter(|(file, class)| !file.is_empty() && !class.is_empty());
        let Some((file, class)) = parts else {
            return Err(ClassError::Name { role: role.name(), found: text.to_owned(), example: role.example() });
        };
        let file = PathBuf::from(file);
        let mut by_name = BTreeMap::new();
        for text in arguments {
            let Some((name, value)) = parse_argument(text) else {
                return Err(ClassError::Argument { role: role.name(), found: text.clone() });
            };
            if by_name.insert(name.clone(), value).is_some() {
                return Err(ClassError::Repeated { role: role.name(), name });
            }
        }
        Ok(Self { sha256: file_digest(role, &file)?, file, class: class.to_owned(), arguments: by_name })
    }

    /// Checks that the file has not changed.
    pub fn check(&self, role: Role) -> Result<(), ClassError> {
        let found = file_digest(role, &self.file)?;
        if found != self.sha256 {
            return Err(ClassError::Changed {
                role: role.name(),
                file: self.file.clone(),
                found,
                expected: self.sha256.clone(),
            });
        }
        Ok(())
    }

    /// Describes the class with its arguments and the digest of its file.
    pub fn describe(&self) -> String {
        let arguments: String = self.arguments.iter().map(|(name, value)| format!(" {name}={value}")).collect();
        format!("{}{arguments}, SHA-256 {}", self.name(), self.sha256)
    }

    /// Returns `FILE.py:CLASS`.
    pub fn name(&self) -> String {
        format!("{}:{}", self.file.display(), self.class)
    }
}

/// Parses `KEY=VALUE`. A value that is valid JSON is read as such, any other as text.
fn parse_argument(text: &str) -> Option<(String, Value)> {
    let named = |name: &str| {
        let begins = |letter: char| letter.is_alphabetic() || letter == '_';
        name.starts_with(begins) && name.chars().all(|letter| letter.is_alphanumeric() || letter == '_')
    };
    let (name, value) = text.split_once('=').filter(|(name, _)| named(name))?;
    Some((name.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()))))
}

fn file_digest(role: Role, file: &Path) -> Result<String, ClassError> {
    let failed = |source| ClassError::File { role: role.name(), file: file.to_owned(), source };
    Ok(sha256(&read_regular(file, MAX_TEXT_SIZE).map_err(failed)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str, arguments: &[&str]) -> Result<PythonClass, ClassError> {
        let arguments: Vec<String> = arguments.iter().map(|text| (*text).to_owned()).collect();
        PythonClass::parse(Role::Policy, text, &arguments)
    }

    #[test]
    fn a_class_is_named_by_file_and_name_and_stays_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a:b.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let class = parse(&format!("{}:Mine", file.display()), &[]).unwrap();
        assert_eq!((class.file.as_path(), class.class.as_str()), (file.as_path(), "Mine"));
        class.check(Role::Policy).unwrap();
        std::fs::write(&file, "class Mine: pass").unwrap();
        let words = class.check(Role::Policy).unwrap_err().to_string();
        assert!(words.contains("with which the run began") && words.contains(&class.sha256), "{words}");
        for text in ["", "mine.py", ":Mine", "mine.py:"] {
            let words = parse(text, &[]).unwrap_err().to_string();
            assert!(words.contains(&format!("found `{text}`, expected FILE.py:CLASS")), "{words}");
        }
        let words = parse("/no/where.py:Mine", &[]).unwrap_err().to_string();
        assert!(words.starts_with("--policy: cannot read /no/where.py: "), "{words}");
    }

    #[test]
    fn arguments_are_json_or_text() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let parse = |arguments: &[&str]| parse(&format!("{}:Mine", file.display()), arguments);
        let class = parse(&["gain=0.5", "weights=a=b.pt", "deep=true", "name=\"7\"", "empty="]).unwrap();
        let expected = serde_json::json!({ "gain": 0.5, "weights": "a=b.pt", "deep": true, "name": "7", "empty": "" });
        assert_eq!(serde_json::to_value(&class.arguments).unwrap(), expected);
        for (arguments, words) in [
            (&["gain"][..], "found `gain`, expected KEY=VALUE"),
            (&["=1"], "found `=1`"),
            (&["a b=1"], "found `a b=1`"),
            (&["gain=1", "gain=2"], "found gain twice"),
        ] {
            let error = parse(arguments).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
