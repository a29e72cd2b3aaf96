//! Records of trials, and `trials.csv`.

use std::io::{Read, Write};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ablation::Ablation;
use crate::referee::{ContactWith, FailureCause};

/// Experimental conditions of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// No noise, policy `blind`.
    Ideal,
    /// Noise, policy `blind`.
    Blind,
    /// The same noise, policy `touch` without tactile images: it detects and retries by encoders and currents.
    Reflex,
    /// The same noise, policy `touch`.
    Touch,
    /// The same noise, external policy.
    #[serde(alias = "own")]
    External,
}

impl Condition {
    /// All conditions in order.
    pub const ALL: [Self; 5] = [Self::Ideal, Self::Blind, Self::Reflex, Self::Touch, Self::External];

    /// Built-in conditions.
    pub const BUILT_IN: [Self; 4] = [Self::Ideal, Self::Blind, Self::Reflex, Self::Touch];

    /// Conditions with noise.
    pub const NOISY: [Self; 4] = [Self::Blind, Self::Reflex, Self::Touch, Self::External];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Blind => "blind",
            Self::Reflex => "reflex",
            Self::Touch => "touch",
            Self::External => "external",
        }
    }
}

/// Error: no condition has this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("condition: found {found}, expected one of {}", Condition::ALL.map(Condition::name).join(", "))]
pub struct UnknownCondition {
    found: String,
}

impl std::str::FromStr for Condition {
    type Err = UnknownCondition;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        // Tables of version 0.1 call the external policy's condition `own`.
        let text = if text == "own" { Self::External.name() } else { text };
        let known = Self::ALL.into_iter().find(|condition| condition.name() == text);
        known.ok_or_else(|| UnknownCondition { found: text.to_owned() })
    }
}

impl std::fmt::Display for Condition {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

/// Key of a trial under one condition. Its order is that of `trials.csv`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TrialId {
    /// Number of the combination, [`crate::Combination::id`].
    pub combination: usize,
    /// Number of the trial within its combination, from 0.
    pub trial: usize,
    /// Noise and policy.
    pub condition: Condition,
}

impl std::fmt::Display for TrialId {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "combination {}, trial {}, {}", self.combination, self.trial, self.condition)
    }
}

/// One trial under one condition: a row of `trials.csv`, whose columns are in this order. All columns but `decision_ms`
/// are the same in every repetition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrialRecord {
    /// Number of the combination, [`crate::Combination::id`].
    pub combination: usize,
    /// Number of the trial within its combination, from 0.
    pub trial: usize,
    /// Noise and policy.
    pub condition: Condition,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object; empty in a trial of one.
    pub second: String,
    /// True if there was an unwanted contact in any try.
    pub contact: bool,
    /// Kind of the first unwanted contact.
    pub contact_with: Option<ContactWith>,
    /// Start of the first unwanted contact, s since the trial began.
    pub contact_s: Option<f64>,
    /// Greatest force of the first unwanted contact, N.
    pub contact_n: Option<f64>,
    /// True if all objects were held at the end.
    pub success: bool,
    /// Success without any unwanted contact.
    pub clean_success: bool,
    /// Cause of the failure; empty on success.
    pub cause: Option<FailureCause>,
    /// True if the policy left the planned strategy.
    pub switched: bool,
    /// Number of retries of a grasp.
    pub retries: u32,
    /// The policy's reason for switching strategy or retrying, or for neither.
    pub reason: String,
    /// Disturbance applied to the trial beside its noise; missing in older tables.
    #[serde(default)]
    pub disturbance: String,
    /// Predicted probability that the planned second grasp ends in an unwanted contact, at the first decision.
    pub risk: Option<f64>,
    /// Predicted separation at the planned second grasp, mm: the distance between the first object, as felt in the hand
    /// at the first decision, and the second object in its place. Negative if they overlap, which is a predicted
    /// collision. None if the first object was not felt, and in tables without this column.
    #[serde(default)]
    pub plan_separation_mm: Option<f64>,
    /// Predicted separation at the second grasp that was chosen, mm; none if the policy does not choose, or declined.
    #[serde(default)]
    pub chosen_separation_mm: Option<f64>,
    /// Distance between the estimated and the true position of the first object in the hand, mm.
    pub pose_error_mm: Option<f64>,
    /// Angle between the estimated and the true orientation of the first object, modulo its symmetry, deg.
    pub pose_error_deg: Option<f64>,
    /// Position error of the prior, the planned pose before touch, mm.
    pub prior_error_mm: Option<f64>,
    /// Duration of the trial, s: simulated time or, on hardware, real time.
    pub sim_seconds: f64,
    /// Wall-clock time from the tactile images to the choice of a strategy, ms.
    pub decision_ms: Option<f64>,
    /// Name of the third object. The column exists if trials have one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub third: String,
    /// Pose errors in the hand of the objects after the first. The column exists if trials have a third object.
    #[serde(default, skip_serializing_if = "PoseErrors::is_empty")]
    pub later_pose_errors: PoseErrors,
}

