//! Source of the external policy in a run: its file, its class, and the passage of simulated time while it computes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use ftac_platform::digest::sha256;
use ftac_platform::file::{MAX_TEXT_SIZE, read_regular};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Passage of simulated time while a policy computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SimulatedTimePassage {
    /// No simulated time passes: results are repeatable.
    #[default]
    #[serde(alias = "stand")]
    Paused,
    /// As much simulated time passes as real time: results depend on the computer.
    Wall,
}

/// Origin of a policy.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicySource {
    pub file: PathBuf,
    pub class: String,
    /// SHA-256 of the file, hexadecimal: a run is continued with the same policy only.
    pub sha256: String,
    #[serde(default)]
    pub pace: SimulatedTimePassage,
    /// Arguments of the class, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub arguments: BTreeMap<String, Value>,
    /// Time limit of an answer, s.
    #[serde(default = "timeout", skip_serializing_if = "is_usual")]
    pub timeout: u32,
}

/// Default time limit of an answer, s.
pub const DEFAULT_TIMEOUT: u32 = 60;

fn timeout() -> u32 {
    DEFAULT_TIMEOUT
}

fn is_usual(timeout: &u32) -> bool {
    *timeout == DEFAULT_TIMEOUT
}

impl PolicySource {
    /// Parses `FILE.py:CLASS` and the arguments of the class, each `KEY=VALUE`.
    pub fn parse(text: &str, arguments: &[String], pace: SimulatedTimePassage) -> Result<Self> {
        let parts = text.rsplit_once(':').filter(|(file, class)| !file.is_empty() && !class.is_empty());
        let Some((file, class)) = parts else {
            bail!("--policy: found `{text}`, expected FILE.py:CLASS, such as my_policy.py:MyPolicy");
        };
        let file = PathBuf::from(file);
        let mut by_name = BTreeMap::new();
        for text in arguments {
            let (name, value) = parse_argument(text)?;
            if by_name.insert(name.clone(), value).is_some() {
                bail!("--policy-arg: found {name} twice, expected every name once");
            }
        }
        let (sha256, class) = (file_digest(&file)?, class.to_owned());
        Ok(Self { sha256, file, class, pace, arguments: by_name, timeout: DEFAULT_TIMEOUT })
    }

    /// Checks that the file has not changed.
    pub fn check(&self) -> Result<()> {
        let found = file_digest(&self.file)?;
        if found != self.sha256 {
            bail!(
                "--policy {}: found a file of SHA-256 {found}, expected {}, with which the run began",
                self.file.display(),
                self.sha256
            );
        }
        Ok(())
    }
}

/// Parses `KEY=VALUE`. A value that is valid JSON is read as such, any other as text.
fn parse_argument(text: &str) -> Result<(String, Value)> {
    let named = |name: &str| {
        let begins = |letter: char| letter.is_alphabetic() || letter == '_';
        name.starts_with(begins) && name.chars().all(|letter| letter.is_alphanumeric() || letter == '_')
    };
    match text.split_once('=').filter(|(name, _)| named(name)) {
        Some((name, value)) => {
            Ok((name.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()))))
        }
        None => bail!("--policy-arg: found `{text}`, expected KEY=VALUE, such as weights=mine.pt or gain=0.5"),
    }
}

fn file_digest(file: &Path) -> Result<String> {
    let bytes =
        read_regular(file, MAX_TEXT_SIZE).with_context(|| format!("--policy: cannot read {}", file.display()))?;
    Ok(sha256(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_policy_is_named_by_file_and_class_and_stays_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a:b.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let source =
            PolicySource::parse(&format!("{}:Mine", file.display()), &[], SimulatedTimePassage::Paused).unwrap();
        assert_eq!((source.file.as_path(), source.class.as_str()), (file.as_path(), "Mine"));
        source.check().unwrap();
        std::fs::write(&file, "class Mine: pass").unwrap();
        let words = source.check().unwrap_err().to_string();
        assert!(words.contains("with which the run began") && words.contains(&source.sha256), "{words}");
        for text in ["", "mine.py", ":Mine", "mine.py:"] {
            let words = PolicySource::parse(text, &[], SimulatedTimePassage::Paused).unwrap_err().to_string();
            assert!(words.contains(&format!("found `{text}`, expected FILE.py:CLASS")), "{words}");
        }
        let words =
            format!("{:#}", PolicySource::parse("/no/where.py:Mine", &[], SimulatedTimePassage::Paused).unwrap_err());
        assert!(words.contains("cannot read /no/where.py"), "{words}");
    }

    #[test]
    fn a_policy_s_arguments_are_json_or_text() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let parse = |arguments: &[&str]| {
            let arguments: Vec<String> = arguments.iter().map(|text| (*text).to_owned()).collect();
            PolicySource::parse(&format!("{}:Mine", file.display()), &arguments, SimulatedTimePassage::Paused)
        };
        let source = parse(&["gain=0.5", "weights=a=b.pt", "deep=true", "name=\"7\"", "empty="]).unwrap();
        let expected = serde_json::json!({ "gain": 0.5, "weights": "a=b.pt", "deep": true, "name": "7", "empty": "" });
        assert_eq!(serde_json::to_value(&source.arguments).unwrap(), expected);
        for (arguments, words) in [
            (&["gain"][..], "found `gain`, expected KEY=VALUE"),
            (&["=1"], "found `=1`"),
            (&["a b=1"], "found `a b=1`"),
            (&["gain=1", "gain=2"], "found gain twice"),
        ] {
            let error = parse(arguments).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        // Text from before there were arguments describes the same run.
        let text = serde_json::to_string(&parse(&[]).unwrap()).unwrap();
        assert!(!text.contains("arguments") && !text.contains("timeout"), "{text}");
        let read: PolicySource = serde_json::from_str(&text).unwrap();
        assert_eq!((read.timeout, serde_json::to_string(&read).unwrap()), (DEFAULT_TIMEOUT, text));
    }
}
