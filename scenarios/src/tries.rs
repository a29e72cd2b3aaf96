//! Tries: each attempt at an object within a trial, with its predictions and its outcome, and `tries.csv`.

use std::io::Write;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::record::{Condition, RecordError, TrialId};
use crate::referee::{ContactingBody, TryVerdict, UnwantedContact};
use world::attempt::Attempt;
use world::layout::MAX_OBJECTS;

/// Names of the places in the picking order.
const ORDER_NAMES: [&str; MAX_OBJECTS] = ["first", "second", "third"];

/// A row of `tries.csv`, whose columns are in this order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TryRecord {
    /// Number of the combination, [`crate::Combination::id`].
    pub combination: usize,
    /// Number of the trial within its combination, from 0.
    pub trial: usize,
    /// Noise and policy.
    pub condition: Condition,
    /// Number of the try within its trial, from 0.
    #[serde(rename = "try")]
    pub number: usize,
    /// `first`, `second` or `third`.
    pub object: String,
    /// Identification number of the grasp.
    pub grasp: u32,
    /// Reason for this grasp.
    pub why: String,
    /// Predicted clearance between the held objects and this object on the way to it, mm.
    pub clearance_mm: Option<f64>,
    /// Predicted probability of an unwanted contact.
    pub risk: Option<f64>,
    /// In-hand pose of the first object as felt, palm frame: position (m) and rotation vector (rad), six numbers.
    pub felt: String,
    /// Covariance of `felt`: the upper triangle, row by row, 21 numbers.
    pub covariance: String,
    /// Kind of the first unwanted contact; empty if there was none.
    pub contact_with: String,
    /// Part that touched: `first_object`, `second_object`, `palm`, or a link by its index.
    pub contact_by: String,
    /// Start of the contact, s since the trial began.
    pub contact_s: Option<f64>,
    /// Phase of the contact.
    pub contact_phase: String,
    /// Point of the contact in the world frame, m: three numbers.
    pub contact_at: String,
    /// Greatest contact force during the try, N.
    pub contact_n: Option<f64>,
    /// True if the object was in the hand at the end of its lift; empty if it was not lifted.
    pub picked: Option<bool>,
    /// Start of the try, s since the trial began.
    pub begun_s: Option<f64>,
    /// End of the try, s since the trial began.
    pub ended_s: Option<f64>,
}

fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(|value| value.to_string()).collect::<Vec<_>>().join(" ")
}

impl TryRecord {
    /// Creates the record of try number `number` of trial `id`. There is no verdict without ground truth.
    pub fn new(id: TrialId, number: usize, attempt: &Attempt, verdict: Option<&TryVerdict>) -> Self {
        let contact: Option<UnwantedContact> = verdict.and_then(|verdict| verdict.contact);
        let of = |text: fn(&UnwantedContact) -> String| contact.as_ref().map(text).unwrap_or_default();
        let upper = |all: [f64; 36]| (0..6).flat_map(move |row| (row..6).map(move |column| all[6 * row + column]));
        Self {
            combination: id.combination,
            trial: id.trial,
            condition: id.condition,
            number,
            object: ORDER_NAMES[attempt.object.min(ORDER_NAMES.len() - 1)].to_owned(),
            grasp: attempt.grasp,
            why: attempt.why.clone(),
            clearance_mm: attempt.clearance.map(|clearance| clearance * 1e3),
            risk: attempt.risk,
            felt: attempt.felt.map(numbers).unwrap_or_default(),
            covariance: attempt.covariance.map(|all| numbers(upper(all))).unwrap_or_default(),
            contact_with: of(|contact| contact.with.name().to_owned()),
            contact_by: of(|contact| match contact.by {
                Some(ContactingBody::FirstObject) => "first_object".to_owned(),
                Some(ContactingBody::SecondObject) => "second_object".to_owned(),
                Some(ContactingBody::Palm) => "palm".to_owned(),
                Some(ContactingBody::Link(link)) => link.to_string(),
                None => String::new(),
            }),
            contact_s: contact.map(|contact| contact.time),
            contact_phase: of(|contact| contact.phase.to_string()),
            contact_at: contact
                .and_then(|contact| contact.point)
                .map(|point| numbers(point.coords.iter().copied()))
                .unwrap_or_default(),
            contact_n: contact.map(|contact| contact.force),
            picked: verdict.and_then(|verdict| verdict.picked),
            begun_s: verdict.map(|verdict| verdict.begun),
            ended_s: verdict.map(|verdict| verdict.ended),
        }
    }

    /// Returns the sort key of `tries.csv`.
    fn sort_key(&self) -> (TrialId, usize) {
        let id = TrialId { combination: self.combination, trial: self.trial, condition: self.condition };
        (id, self.number)
    }
}

/// Writes a header and one row per try, by trial and number; writes nothing if there are no tries.
pub fn write_tries(tries: &[TryRecord], to: impl Write) -> Result<(), RecordError> {
    let mut sorted: Vec<&TryRecord> = tries.iter().collect();
    sorted.sort_by_key(|one| one.sort_key());
    let mut writer = csv::Writer::from_writer(to);
    for one in sorted {
        writer.serialize(one)?;
    }
    writer.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::referee::ContactWith;
    use world::phase::{Phase, Skill};

    #[test]
    fn a_try_is_a_row_with_its_contact() {
        let contact = UnwantedContact {
            with: ContactWith::HoldingDigits,
            by: Some(ContactingBody::Link(11)),
            phase: Phase::run(Skill::Grasp, 1),
            time: 9.5,
            point: Some(Point3::new(0.6, -0.1, 0.05)),
            force: 2.5,
        };
        let verdict = TryVerdict { object: 1, begun: 8.0, ended: 12.0, contact: Some(contact), picked: Some(false) };
        let mut covariance = [0.0; 36];
        covariance[1] = 7.0;
        let attempt = Attempt { object: 1, grasp: 3, covariance: Some(covariance), ..Attempt::default() };
        let id = TrialId { combination: 4, trial: 2, condition: Condition::Touch };
        let row = TryRecord::new(id, 1, &attempt, Some(&verdict));
        assert_eq!(row.covariance.split(' ').count(), 21);
        let earlier = TryRecord::new(id, 0, &Attempt::default(), None);
        let mut table = Vec::new();
        write_tries(&[row.clone(), earlier.clone()], &mut table).unwrap();
        let read: Vec<TryRecord> =
            csv::Reader::from_reader(table.as_slice()).into_deserialize().collect::<Result<_, _>>().unwrap();
        assert_eq!(read, [earlier, row]);
        let text = String::from_utf8(table).unwrap();
        assert!(text.contains("holding_digits,11,9.5,grasp second,0.6 -0.1 0.05,2.5,false,8.0,12.0"), "{text}");
    }
}