/// Pose errors of several objects in the hand, `[mm, deg]` each; none for an object that was not felt. As text, the
/// numbers follow one another, with `-` for none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(into = "String", try_from = "String")]
pub struct PoseErrors(pub Vec<Option<[f64; 2]>>);

impl PoseErrors {
    /// True if there is no entry.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl From<PoseErrors> for String {
    fn from(errors: PoseErrors) -> Self {
        let words = errors.0.iter().map(|error| error.map_or("- -".to_owned(), |[mm, deg]| format!("{mm} {deg}")));
        words.collect::<Vec<_>>().join(" ")
    }
}

impl TryFrom<String> for PoseErrors {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let wrong = || format!("found `{text}`, expected two numbers or `- -` for each object");
        let words: Vec<&str> = text.split_whitespace().collect();
        let one = |pair: &[&str]| match pair {
            ["-", "-"] => Ok(None),
            [mm, deg] => Ok(Some([mm.parse().map_err(|_| wrong())?, deg.parse().map_err(|_| wrong())?])),
            _ => Err(wrong()),
        };
        words.chunks(2).map(one).collect::<Result<_, _>>().map(Self)
    }
}

impl TrialRecord {
    /// Returns the sort key of `trials.csv`.
    pub fn id(&self) -> TrialId {
        TrialId { combination: self.combination, trial: self.trial, condition: self.condition }
    }

    /// Returns the names of the objects, in the order in which they were picked.
    pub fn objects(&self) -> Vec<&str> {
        [&self.first, &self.second, &self.third]
            .into_iter()
            .map(String::as_str)
            .filter(|name| !name.is_empty())
            .collect()
    }

    /// Returns the decisions and retries of which [`Self::reason`] consists, in their order.
    pub fn decisions(&self) -> impl Iterator<Item = &str> {
        self.reason.split("; ").filter(|decision| !decision.is_empty())
    }
}

/// Trial of the policy `touch` under an ablation: a row of `ablations.csv`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AblatedTrial {
    /// The ablation: the part of the policy that was removed.
    pub ablation: Ablation,
    /// Result of the trial.
    pub record: TrialRecord,
}

