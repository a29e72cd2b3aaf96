//! Outcomes of trials as lines of text: the part of an entry from which all its shares follow.
//!
//! A line has the columns of [`HEADING`]. `outcome` is one of four words, `seconds` is the duration of the trial with all
//! its digits, `record` identifies the whole record of the trial, and `check` identifies the line.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ftac_platform::digest::sha256;
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::FailureCause;

/// First line of a table of outcomes.
pub const HEADING: &str = "combination trial outcome seconds record check";
/// Number of hexadecimal digits of the SHA-256 of a record.
const RECORD_DIGITS: usize = 16;
/// Number of hexadecimal digits of the SHA-256 of a line.
const CHECK_DIGITS: usize = 8;

/// Result of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutcomeKind {
    /// Success without any unwanted contact.
    Clean,
    /// Success after an unwanted contact.
    Contact,
    /// Failure without any unwanted contact.
    Failed,
    /// Failure and an unwanted contact.
    FailedContact,
}

impl OutcomeKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Clean, Self::Contact, Self::Failed, Self::FailedContact];

    /// Returns the word in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Contact => "contact",
            Self::Failed => "failed",
            Self::FailedContact => "failed_contact",
        }
    }

    /// True if all objects were held at the end.
    pub fn is_success(self) -> bool {
        matches!(self, Self::Clean | Self::Contact)
    }

    /// True if there was an unwanted contact.
    pub fn has_contact(self) -> bool {
        matches!(self, Self::Contact | Self::FailedContact)
    }

    /// True for a success without any unwanted contact.
    pub fn is_clean(self) -> bool {
        self == Self::Clean
    }

    fn parse(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == word)
    }
}

/// Place of an outcome in a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OutcomePlace {
    /// Seed of the run.
    pub seed: u64,
    /// Policy of the trial.
    pub condition: Condition,
    /// Number of the combination.
    pub combination: usize,
    /// Number of the trial within its combination.
    pub trial: usize,
}

impl std::fmt::Display for OutcomePlace {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { seed, condition, combination, trial } = self;
        write!(formatter, "seed {seed}, combination {combination}, trial {trial}, {condition}")
    }
}

/// Outcome of one trial under one policy.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedOutcome {
    /// Result of the trial.
    pub kind: OutcomeKind,
    /// Simulated duration of the trial, s.
    pub seconds: f64,
    /// First digits of the SHA-256 of the trial's record: see [`record_digest`].
    pub record: String,
}

/// Outcomes by place.
pub type Outcomes = BTreeMap<OutcomePlace, RecordedOutcome>;

impl RecordedOutcome {
    /// Makes the outcome of a record.
    pub fn from_record(record: &TrialRecord) -> Result<Self, OutcomeError> {
        let kind = match (record.success, record.contact) {
            (true, false) => OutcomeKind::Clean,
            (true, true) => OutcomeKind::Contact,
            (false, false) => OutcomeKind::Failed,
            (false, true) => OutcomeKind::FailedContact,
        };
        if kind.is_clean() != record.clean_success || !record.sim_seconds.is_finite() {
            let (clean, seconds) = (record.clean_success, record.sim_seconds);
            return Err(OutcomeError::Contradiction { clean, kind, seconds });
        }
        Ok(Self { kind, seconds: record.sim_seconds, record: record_digest(record)? })
    }
}

