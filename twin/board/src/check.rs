//! Verification of an entry by its own content: hashes, checks of lines, shares and comparisons.

use std::collections::BTreeSet;
use std::path::Path;

use ftac_platform::DataError;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::entry::BoardEntry;
use crate::error::BoardError;
use crate::outcomes::{line_check, outcomes_digest};
use crate::shares::{comparisons, shares};

/// Largest difference of two numbers that count as equal: intervals contain functions whose last bits depend on the
/// platform.
const TOLERANCE: f64 = 1e-9;

/// A value of an entry that does not follow from the rest, or from a trial that was run again.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
pub struct Difference {
    /// Field of the entry, with the trial if it belongs to one.
    pub field: String,
    /// Value in the entry.
    pub found: String,
    /// Expected value.
    pub expected: String,
}

impl Difference {
    pub(crate) fn new(field: impl Into<String>, found: impl ToString, expected: impl ToString) -> Self {
        Self { field: field.into(), found: found.to_string(), expected: expected.to_string() }
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}: found {}, expected {}", self.field, self.found, self.expected)
    }
}

/// Returns every difference of an entry from its own outcomes and settings; `path` is used in errors only.
pub fn verify(entry: &BoardEntry, path: &Path) -> Result<Vec<Difference>, BoardError> {
    let mut differences = Vec::new();
    let mut compare = |field: &str, found: &str, expected: &str| {
        if found != expected {
            differences.push(Difference::new(field, found, expected));
        }
    };
    for line in entry.lines(path)? {
        compare(&format!("{}: check", line.place), &line.check, &line_check(&line.place, &line.outcome));
    }
    let outcomes = entry.outcome_map(path)?;
    let own = entry.policy.condition;
    compare("hashes.outcomes", &entry.hashes.outcomes, &outcomes_digest(&outcomes, own));
    // The text of the benchmark's scenario is the program's: see `uses_scenario_of_this_program`.
    if entry.settings.scenario.is_some() {
        compare("hashes.scenario", &entry.hashes.scenario, &entry.settings.scenario_digest());
    }
    compare("hashes.settings", &entry.hashes.settings, &entry.settings.digest(&entry.hashes.scenario)?);
    let size = (entry.work.combinations, entry.work.trials);
    if let Some(seed) = entry.work.seeds.first() {
        let request = entry.settings.to_request(*seed, size, &entry.conditions());
        request.check(path)?;
        let robot = request.robot_model(path).map_err(BoardError::Run)?;
        compare("settings.robot_model", &entry.settings.robot_model, &robot.name);
    }
    let missing = || DataError::field(path, "outcomes", "no trial", format!("trials of {own}"));
    let expected = shares(&outcomes, own).ok_or_else(missing)?;
    walk("shares", &serde_json::to_value(&entry.shares)?, &serde_json::to_value(expected)?, &mut differences);
    let expected = serde_json::to_value(comparisons(&outcomes, own))?;
    walk("comparisons", &serde_json::to_value(&entry.comparisons)?, &expected, &mut differences);
    Ok(differences)
}

/// True if trials of the entry can be run again: its scenario is in its file, or is the benchmark's of this program.
pub fn uses_scenario_of_this_program(entry: &BoardEntry) -> bool {
    entry.hashes.scenario == entry.settings.scenario_digest()
}

/// Collects the leaves in which two values differ.
fn walk(field: &str, found: &Value, expected: &Value, into: &mut Vec<Difference>) {
    match (found, expected) {
        (Value::Object(ours), Value::Object(theirs)) => {
            let names: BTreeSet<&String> = ours.keys().chain(theirs.keys()).collect();
            for name in names {
                let value = |of: &serde_json::Map<String, Value>| of.get(name).cloned().unwrap_or(Value::Null);
                walk(&format!("{field}.{name}"), &value(ours), &value(theirs), into);
            }
        }
        (Value::Array(ours), Value::Array(theirs)) => {
            for n in 0..ours.len().max(theirs.len()) {
                let value = |of: &[Value]| of.get(n).cloned().unwrap_or(Value::Null);
                walk(&format!("{field}[{n}]"), &value(ours), &value(theirs), into);
            }
        }
        (Value::Number(ours), Value::Number(theirs)) => {
            let equal = ours.as_f64().zip(theirs.as_f64()).is_some_and(|(a, b)| (a - b).abs() <= TOLERANCE);
            if !equal {
                into.push(Difference::new(field, ours, theirs));
            }
        }
        (ours, theirs) if ours != theirs => into.push(Difference::new(field, text(ours), text(theirs))),
        _ => {}
    }
}

fn text(value: &Value) -> String {
    if value.is_null() { "nothing".to_owned() } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::add::tests::touch_entry;

    /// Returns the differences of the entry whose text has `to` in place of `from`.
    fn differences(from: &str, to: &str) -> Vec<String> {
        let text = touch_entry().to_text().expect("text");
        assert!(text.contains(from), "{from} is not in {text}");
        let path = Path::new("row.toml");
        let entry = BoardEntry::parse(&text.replacen(from, to, 1), path).expect("an entry");
        verify(&entry, path).expect("verified").iter().map(ToString::to_string).collect()
    }

    #[test]
    fn an_entry_as_made_is_in_order() {
        assert_eq!(differences("Touch", "Another name"), Vec::<String>::new());
    }

    /// A changed outcome is named by its trial; the hash and the shares that it would improve are named too.
    #[test]
    fn a_changed_outcome_is_named() {
        let found = differences("\n0 0 contact 15 ", "\n0 0 clean 15 ");
        assert!(found[0].starts_with("seed 1, combination 0, trial 0, touch: check: found "), "{found:?}");
        for field in
            ["hashes.outcomes", "shares.clean.count: found 11, expected 12", "comparisons[0].lost: found 1, expected 0"]
        {
            assert!(found.iter().any(|line| line.starts_with(field)), "{field}: {found:?}");
        }
        let slower = differences("\n0 0 contact 15 ", "\n0 0 contact 14 ");
        assert!(slower.iter().any(|line| line.starts_with("shares.trial_s: found ")), "{slower:?}");
    }

    #[test]
    fn changed_hashes_shares_and_settings_are_named() {
        let entry = touch_entry();
        for (from, to, field) in [
            (entry.hashes.outcomes.as_str(), "0", "hashes.outcomes: found 0"),
            (entry.hashes.settings.as_str(), "0", "hashes.settings: found 0"),
            (entry.hashes.scenario.as_str(), "0", "hashes.settings: found"),
            ("noise_scale = 1.0", "noise_scale = 0.5", "hashes.settings: found"),
            ("count = 11", "count = 12", "shares.clean.count: found 12, expected 11"),
            ("strongest = true", "strongest = false", "comparisons[0].strongest: found false, expected true"),
            ("robot_model = \"", "robot_model = \"my ", "settings.robot_model: found my "),
        ] {
            let found = differences(from, to);
            assert!(found.iter().any(|line| line.contains(field)), "{field}: {found:?}");
        }
    }

    /// A number that differs in its last bits is the same.
    #[test]
    fn last_bits_do_not_count() {
        let mut entry = touch_entry();
        entry.shares.clean.low += 1e-12;
        assert_eq!(verify(&entry, Path::new("row.toml")).expect("verified"), []);
        entry.shares.clean.low += 1e-6;
        assert_eq!(verify(&entry, Path::new("row.toml")).expect("verified").len(), 1);
    }
}
