//! The file of a row: an entry in TOML. Its schema has a version, and unknown fields are refused.

use std::collections::BTreeMap;
use std::path::Path;

use external_policy::DecisionLevel;
use ftac_platform::DataError;
use ftac_platform::data::{parse_toml, read_text};
use scenarios::record::Condition;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::BoardError;
use crate::outcomes::{LineError, OutcomeLine, Outcomes, parse_rows};
use crate::settings::Settings;
use crate::shares::{Comparison, Shares};

/// Version of the schema that this program reads and writes.
pub const SCHEMA: u32 = 1;
/// Longest name of a row, characters.
const MAX_NAME: usize = 60;
/// Longest text of another field of a row, characters.
const MAX_TEXT: usize = 300;
/// Largest number of outcomes of an entry.
const MAX_OUTCOMES: usize = 1_000_000;
/// Largest effort of the verification of grasp pairs, as on the command line of `bench`: it sets the time of a repetition.
const MAX_EFFORT: u32 = 9;
/// First lines of a file.
const PREAMBLE: &str = "# A row of the board. `ftac board check FILE` verifies it.\n";

/// Use of the seeds before the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeedUse {
    /// The policy was developed on these seeds, or may have been.
    Development,
    /// The seeds were not used before.
    HeldOut,
}

impl SeedUse {
    /// Returns the words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::Development => "development",
            Self::HeldOut => "held out",
        }
    }
}

/// Kind of a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PolicyKind {
    /// Part of the program.
    BuiltIn,
    /// A class of a Python file.
    Python,
}

impl PolicyKind {
    /// Returns the words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::BuiltIn => "built-in",
            Self::Python => "Python",
        }
    }
}

/// Policy of a row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyFacts {
    pub kind: PolicyKind,
    /// Condition of its trials in the run.
    pub condition: Condition,
    /// Level of its decisions. A built-in policy chooses: the motion is the controller's.
    pub level: DecisionLevel,
    /// True if it gets tactile images.
    pub sees_images: bool,
    /// Side of the images of a policy that acts, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image_side: Option<usize>,
    /// Name of the Python file, without its folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Class of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// SHA-256 of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Arguments of the class, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub arguments: BTreeMap<String, Value>,
    /// SHA-256 of the files that arguments name, by the argument's name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub argument_files: BTreeMap<String, String>,
}

/// Program that ran the trials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramFacts {
    pub version: String,
    /// Commit of the source tree, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// Processor, cores, operating system.
    pub machine: String,
}

/// Trials of a row: every seed has `trials` trials of each combination.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Work {
    pub seeds: Vec<u64>,
    pub seed_use: SeedUse,
    /// Number of combinations.
    pub combinations: usize,
    /// Trials of a combination under one seed.
    pub trials: usize,
}

/// Hashes (SHA-256, hexadecimal) of an entry.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hashes {
    /// Hash of the scenario's text.
    pub scenario: String,
    /// Hash of all settings: [`Settings::digest`].
    pub settings: String,
    /// Hash of all outcomes: [`crate::outcomes::outcomes_digest`].
    pub outcomes: String,
}

/// Outcomes of one seed under one condition.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutcomeTable {
    pub seed: u64,
    pub condition: Condition,
    /// Lines: see [`crate::outcomes`].
    pub rows: String,
}

/// A row of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardEntry {
    /// Version of the schema.
    pub schema: u32,
    /// Name of the row.
    pub name: String,
    /// Author of the policy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Page about the policy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub link: Option<String>,
    pub policy: PolicyFacts,
    pub program: ProgramFacts,
    pub work: Work,
    pub settings: Settings,
    pub hashes: Hashes,
    pub shares: Shares,
    /// Paired comparisons with other policies of the same runs.
    #[serde(default)]
    pub comparisons: Vec<Comparison>,
    /// Outcomes of the row's policy and of the others of the same runs.
    pub outcomes: Vec<OutcomeTable>,
}

/// Schema version of a file that may be newer.
#[derive(Deserialize)]
struct Versioned {
    schema: u32,
}