/// Reason for which a record has no outcome.
#[derive(Debug, thiserror::Error)]
pub enum OutcomeError {
    /// The columns of the record contradict each other.
    #[error("clean_success = {clean} in a trial that is `{}` after {seconds} s", kind.name())]
    Contradiction {
        /// Value of `clean_success`.
        clean: bool,
        /// Result by the columns `success` and `contact`.
        kind: OutcomeKind,
        /// Duration of the trial, s.
        seconds: f64,
    },
    /// The record cannot be written as JSON.
    #[error("a record that is no JSON: {0}")]
    Json(#[from] serde_json::Error),
}

/// Returns the first digits of the SHA-256 of a record as JSON, without the columns that differ between repetitions:
/// the wall-clock time of decisions, and the reason of a policy that failed, which contains paths of its files.
pub fn record_digest(record: &TrialRecord) -> Result<String, serde_json::Error> {
    let failed = record.cause == Some(FailureCause::PolicyFailed);
    let reason = if failed { String::new() } else { record.reason.clone() };
    let kept = TrialRecord { decision_ms: None, reason, ..record.clone() };
    Ok(sha256(&serde_json::to_vec(&kept)?)[..RECORD_DIGITS].to_owned())
}

/// Returns the canonical text of an outcome, on which its check and the hash of all outcomes are computed.
fn canonical(place: &OutcomePlace, outcome: &RecordedOutcome) -> String {
    let OutcomePlace { seed, condition, combination, trial } = place;
    let RecordedOutcome { kind, seconds, record } = outcome;
    format!("{seed} {condition} {combination} {trial} {} {seconds} {record}", kind.name())
}

/// Returns the check of a line.
pub fn line_check(place: &OutcomePlace, outcome: &RecordedOutcome) -> String {
    sha256(canonical(place, outcome).as_bytes())[..CHECK_DIGITS].to_owned()
}

/// Returns the SHA-256 of the name of the row's condition and the canonical lines of all outcomes, in order.
pub fn outcomes_digest(outcomes: &Outcomes, own: Condition) -> String {
    let lines =
        outcomes.iter().fold(format!("{own}\n"), |text, (place, outcome)| text + &canonical(place, outcome) + "\n");
    sha256(lines.as_bytes())
}

/// Writes the table of the outcomes of one seed and condition.
pub fn write_rows(outcomes: &Outcomes, seed: u64, condition: Condition) -> String {
    let mut text = format!("{HEADING}\n");
    for (place, outcome) in outcomes.iter().filter(|(place, _)| (place.seed, place.condition) == (seed, condition)) {
        let OutcomePlace { combination, trial, .. } = place;
        let RecordedOutcome { kind, seconds, record } = outcome;
        let _ =
            writeln!(text, "{combination} {trial} {} {seconds} {record} {}", kind.name(), line_check(place, outcome));
    }
    text
}

/// A line of a table of outcomes.
#[derive(Debug, Clone, PartialEq)]
pub struct OutcomeLine {
    /// Place of the outcome.
    pub place: OutcomePlace,
    /// The outcome.
    pub outcome: RecordedOutcome,
    /// Last column.
    pub check: String,
}

/// A line that is no outcome.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineError {
    /// Number of the line in the table, from 1.
    pub line: usize,
    /// Content of the line.
    pub found: String,
    /// Expected content.
    pub expected: String,
}

/// Parses a table that must hold `trials` outcomes of each of `combinations`, in order.
pub fn parse_rows(
    text: &str,
    (seed, condition): (u64, Condition),
    (combinations, trials): (usize, usize),
) -> Result<Vec<OutcomeLine>, LineError> {
    let mut lines = (1..).zip(text.lines());
    let wrong = |line: usize, found: &str, expected: String| LineError { line, found: found.to_owned(), expected };
    match lines.next() {
        Some((_, HEADING)) => {}
        other => return Err(wrong(1, other.map_or("nothing", |(_, line)| line), format!("`{HEADING}`"))),
    }
    let mut rows = Vec::new();
    for combination in 0..combinations {
        for trial in 0..trials {
            let place = OutcomePlace { seed, condition, combination, trial };
            let (number, line) = lines.next().unwrap_or((rows.len() + 2, "nothing"));
            let row = parse_line(line, place)
                .ok_or_else(|| wrong(number, line, format!("combination {combination}, trial {trial}: {HEADING}")))?;
            rows.push(row);
        }
    }
    match lines.next() {
        None => Ok(rows),
        Some((number, line)) => Err(wrong(number, line, format!("the end after {} outcomes", rows.len()))),
    }
}

