//! `--record causes`: a recording of each cause of failure under each condition, and the table that lists them.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use scenarios::FailureCause;
use scenarios::record::Condition;

use super::{RunOptions, condition_recording_name, run_unit_in_place, unit_name};
use crate::journal::{JournalEntry, RunRequest, WorkUnit};
use crate::trial::Bench;

/// Runs the first trial of each cause of failure under each condition again, recorded, and lists the recordings in
/// `causes.csv`. Real trials are not repeated: they have been recorded.
pub fn record_causes(
    bench: &Bench,
    request: &RunRequest,
    done: &BTreeMap<WorkUnit, JournalEntry>,
    folder: &Path,
    options: &RunOptions,
) -> Result<()> {
    let mut examples: BTreeMap<(Condition, FailureCause), WorkUnit> = BTreeMap::new();
    for (unit, record) in done.values().flat_map(|entry| entry.records.iter().map(|record| (entry.unit, record))) {
        if let Some(cause) = record.cause {
            examples.entry((record.condition, cause)).or_insert(unit);
        }
    }
    let mut table = "condition,cause,recording\n".to_owned();
    for ((condition, cause), unit) in examples {
        if !request.keeps_wall_time() {
            let found = replay_unit(bench, request, (unit, condition), folder, options)?;
            if found != Some(cause) {
                let found = found.map_or_else(|| "no failure".to_owned(), |found| found.to_string());
                eprintln!(
                    "{}, {condition}: run again for its recording; found {found}, expected {cause}",
                    unit_name(unit)
                );
            }
        }
        table +=
            &format!("{condition},{cause},recordings/{}.rrd\n", condition_recording_name(&unit_name(unit), condition));
    }
    Ok(ftac_platform::data::write_atomically(&folder.join("causes.csv"), table.as_bytes())?)
}

/// Runs and records a unit under one condition alone. Returns its cause of failure.
fn replay_unit(
    bench: &Bench,
    request: &RunRequest,
    (unit, condition): (WorkUnit, Condition),
    folder: &Path,
    options: &RunOptions,
) -> Result<Option<FailureCause>> {
    let alone = RunRequest { conditions: vec![condition], ablations: Vec::new(), ..request.clone() };
    // Robot backends that cannot be cloned append the condition themselves.
    let cloned = request.robot == "sim";
    let name = if cloned { condition_recording_name(&unit_name(unit), condition) } else { unit_name(unit) };
    // The film shows all conditions of its trial.
    let unfilmed = RunOptions { film: false, ..*options };
    let results = run_unit_in_place(bench, &alone, (unit, &name), folder, &unfilmed, true)?;
    Ok(results.records.first().and_then(|record| record.cause))
}
