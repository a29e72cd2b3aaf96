//! Outcomes of the fault matrix, aggregated by fault, as rows and as text.

use std::collections::HashSet;

use schemars::JsonSchema;
use serde::Serialize;

use crate::kind::{DetectingParty, ExpectedOutcome, InjectedFault};
use crate::{DIAGNOSIS_TIME_LIMIT, InjectionDiagnosis, InjectionOutcome as FaultOutcome};

/// All outcomes, aggregated by fault.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FaultTable {
    /// Faults injected.
    injected: usize,
    /// Phases of the trial.
    phases: usize,
    /// Goals of servos and joints that were compared with their limits.
    goals_checked: u64,
    /// One entry per row of the table.
    rows: Vec<Row>,
    /// Unexpected events, one line each.
    pub wrong: Vec<String>,
}

/// The outcomes of one fault.
#[derive(Debug, Serialize, JsonSchema)]
struct Row {
    /// The fault.
    fault: &'static str,
    /// Expected outcome.
    expected: &'static str,
    /// Faults injected.
    injected: usize,
    /// Faults with the expected outcome.
    as_expected: usize,
    /// Faults after which the robot stood.
    stopped: usize,
    /// Median time from fault to a standing robot, ms.
    stopped_ms_median: Option<f64>,
    /// Longest time from fault to a standing robot, ms.
    stopped_ms_max: Option<f64>,
    /// Phase of the slowest stop.
    slowest_in: Option<String>,
    /// Speed of the arm at the start of the slowest stop, rad/s.
    slowest_began_at_rad_s: Option<f64>,
    /// Median time from fault to a safe state, ms.
    safe_ms_median: Option<f64>,
    /// Longest time from fault to a safe state, ms.
    safe_ms_max: Option<f64>,
    /// Number of exceeded limits.
    outside_limits: u64,
    /// Objects that were held.
    held: usize,
    /// Number of held objects that were lost.
    lost: usize,
    /// Largest displacement of a held object, mm.
    moved_mm_max: f64,
    /// True if the fault removes a servo's torque.
    takes_torque: bool,
    /// Recordings that replay to the bit.
    recordings_intact: usize,
    /// Diagnosis of the fault; null without --detect-faults.
    diagnosis: Option<Diagnosis>,
}

/// Diagnosis by fault detection beside the robot, or by the supervisor.
#[derive(Debug, Serialize, JsonSchema)]
struct Diagnosis {
    /// Party that can detect the fault: nobody, supervisor or detector.
    detected_by: &'static str,
    /// Faults that were detected in time, or rightly were not, without any other report.
    rightly: usize,
    /// Median time from fault to detection, ms.
    detected_ms_median: Option<f64>,
    /// Longest time from fault to detection, ms.
    detected_ms_max: Option<f64>,
    /// Faults for which fault detection reported another one.
    wrongly: usize,
    /// Other faults that fault detection reported.
    wrong: Vec<String>,
}

/// Formats milliseconds for a table.
fn ms(time: Option<f64>) -> String {
    time.map_or("-".to_owned(), |ms| format!("{ms:.0}"))
}

impl FaultTable {
    /// Aggregates the outcomes of each of `kinds`.
    pub fn new(kinds: &[InjectedFault], outcomes: &[FaultOutcome]) -> Self {
        Self {
            rows: kinds.iter().map(|kind| row(*kind, outcomes)).collect(),
            wrong: outcomes.iter().filter_map(first_violation).collect(),
            injected: outcomes.len(),
            phases: outcomes.iter().map(|outcome| outcome.phase).collect::<HashSet<_>>().len(),
            goals_checked: outcomes.iter().map(|outcome| outcome.checked).sum(),
        }
    }

    pub fn to_text(&self) -> String {
        let mut text = format!(
            "{:34} {:>12} {:>8} {:>8} {:>8} {:>18} {:>18} {:>8} {:>12} {:>9} {:>7}\n",
            "fault",
            "expected",
            "injected",
            "so",
            "stopped",
            "ms to hold (max)",
            "arm stands (max)",
            "outside",
            "lost of held",
            "moved mm",
            "intact"
        );
        for row in &self.rows {
            text += &row.text_line();
        }
        text += &self.diagnosis_table();
        text += "a fault with which the robot `goes on` may also end in a hold\n";
        text += "* the fault itself removes a servo's torque: objects held by that digit may fall\n";
        text += &format!(
            "{} faults in {} phases, {} goals of servos and joints checked; times on the emulated clock: until the \
             supervisor holds (or servos and arm have stopped by themselves), and until the arm stands\n",
            self.injected, self.phases, self.goals_checked
        );
        text
    }

    /// Formats the table of diagnoses: detecting party, number, time and false reports of each fault. Empty if fault
    /// detection did not run.
    fn diagnosis_table(&self) -> String {
        let named = || self.rows.iter().filter_map(|row| Some((row, row.diagnosis.as_ref()?)));
        if named().next().is_none() {
            return String::new();
        }
        let mut text = format!(
            "\n{:34} {:>12} {:>8} {:>8} {:>18} {:>8}\n",
            "fault", "detected by", "injected", "rightly", "ms (max)", "wrongly"
        );
        for (row, name) in named() {
            text += &format!(
                "{:34} {:>12} {:>8} {:>8} {:>18} {:>8}\n",
                row.fault,
                name.detected_by,
                row.injected,
                name.rightly,
                format!("{} ({})", ms(name.detected_ms_median), ms(name.detected_ms_max)),
                name.wrongly,
            );
        }
        text += &format!(
            "{} of {} detected rightly within {DIAGNOSIS_TIME_LIMIT} s, without other reports\n\n",
            named().map(|(_, name)| name.rightly).sum::<usize>(),
            self.injected
        );
        text
    }

