//! The outcomes of the fault matrix, summed by fault, as rows and as text.

use std::collections::HashSet;

use serde_json::{Value, json};

use crate::kind::{Expected, Kind, Teller};
use crate::{Mirrored, NAMED_WITHIN, Outcome as FaultOutcome};

/// All outcomes, summed by fault.
pub struct FaultTable {
    rows: Vec<Value>,
    /// What should not have happened, a line each.
    pub wrong: Vec<String>,
    injected: usize,
    phases: usize,
    /// Goals of servos and joints that were compared with their limits.
    checked: u64,
    /// Whether a mirror ran beside each.
    mirrored: bool,
}

impl FaultTable {
    /// Sums the outcomes of each of `kinds`.
    pub fn new(kinds: &[Kind], outcomes: &[FaultOutcome]) -> Self {
        Self {
            rows: kinds.iter().map(|kind| row(*kind, outcomes)).collect(),
            wrong: outcomes.iter().filter_map(complaint).collect(),
            injected: outcomes.len(),
            phases: outcomes.iter().map(|outcome| outcome.phase).collect::<HashSet<_>>().len(),
            checked: outcomes.iter().map(|outcome| outcome.checked).sum(),
            mirrored: outcomes.iter().any(|outcome| outcome.mirrored.is_some()),
        }
    }

    pub fn to_json(&self) -> Value {
        let Self { rows, wrong, injected, phases, checked, .. } = self;
        json!({ "injected": injected, "phases": phases, "goals_checked": checked, "rows": rows, "wrong": wrong })
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
            text += &line(row);
        }
        if self.mirrored {
            text += &self.names();
        }
        text += "a fault with which the robot `goes on` may end in a hold as well\n";
        text += "* the fault itself takes a servo's torque: what that digit held may fall, whatever the others hold\n";
        text += &format!(
            "{} faults in {} phases, {} goals of servos and joints held to their limits; times on the emulated clock: until the \
             supervisor holds (or servos and arm have stopped by themselves), and until the arm stands\n",
            self.injected, self.phases, self.checked
        );
        text
    }

    /// Who named each fault, how often and how soon, and how often something else was named.
    fn names(&self) -> String {
        let mut text = format!(
            "\n{:34} {:>12} {:>8} {:>8} {:>18} {:>8}\n",
            "fault", "told by", "injected", "rightly", "ms to name (max)", "wrongly"
        );
        for row in &self.rows {
            let name = &row["named"];
            let ms = |key: &str| name[key].as_f64().map_or("-".to_owned(), |ms| format!("{ms:.0}"));
            text += &format!(
                "{:34} {:>12} {:>8} {:>8} {:>18} {:>8}\n",
                row["fault"].as_str().unwrap_or_default(),
                name["teller"].as_str().unwrap_or_default(),
                row["injected"].to_string(),
                name["rightly"].to_string(),
                format!("{} ({})", ms("told_ms_median"), ms("told_ms_max")),
                name["wrongly"].to_string(),
            );
        }
        let sum = |key: &str| self.rows.iter().filter_map(|row| row["named"][key].as_u64()).sum::<u64>();
        text += &format!(
            "{} of {} named rightly within {NAMED_WITHIN} s and nothing else beside them\n\n",
            sum("rightly"),
            self.injected
        );
        text
    }

    /// The first thing that should not have happened, and how many more there are.
    pub fn shortfall(&self) -> Option<String> {
        let first = self.wrong.first()?;
        let more = self.wrong.len() - 1;
        Some(format!("{first}{}", if more > 0 { format!(" (and {more} more)") } else { String::new() }))
    }
}

