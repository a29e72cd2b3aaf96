//! Source of the external policy in a run: its file, its class, and the passage of simulated time while it computes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use python_process::{ClassError, PythonClass, Role};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::server::PolicyIntroduction;

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
    /// Introduction of the policy at the start of the run; none in runs of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub introduction: Option<PolicyIntroduction>,
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
    pub fn parse(text: &str, arguments: &[String], pace: SimulatedTimePassage) -> Result<Self, ClassError> {
        let PythonClass { file, class, sha256, arguments } = PythonClass::parse(Role::Policy, text, arguments)?;
        Ok(Self { file, class, sha256, pace, arguments, timeout: DEFAULT_TIMEOUT, introduction: None })
    }

    /// Returns the class of the policy.
    pub fn python_class(&self) -> PythonClass {
        let Self { file, class, sha256, arguments, .. } = self.clone();
        PythonClass { file, class, sha256, arguments }
    }

    /// Checks that the file has not changed.
    pub fn check(&self) -> Result<(), ClassError> {
        self.python_class().check(Role::Policy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text from before there were arguments describes the same run.
    #[test]
    fn usual_values_are_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let name = format!("{}:Mine", file.display());
        let source = PolicySource::parse(&name, &[], SimulatedTimePassage::Paused).unwrap();
        let text = serde_json::to_string(&source).unwrap();
        assert!(!text.contains("arguments") && !text.contains("timeout") && !text.contains("introduction"), "{text}");
        let read: PolicySource = serde_json::from_str(&text).unwrap();
        assert_eq!((read.timeout, serde_json::to_string(&read).unwrap()), (DEFAULT_TIMEOUT, text));
    }
}