    /// Returns the first unexpected event, and the number of others.
    pub fn shortfall(&self) -> Option<String> {
        let first = self.wrong.first()?;
        let more = self.wrong.len() - 1;
        Some(format!("{first}{}", if more > 0 { format!(" (and {more} more)") } else { String::new() }))
    }
}

impl Row {
    fn text_line(&self) -> String {
        format!(
            "{:34} {:>12} {:>8} {:>8} {:>8} {:>18} {:>18} {:>8} {:>12} {:>9.1} {:>7}\n",
            self.fault,
            self.expected,
            self.injected,
            self.as_expected,
            self.stopped,
            format!("{} ({})", ms(self.stopped_ms_median), ms(self.stopped_ms_max)),
            format!("{} ({})", ms(self.safe_ms_median), ms(self.safe_ms_max)),
            self.outside_limits,
            format!("{} of {}{}", self.lost, self.held, if self.takes_torque { "*" } else { "" }),
            self.moved_mm_max,
            self.recordings_intact,
        )
    }
}

fn row(kind: InjectedFault, outcomes: &[FaultOutcome]) -> Row {
    let of: Vec<&FaultOutcome> = outcomes.iter().filter(|outcome| outcome.kind == kind).collect();
    let sorted = |value: fn(&FaultOutcome) -> Option<f64>| {
        let mut times: Vec<f64> = of.iter().filter_map(|outcome| value(outcome)).collect();
        times.sort_by(f64::total_cmp);
        times
    };
    let (stops, times) = (sorted(|outcome| outcome.stopped_ms), sorted(|outcome| outcome.safe_ms));
    let slowest = of.iter().filter(|outcome| outcome.safe_ms.is_some()).max_by(|a, b| {
        let time = |outcome: &FaultOutcome| outcome.safe_ms.unwrap_or(0.0);
        time(a).total_cmp(&time(b))
    });
    let sum = |value: fn(&FaultOutcome) -> usize| of.iter().map(|outcome| value(outcome)).sum::<usize>();
    Row {
        fault: kind.name(),
        expected: match kind.expected() {
            ExpectedOutcome::GoesOn => "goes on",
            ExpectedOutcome::Holds => "hold",
            ExpectedOutcome::Faults => "fault",
            ExpectedOutcome::StopsItself => "stops itself",
        },
        injected: of.len(),
        as_expected: sum(|outcome| usize::from(outcome.as_expected)),
        stopped: times.len(),
        stopped_ms_median: stops.get(stops.len() / 2).copied(),
        stopped_ms_max: stops.last().copied(),
        slowest_in: slowest.map(|outcome| outcome.phase.name().into_owned()),
        slowest_began_at_rad_s: slowest.map(|outcome| outcome.speed),
        safe_ms_median: times.get(times.len() / 2).copied(),
        safe_ms_max: times.last().copied(),
        outside_limits: of.iter().map(|outcome| outcome.outside).sum(),
        held: sum(|outcome| outcome.held),
        lost: sum(|outcome| outcome.lost),
        moved_mm_max: of.iter().map(|outcome| outcome.moved).fold(0.0, f64::max),
        takes_torque: kind.takes_torque(),
        recordings_intact: sum(|outcome| usize::from(outcome.intact)),
        diagnosis: diagnosis(kind, &of),
    }
}

/// Aggregates the diagnoses of the outcomes `of` one fault. None if fault detection did not run.
fn diagnosis(kind: InjectedFault, of: &[&FaultOutcome]) -> Option<Diagnosis> {
    let all: Vec<&InjectionDiagnosis> = of.iter().filter_map(|outcome| outcome.diagnosis.as_ref()).collect();
    if all.is_empty() {
        return None;
    }
    let mut times: Vec<f64> = all.iter().filter_map(|mirrored| mirrored.detected_ms).collect();
    times.sort_by(f64::total_cmp);
    Some(Diagnosis {
        detected_by: match kind.detecting_party() {
            DetectingParty::Nobody => "nobody",
            DetectingParty::Supervisor => "supervisor",
            DetectingParty::FaultDetector(_) => "detector",
        },
        rightly: all.iter().filter(|mirrored| mirrored.is_correct(kind)).count(),
        detected_ms_median: times.get(times.len() / 2).copied(),
        detected_ms_max: times.last().copied(),
        wrongly: all.iter().filter(|mirrored| !mirrored.wrong.is_empty()).count(),
        wrong: all.iter().flat_map(|mirrored| mirrored.wrong.clone()).collect(),
    })
}

/// Describes the first violated requirement of an outcome.
fn first_violation(outcome: &FaultOutcome) -> Option<String> {
    let FaultOutcome { kind, phase, round, state, .. } = outcome;
    let what = if !outcome.as_expected {
        format!("ended in `{state}`")
    } else if outcome.outside > 0 {
        format!("{} commands outside their limits", outcome.outside)
    } else if outcome.lost > 0 && !kind.takes_torque() && kind.expected() != ExpectedOutcome::GoesOn {
        format!("{} of {} held objects lost in `{state}`", outcome.lost, outcome.held)
    } else if !outcome.intact {
        "the recording is not intact".to_owned()
    } else {
        return None;
    };
    Some(format!("{} in {}, round {round}: {what}", kind.name(), phase.name()))
}