impl BoardEntry {
    /// Reads the entry at `path`.
    ///
    /// # Errors
    /// Fails for a file of another schema, or with a field that is unknown, missing, or unusable by itself. Hashes and
    /// shares are not compared with the outcomes: see [`crate::verify`].
    pub fn read(path: &Path) -> Result<Self, DataError> {
        Self::parse(&read_text(path)?, path)
    }

    /// Parses the text of an entry; `path` is used in errors only.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let Versioned { schema } = parse_toml(text, path)?;
        if schema != SCHEMA {
            return Err(DataError::field(path, "schema", schema, format!("{SCHEMA}, which this program reads")));
        }
        let entry: Self = parse_toml(text, path)?;
        entry.validate(path)?;
        Ok(entry)
    }

    /// Returns the text of the file.
    pub fn to_text(&self) -> Result<String, BoardError> {
        Ok(format!("{PREAMBLE}{}", toml::to_string_pretty(self)?))
    }

    /// Checks every field by itself; `path` is used in errors only.
    pub fn validate(&self, path: &Path) -> Result<(), DataError> {
        check_text(path, "name", &self.name, MAX_NAME)?;
        for (field, text) in [("by", &self.by), ("link", &self.link)] {
            if let Some(text) = text {
                check_text(path, field, text, MAX_TEXT)?;
            }
        }
        if let Some(link) = self.link.as_ref().filter(|link| !is_web_address(link)) {
            return Err(DataError::field(path, "link", link, "an address that begins with https:// or http://"));
        }
        check_text(path, "program.version", &self.program.version, MAX_TEXT)?;
        let own = self.policy.condition;
        let external = own == Condition::External;
        if own == Condition::Ideal || external != (self.policy.kind == PolicyKind::Python) {
            let expected = "external for a Python policy, blind, reflex or touch for a built-in one";
            return Err(DataError::field(path, "policy.condition", own, expected));
        }
        if external && (self.policy.file.is_none() || self.policy.class.is_none() || self.policy.sha256.is_none()) {
            return Err(DataError::field(path, "policy", "a Python policy", "its file, class and sha256"));
        }
        if let Some(effort) = self.settings.effort.filter(|effort| *effort > MAX_EFFORT) {
            return Err(DataError::field(path, "settings.effort", effort, format!("0 to {MAX_EFFORT}")));
        }
        self.validate_work(path)?;
        self.lines(path).map(|_| ())
    }

    fn validate_work(&self, path: &Path) -> Result<(), DataError> {
        let Work { seeds, combinations, trials, .. } = &self.work;
        if seeds.is_empty() || !seeds.is_sorted_by(|a, b| a < b) {
            return Err(DataError::field(path, "work.seeds", format!("{seeds:?}"), "seeds in rising order"));
        }
        let tables = self.outcomes.len().max(1);
        let count = combinations.checked_mul(*trials).and_then(|count| count.checked_mul(tables));
        if !count.is_some_and(|count| (1..=MAX_OUTCOMES).contains(&count)) {
            let found = format!("{combinations} combinations x {trials} trials");
            return Err(DataError::field(path, "work", found, format!("1 to {MAX_OUTCOMES} outcomes")));
        }
        let mut expected: Vec<(u64, Condition)> = Vec::new();
        let conditions = self.conditions();
        for seed in seeds {
            expected.extend(conditions.iter().map(|condition| (*seed, *condition)));
        }
        let found: Vec<(u64, Condition)> = self.outcomes.iter().map(|table| (table.seed, table.condition)).collect();
        let names = |tables: &[(u64, Condition)]| {
            let names: Vec<String> = tables.iter().map(|(seed, condition)| format!("{condition} {seed}")).collect();
            names.join(", ")
        };
        if found != expected || !conditions.contains(&self.policy.condition) {
            let expected = format!("{}, with {}", names(&expected), self.policy.condition);
            return Err(DataError::field(path, "outcomes", names(&found), expected));
        }
        Ok(())
    }

    /// Returns the conditions with outcomes, in order.
    pub fn conditions(&self) -> Vec<Condition> {
        let mut all: Vec<Condition> = self.outcomes.iter().map(|table| table.condition).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Parses all lines of the outcomes, in order.
    pub fn lines(&self, path: &Path) -> Result<Vec<OutcomeLine>, DataError> {
        let mut all = Vec::new();
        for (n, table) in self.outcomes.iter().enumerate() {
            let OutcomeTable { seed, condition, rows } = table;
            let size = (self.work.combinations, self.work.trials);
            let lines = parse_rows(rows, (*seed, *condition), size).map_err(|error| {
                let LineError { line, found, expected } = error;
                let field = format!("outcomes[{n}] (seed {seed}, {condition}), line {line}");
                DataError::field(path, field, format!("`{}`", excerpt(&found)), expected)
            })?;
            all.extend(lines);
        }
        Ok(all)
    }

    /// Returns the outcomes by place.
    pub fn outcome_map(&self, path: &Path) -> Result<Outcomes, DataError> {
        Ok(self.lines(path)?.into_iter().map(|line| (line.place, line.outcome)).collect())
    }
}

