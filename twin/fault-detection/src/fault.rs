//! Faults that fault detection reports: differences between a robot and its reference model, worded for people.

use std::fmt;

use scenarios::record::{Condition, TrialId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    CableBroken,
    CableSlipped,
    ServoWeak,
    ObjectLost,
    UnexpectedContact,
    OtherPayload,
    PadDrifted,
    CameraDead,
}

impl FaultKind {
    /// All kinds.
    pub const ALL: [Self; 8] = [
        Self::CableBroken,
        Self::CableSlipped,
        Self::ServoWeak,
        Self::ObjectLost,
        Self::UnexpectedContact,
        Self::OtherPayload,
        Self::PadDrifted,
        Self::CameraDead,
    ];

    /// Returns the name of the kind in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::CableBroken => "cable_broken",
            Self::CableSlipped => "cable_slipped",
            Self::ServoWeak => "servo_weak",
            Self::ObjectLost => "object_lost",
            Self::UnexpectedContact => "unexpected_contact",
            Self::OtherPayload => "other_payload",
            Self::PadDrifted => "pad_drifted",
            Self::CameraDead => "camera_dead",
        }
    }

    /// Returns the kind in words, and the unit of its numbers.
    fn description(self) -> (&'static str, &'static str) {
        match self {
            Self::CableBroken => ("cable broken", "N of tension"),
            Self::CableSlipped => ("cable slipped on its spool", "mm wound in slack"),
            Self::ServoWeak => ("servo weak", "of its torque"),
            Self::ObjectLost => ("object lost", "N on the hand"),
            Self::UnexpectedContact => ("unexpected contact", "N on the hand"),
            Self::OtherPayload => ("payload other than planned", "kg"),
            Self::PadDrifted => ("pad drifted", "of a colour's light"),
            Self::CameraDead => ("camera dead", "images"),
        }
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A detected fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DetectedFault {
    /// Time of the report on the clock of the robot backend, s.
    pub time: f64,
    pub kind: FaultKind,
    /// Affected part: a digit, a camera, the hand or an object.
    pub part: String,
    /// Measured value; the unit depends on the kind.
    pub found: f64,
    /// Value of the reference model, in the same unit.
    pub expected: f64,
}

impl fmt::Display for DetectedFault {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (words, unit) = self.kind.description();
        let Self { time, part, found, expected, .. } = self;
        write!(f, "{time:.2} s: {part}: {words} (found {found:.2}, expected {expected:.2} {unit})")
    }
}

/// A detected fault with the condition of its trial, a row of `faults.csv`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultRow {
    pub condition: Condition,
    #[serde(flatten)]
    pub fault: DetectedFault,
}

/// Writes the table `faults.csv`, one row per fault.
pub fn write_table<'a>(rows: impl Iterator<Item = (TrialId, &'a DetectedFault)>) -> String {
    let mut table = "combination,trial,condition,time_s,fault,part,found,expected\n".to_owned();
    for (id, row) in rows {
        let DetectedFault { time, kind, part, found, expected } = row;
        let TrialId { combination, trial, condition } = id;
        table += &format!("{combination},{trial},{condition},{time:.4},{kind},{part},{found:.4},{expected:.4}\n");
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_reads_as_a_sentence_and_as_a_row() {
        let lost = DetectedFault {
            time: 3.25,
            kind: FaultKind::CableBroken,
            part: "ring".to_owned(),
            found: 0.0,
            expected: 7.125,
        };
        assert_eq!(lost.to_string(), "3.25 s: ring: cable broken (found 0.00, expected 7.12 N of tension)");
        let id = TrialId { combination: 4, trial: 1, condition: Condition::Touch };
        let table = write_table([(id, &lost)].into_iter());
        assert_eq!(table.lines().nth(1), Some("4,1,touch,3.2500,cable_broken,ring,0.0000,7.1250"));
    }

    /// Names equal those written by serde, and all are distinct.
    #[test]
    fn names_are_those_of_the_journal() {
        for kind in FaultKind::ALL {
            assert_eq!(serde_json::to_string(&kind).expect("a name"), format!("\"{kind}\""));
        }
    }
}