fn parse_line(line: &str, place: OutcomePlace) -> Option<OutcomeLine> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [combination, trial, kind, seconds, record, check] = words[..] else { return None };
    if (combination.parse().ok()?, trial.parse().ok()?) != (place.combination, place.trial) {
        return None;
    }
    let seconds: f64 = seconds.parse().ok().filter(|seconds: &f64| seconds.is_finite() && *seconds >= 0.0)?;
    let digits = |text: &str, count: usize| text.len() == count && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !digits(record, RECORD_DIGITS) || !digits(check, CHECK_DIGITS) {
        return None;
    }
    let outcome = RecordedOutcome { kind: OutcomeKind::parse(kind)?, seconds, record: record.to_owned() };
    Some(OutcomeLine { place, outcome, check: check.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_runs::record;

    fn outcomes() -> Outcomes {
        let mut all = Outcomes::new();
        for (combination, trial) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let place = OutcomePlace { seed: 3, condition: Condition::Touch, combination, trial };
            let record = record(combination, trial, Condition::Touch, trial == 0, combination == 1);
            all.insert(place, RecordedOutcome::from_record(&record).expect("an outcome"));
        }
        all
    }

    #[test]
    fn a_table_comes_back_bit_for_bit() {
        let all = outcomes();
        let text = write_rows(&all, 3, Condition::Touch);
        let rows = parse_rows(&text, (3, Condition::Touch), (2, 2)).expect("rows");
        let read: Outcomes = rows.iter().map(|row| (row.place, row.outcome.clone())).collect();
        assert_eq!(read, all);
        assert_eq!(outcomes_digest(&read, Condition::Touch), outcomes_digest(&all, Condition::Touch));
        assert_ne!(outcomes_digest(&all, Condition::Blind), outcomes_digest(&all, Condition::Touch));
        assert!(rows.iter().all(|row| row.check == line_check(&row.place, &row.outcome)));
        let kinds: Vec<&str> = rows.iter().map(|row| row.outcome.kind.name()).collect();
        assert_eq!(kinds, ["clean", "failed", "contact", "failed_contact"]);
    }

    #[test]
    fn a_table_with_a_fault_is_refused_by_line() {
        let text = write_rows(&outcomes(), 3, Condition::Touch);
        let error = |text: &str| parse_rows(text, (3, Condition::Touch), (2, 2)).expect_err("refused");
        for (changed, line) in [
            (text.replacen("clean", "perfect", 1), 2),
            (text.replacen("1 0 contact", "1 1 contact", 1), 4),
            (text.lines().take(4).collect::<Vec<_>>().join("\n"), 5),
            (text.clone() + "2 0 clean 1 0123456789abcdef 01234567\n", 6),
            (text.replacen("combination", "pair", 1), 1),
            (String::new(), 1),
        ] {
            assert_eq!(error(&changed).line, line, "{changed}");
        }
    }

    /// The wall-clock time of decisions and the paths in a failed policy's traceback are no part of a record.
    #[test]
    fn repetitions_have_the_same_digest() {
        let one = record(0, 0, Condition::External, false, false);
        let digest = |record: &TrialRecord| record_digest(record).expect("a digest");
        assert_eq!(digest(&one), digest(&TrialRecord { decision_ms: Some(3.0), ..one.clone() }));
        assert_ne!(digest(&one), digest(&TrialRecord { reason: "another".into(), ..one.clone() }));
        let failed = TrialRecord { cause: Some(FailureCause::PolicyFailed), ..one };
        assert_eq!(digest(&failed), digest(&TrialRecord { reason: "/a/b.py".into(), ..failed.clone() }));
    }

    #[test]
    fn contradicting_columns_are_refused() {
        let record = TrialRecord { clean_success: true, ..record(0, 0, Condition::Touch, true, true) };
        let error = RecordedOutcome::from_record(&record).expect_err("refused").to_string();
        assert!(error.contains("clean_success = true") && error.contains("`contact`"), "{error}");
    }
}