/// Errors of reading or writing a table of trials.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The text is not a table of trials; the message names the line and the field.
    #[error("trials table: {0}")]
    Table(#[from] csv::Error),
    /// The table could not be read or written.
    #[error("trials table: {0}")]
    Io(#[from] std::io::Error),
}

/// Writes a header and one row per record, sorted by [`TrialRecord::id`].
pub fn write_trials(records: &[TrialRecord], to: impl Write) -> Result<(), RecordError> {
    let mut sorted: Vec<&TrialRecord> = records.iter().collect();
    sorted.sort_by_key(|record| record.id());
    let mut writer = csv::Writer::from_writer(to);
    if sorted.is_empty() {
        writer.write_record(COLUMNS)?;
    }
    for record in sorted {
        writer.serialize(record)?;
    }
    writer.flush()?;
    Ok(())
}

/// Writes a header and one row per trial: the ablation, then the columns of `trials.csv`.
pub fn write_ablated(trials: &[AblatedTrial], to: impl Write) -> Result<(), RecordError> {
    let mut sorted: Vec<&AblatedTrial> = trials.iter().collect();
    sorted.sort_by_key(|trial| (trial.ablation, trial.record.id()));
    let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(to);
    let third = sorted.iter().any(|trial| !trial.record.third.is_empty());
    let of_three = third.then_some(["third", "later_pose_errors"]).into_iter().flatten();
    writer.write_record(std::iter::once("ablation").chain(COLUMNS).chain(of_three))?;
    for trial in sorted {
        writer.serialize((trial.ablation, &trial.record))?;
    }
    writer.flush()?;
    Ok(())
}

/// Reads a table written by [`write_trials`], in the file's order.
pub fn read_trials(from: impl Read) -> Result<Vec<TrialRecord>, RecordError> {
    Ok(csv::Reader::from_reader(from).into_deserialize().collect::<Result<_, _>>()?)
}

/// Header of `trials.csv`, without the additional columns of trials of three objects.
pub const COLUMNS: [&str; 24] = [
    "combination",
    "trial",
    "condition",
    "first",
    "second",
    "contact",
    "contact_with",
    "contact_s",
    "contact_n",
    "success",
    "clean_success",
    "cause",
    "switched",
    "retries",
    "reason",
    "disturbance",
    "risk",
    "plan_separation_mm",
    "chosen_separation_mm",
    "pose_error_mm",
    "pose_error_deg",
    "prior_error_mm",
    "sim_seconds",
    "decision_ms",
];

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn record(combination: usize, trial: usize, condition: Condition) -> TrialRecord {
        TrialRecord {
            combination,
            trial,
            condition,
            first: "egg".into(),
            second: "can_50".into(),
            contact: false,
            contact_with: None,
            contact_s: None,
            contact_n: None,
            success: true,
            clean_success: true,
            cause: None,
            switched: condition == Condition::Touch,
            retries: 1,
            reason: "clear, \"quoted\", with commas".into(),
            disturbance: "pushed".into(),
            risk: None,
            plan_separation_mm: None,
            chosen_separation_mm: None,
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: 0.1 + 0.2,
            decision_ms: None,
            third: String::new(),
            later_pose_errors: PoseErrors::default(),
        }
    }

    #[test]
    fn a_table_comes_back_sorted_and_bit_for_bit() {
        let mut lost = record(1, 0, Condition::Blind);
        (lost.success, lost.clean_success) = (false, false);
        (lost.contact, lost.contact_with) = (true, Some(ContactWith::Palm));
        lost.cause = Some(FailureCause::SecondNotPicked);
        lost.pose_error_mm = Some(1.0 / 3.0);
        lost.decision_ms = Some(42.5);
        let records =
            vec![lost, record(0, 1, Condition::Ideal), record(0, 0, Condition::Touch), record(0, 0, Condition::Blind)];
        let mut file = Vec::new();
        write_trials(&records, &mut file).unwrap();
        let text = String::from_utf8(file.clone()).unwrap();
        assert_eq!(text.lines().next().unwrap(), COLUMNS.join(","));
        assert!(text.contains("second_not_picked"));
        let mut sorted = records;
        sorted.sort_by_key(TrialRecord::id);
        assert_eq!(read_trials(file.as_slice()).unwrap(), sorted);
    }

    /// Trials of three objects have two more columns, whose pose errors survive a round trip. Half a pair is refused
    /// with an error that shows it.
    #[test]
    fn three_objects_have_pose_errors_each() {
        let three = TrialRecord {
            third: "pear".into(),
            later_pose_errors: PoseErrors(vec![None, Some([1.0 / 3.0, 2.5])]),
            ..record(0, 0, Condition::Touch)
        };
        let mut file = Vec::new();
        write_trials(std::slice::from_ref(&three), &mut file).unwrap();
        assert_eq!(read_trials(file.as_slice()).unwrap(), [three]);
        let text = String::from_utf8(file).unwrap();
        assert!(
            text.contains(",third,later_pose_errors\n") && text.contains("pear,- - 0.3333333333333333 2.5"),
            "{text}"
        );
        let error = read_trials(text.replace("0.3333333333333333 2.5", "0.3").as_bytes()).unwrap_err().to_string();
        assert!(error.contains("found `- - 0.3`"), "{error}");
    }

    #[test]
    fn an_empty_table_has_a_header_and_a_bad_one_a_reason() {
        let mut file = Vec::new();
        write_trials(&[], &mut file).unwrap();
        assert_eq!(read_trials(file.as_slice()).unwrap(), []);
        let text = String::from_utf8(file).unwrap() + "0,0,psychic,egg,egg,false,,,,true,true,,false,0,,,,,,,,,1.0,\n";
        let error = read_trials(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("line: 2") && error.contains("psychic"), "{error}");
    }
}