/// Returns the first characters of a line.
fn excerpt(line: &str) -> String {
    line.chars().take(MAX_NAME).collect()
}

fn is_web_address(link: &str) -> bool {
    let rest = link.strip_prefix("https://").or_else(|| link.strip_prefix("http://"));
    rest.is_some_and(|rest| !rest.is_empty()) && !link.contains(|letter: char| letter.is_whitespace())
}

fn check_text(path: &Path, field: &str, text: &str, most: usize) -> Result<(), DataError> {
    let length = text.chars().count();
    if text.trim().is_empty() || text.contains(char::is_control) || length > most {
        return Err(DataError::field(
            path,
            field,
            format!("`{}`", excerpt(text)),
            format!("a line of 1 to {most} characters"),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::add::tests::touch_entry;

    fn error(text: &str) -> String {
        BoardEntry::parse(text, Path::new("row.toml")).expect_err("refused").to_string()
    }

    #[test]
    fn an_entry_comes_back() {
        let entry = touch_entry();
        let text = entry.to_text().expect("text");
        assert_eq!(BoardEntry::parse(&text, Path::new("row.toml")).expect("an entry"), entry);
        assert!(text.contains("\nname = \"Touch\"\n") && text.contains("\n0 0 contact 15 "), "{text}");
    }

    #[test]
    fn bad_files_name_the_field() {
        let text = touch_entry().to_text().expect("text");
        for (from, to, words) in [
            ("schema = 1", "schema = 2", "row.toml: schema: found 2, expected 1"),
            ("name = \"Touch\"", "name = \" \"", "row.toml: name: found ` `, expected a line of 1 to 60 characters"),
            ("name = \"Touch\"", "name = 3", "invalid type: integer `3`, expected a string"),
            ("name = \"Touch\"", "label = \"Touch\"", "`label`: unknown field `label`"),
            ("link = \"https://", "link = \"file://", "row.toml: link: found file://"),
            ("kind = \"built_in\"", "kind = \"python\"", "row.toml: policy.condition: found touch"),
            (
                "look_ahead = false",
                "look_ahead = false\neffort = 99",
                "row.toml: settings.effort: found 99, expected 0 to 9",
            ),
            ("seeds = [1]", "seeds = [1, 1]", "row.toml: work.seeds: found [1, 1]"),
            ("combinations = 6", "combinations = 7", "row.toml: outcomes[0] (seed 1, blind), line 14: found `nothing`"),
            ("combinations = 6", "combinations = 600000000", "row.toml: work: found 600000000"),
            ("condition = \"blind\"", "condition = \"touch\"", "row.toml: outcomes: found touch 1, touch 1"),
        ] {
            assert!(text.contains(from), "{from} is not in {text}");
            let error = error(&text.replacen(from, to, 1));
            assert!(error.contains(words), "{error}");
        }
        assert!(error("name = ").contains("row.toml:1: found no TOML"));
    }
}