fn line(row: &Value) -> String {
    let ms = |name: &str| row[name].as_f64().map_or("-".to_owned(), |ms| format!("{ms:.0}"));
    let lost = format!("{} of {}{}", row["lost"], row["held"], if row["takes_torque"] == true { "*" } else { "" });
    let number = |name: &str| row[name].to_string();
    format!(
        "{:34} {:>12} {:>8} {:>8} {:>8} {:>18} {:>18} {:>8} {:>12} {:>9.1} {:>7}\n",
        row["fault"].as_str().unwrap_or_default(),
        row["expected"].as_str().unwrap_or_default(),
        number("injected"),
        number("as_expected"),
        number("stopped"),
        format!("{} ({})", ms("stopped_ms_median"), ms("stopped_ms_max")),
        format!("{} ({})", ms("safe_ms_median"), ms("safe_ms_max")),
        number("outside_limits"),
        lost,
        row["moved_mm_max"].as_f64().unwrap_or_default(),
        number("recordings_intact"),
    )
}

fn row(kind: Kind, outcomes: &[FaultOutcome]) -> Value {
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
    json!({
        "fault": kind.name(),
        "expected": match kind.expected() {
            Expected::GoesOn => "goes on",
            Expected::Holds => "hold",
            Expected::Faults => "fault",
            Expected::StopsItself => "stops itself",
        },
        "injected": of.len(),
        "as_expected": sum(|outcome| usize::from(outcome.as_expected)),
        "stopped": times.len(),
        "stopped_ms_median": stops.get(stops.len() / 2),
        "stopped_ms_max": stops.last(),
        "slowest_in": slowest.map(|outcome| outcome.phase.name()),
        "slowest_began_at_rad_s": slowest.map(|outcome| outcome.speed),
        "safe_ms_median": times.get(times.len() / 2),
        "safe_ms_max": times.last(),
        "outside_limits": of.iter().map(|outcome| outcome.outside).sum::<u64>(),
        "held": sum(|outcome| outcome.held),
        "lost": sum(|outcome| outcome.lost),
        "moved_mm_max": of.iter().map(|outcome| outcome.moved).fold(0.0, f64::max),
        "takes_torque": kind.takes_torque(),
        "recordings_intact": sum(|outcome| usize::from(outcome.intact)),
        "named": named(kind, &of),
    })
}

/// What was named beside outcomes `of` one fault; null where no mirror ran.
fn named(kind: Kind, of: &[&FaultOutcome]) -> Value {
    let all: Vec<&Mirrored> = of.iter().filter_map(|outcome| outcome.mirrored.as_ref()).collect();
    if all.is_empty() {
        return Value::Null;
    }
    let mut times: Vec<f64> = all.iter().filter_map(|mirrored| mirrored.told_ms).collect();
    times.sort_by(f64::total_cmp);
    json!({
        "teller": match kind.teller() {
            Teller::Nobody => "nobody",
            Teller::Supervisor => "supervisor",
            Teller::Mirror(_) => "mirror",
        },
        "rightly": all.iter().filter(|mirrored| mirrored.is_right(kind)).count(),
        "told_ms_median": times.get(times.len() / 2),
        "told_ms_max": times.last(),
        "wrongly": all.iter().filter(|mirrored| !mirrored.wrong.is_empty()).count(),
        "wrong": all.iter().flat_map(|mirrored| mirrored.wrong.clone()).collect::<Vec<_>>(),
    })
}

/// What should not have come of a fault.
fn complaint(outcome: &FaultOutcome) -> Option<String> {
    let FaultOutcome { kind, phase, round, state, .. } = outcome;
    let what = if !outcome.as_expected {
        format!("ended in `{state}`")
    } else if outcome.outside > 0 {
        format!("{} commands outside their limits", outcome.outside)
    } else if outcome.lost > 0 && !kind.takes_torque() && kind.expected() != Expected::GoesOn {
        format!("{} of {} held objects lost in `{state}`", outcome.lost, outcome.held)
    } else if !outcome.intact {
        "the recording is not intact".to_owned()
    } else {
        return None;
    };
    Some(format!("{} in {}, round {round}: {what}", kind.name(), phase.name()))
}
